"""The awareness database: all that one agent is aware of, by id, as the paper has it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from symaware_cli.core.awareness import AwarenessVector, GroupAwareness, SelfAwareness
from symaware_cli.core.motion import motion_quantities
from symaware_cli.core.series import TimeSeries

if TYPE_CHECKING:
    from symaware_cli.core.world import Snapshot


class AwarenessDatabase(MutableMapping[str, AwarenessVector]):
    """All that one agent is aware of, by id: itself, whom it perceives and whom it heard of.

    Of itself the `state` is that of its model. Of every other it is the motion, whoever perceived it or told of it: the
    position, then the velocity, in the dimensions of the world; NaN where nothing is known. `elements` names them.

    What the agent's own components wrote of another wins over what the group's components share. What another tells of
    its intent, its risk and further parts stands beside where it is believed to be.

    Attributes:
        told: What others told of themselves, as of then, by id.
    """

    __slots__ = ("_awareness", "_others", "_own", "_row", "_world", "told")

    def __init__(self, own: SelfAwareness, awareness: GroupAwareness, row: int) -> None:
        self._own = own
        self._awareness = awareness
        self._row = row
        self._others: dict[str, AwarenessVector] = {}
        self._world: Snapshot | None = None
        self.told: dict[str, AwarenessVector] = {}

    @property
    def world(self) -> Snapshot | None:
        """The snapshot of the whole world that this agent knows, if it perceives everything."""
        return self._world or self._awareness.world

    @world.setter
    def world(self, snapshot: Snapshot | None) -> None:
        self._world = snapshot
        self._awareness.others_changed.add(self._row)

    @property
    def others(self) -> Mapping[str, AwarenessVector]:
        """What the agent's own components wrote of others."""
        return self._others

    def __getitem__(self, id: str) -> AwarenessVector:
        if id == self._own.id:
            return self._own
        vector, told = self._others.get(id) or self.perceived(id), self.told.get(id)
        if vector is None and told is None:
            raise KeyError(id)
        if told is None or vector is None:
            return vector or told  # type: ignore[return-value]
        return vector.replaced(**{name: value for name, value in told.items() if self._is_told(name, vector)})

    def _is_told(self, name: str, vector: AwarenessVector) -> bool:
        """Whether what was told of a part counts beside what the agent's own components wrote."""
        part = self._awareness.parts.get(name)
        if part is not None and part.merge != "seen-first":
            return False  # what was told is in the tracks, as far as it is the latest
        return name not in vector or len(vector[name]) == 0

    def perceived(self, id: str) -> AwarenessVector | None:
        """What perceptions, estimators and the inbox tell of another now, whatever the agent's own components wrote."""
        tracked, world = self._tracked(id), self.world
        if tracked is not None or world is None or id not in world:
            return tracked
        return AwarenessVector(id, world.motion(id))

    def elements(self, id: str) -> Mapping[str, float]:
        """What is believed of an agent's state, by the names of its elements.

        Raises:
            KeyError: Nothing is known of it.
        """
        roster, state = self._awareness.roster, self[id].state
        if roster is None:
            return {}
        model = roster.model(id)
        own = model is not None and id == self._own.id
        quantities = model.state if model is not None and own else motion_quantities(roster.dimensions)
        return {quantity.name: float(value) for quantity, value in zip(quantities, state, strict=True)}

    def _tracked(self, id: str) -> AwarenessVector | None:
        """What the group's components tell of another: position and velocity, and their covariance."""
        tracks, roster = self._awareness.tracks, self._awareness.roster
        if tracks is None or roster is None or id not in roster:
            return None
        first, last = tracks.pointers[self._row], tracks.pointers[self._row + 1]
        index = roster.index(id)
        place = first + int(np.searchsorted(tracks.others[first:last], index))
        if place == last or tracks.others[place] != index:
            return None
        state = np.concatenate([tracks.positions[place], tracks.velocities[place]])
        uncertainty = None
        if tracks.covariances is not None:
            uncertainty = TimeSeries.sampled([tracks.time], tracks.covariances[place].reshape(1, -1))
        return AwarenessVector(id, state, uncertainty=uncertainty)

    def _known(self) -> Sequence[str]:
        """Whom the group's components tell of, in the roster's order."""
        world, tracks, roster = self.world, self._awareness.tracks, self._awareness.roster
        if world:
            return world.ids
        if tracks is None or roster is None:
            return ()
        return [
            roster.ids[other] for other in tracks.others[tracks.pointers[self._row] : tracks.pointers[self._row + 1]]
        ]

    def __setitem__(self, id: str, vector: AwarenessVector) -> None:
        if id == self._own.id:
            for name, value in vector.items():
                self._own[name] = value
            return
        self._others[id] = vector.replaced(state=self._awareness.motion(id, vector.state))
        self._awareness.others_changed.add(self._row)

    def __delitem__(self, id: str) -> None:
        del self._others[id]
        self._awareness.others_changed.add(self._row)

    def __iter__(self) -> Iterator[str]:
        yield self._own.id
        known = self._known()
        yield from (id for id in known if id != self._own.id)
        seen = set(known)
        yield from (id for id in sorted({*self._others, *self.told}) if id not in seen and id != self._own.id)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, id: object) -> bool:
        return id == self._own.id or id in self._others or id in self.told or id in self._known()
