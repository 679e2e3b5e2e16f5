"""Situational awareness: what an agent believes, intends, doubts and fears, of itself and of others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core.column import Column, SeriesColumn, frozen
from symaware_cli.core.motion import as_motion, motion_quantities
from symaware_cli.core.reading import Reading
from symaware_cli.core.series import TimeSeries
from symaware_cli.core.tracks import Tracks

if TYPE_CHECKING:
    from symaware_cli.core.world import Roster, Snapshot

Array = NDArray[np.float64]


class AwarenessVector:
    """The situational awareness of one agent, as a plain value.

    Attributes:
        id: Whom it is about.
        state: The believed state; shape (nx,).
        intent: Where it means to go.
        uncertainty: How unsure the belief is.
        risk: How dangerous the situation is.
    """

    __slots__ = ("id", "intent", "risk", "state", "uncertainty")

    def __init__(
        self,
        id: str,
        state: ArrayLike,
        intent: TimeSeries | None = None,
        uncertainty: TimeSeries | None = None,
        risk: TimeSeries | None = None,
    ) -> None:
        self.id = id
        self.state: Array = frozen(state)
        self.intent = TimeSeries() if intent is None else intent
        self.uncertainty = TimeSeries() if uncertainty is None else uncertainty
        self.risk = TimeSeries() if risk is None else risk

    def __repr__(self) -> str:
        return f"AwarenessVector({self.id!r}, state={np.array2string(self.state, precision=4)})"


@dataclass(frozen=True, slots=True)
class Observation:
    """What a perception measured in a step, before anybody makes a belief of it.

    Attributes:
        time: The instant that was measured, in nanoseconds; earlier than now where perception has a delay.
        state: The agents' own states, or None if they were not measured; shape (n, nx).
        state_deviation: Standard deviation of each element of them; shape (nx,).
        tracks: The others that were seen.
        position_deviation: Standard deviation of their positions, along each axis [m].
        velocity_deviation: Standard deviation of their velocities, along each axis [m/s].
    """

    time: int
    state: Array | None
    state_deviation: Array
    tracks: Tracks
    position_deviation: float
    velocity_deviation: float

    def repeats(self, other: Observation | None) -> bool:
        """Whether this is the same measurement as another, which may have come from another process."""
        if self is other:
            return True
        if other is None or self.time != other.time:
            return False
        own = self.state is other.state or (
            self.state is not None and other.state is not None and np.array_equal(self.state, other.state)
        )
        return own and self.tracks.repeats(other.tracks)


class GroupAwareness:
    """The awareness that the agents of a group have: of themselves as columns, of others sparsely.

    Attributes:
        intent: A series for each agent.
        uncertainty: A series for each agent.
        risk: A series for each agent.
        world: What all agents of the group know of everybody, where they perceive everything; one shared
            read-only snapshot, never a copy for each pair.
        observation: What perception measured last, for those who estimate.
        seen: What each agent believes of the others it perceives or perceived, as perception or an estimator wrote it.
        told: What each agent believes of others by what they say.
        readings: What further sensors measured last, by the name of the component, for those who use it.
        roster: Who the indices in `tracks` stand for; set when the world is.
        others_changed: The rows whose own components wrote about others since the last record.
    """

    __slots__ = (
        "_joined",
        "_joined_of",
        "_name",
        "intent",
        "observation",
        "others_changed",
        "readings",
        "risk",
        "roster",
        "seen",
        "state_column",
        "told",
        "uncertainty",
        "world",
    )

    def __init__(self, state: Array, name: str = "") -> None:
        self.state_column = Column(state)
        self.intent = SeriesColumn(len(state))
        self.uncertainty = SeriesColumn(len(state))
        self.risk = SeriesColumn(len(state))
        self.world: Snapshot | None = None
        self.observation: Observation | None = None
        self.seen: Tracks | None = None
        self.told: Tracks | None = None
        self.readings: dict[str, Reading] = {}
        self.roster: Roster | None = None
        self.others_changed: set[int] = set()
        self._name = name
        self._joined: Tracks | None = None
        self._joined_of: tuple[Tracks | None, Tracks | None, Snapshot | None] = (None, None, None)

    @property
    def tracks(self) -> Tracks | None:
        """What each agent believes of others: what is seen wins over what was told, unless that is more recent.

        None where nobody believes anything, or where all that counts is the `world`.
        """
        if self.told is None:
            return self.seen
        known = (self.seen, self.told, self.world)
        if any(one is not other for one, other in zip(known, self._joined_of, strict=True)):
            self._joined, self._joined_of = self._join(self.seen, self.told, self.world), known
        return self._joined

    def _join(self, seen: Tracks | None, told: Tracks, world: Snapshot | None) -> Tracks | None:
        if seen is None and world is not None:
            if told.instants.max(initial=world.time) <= world.time:
                return None
            seen = self.everybody(world)
        return told if seen is None else seen.updated(told)

    def motion(self, id: str, state: ArrayLike, *, is_state: bool = False) -> Array:
        """Bring what somebody says of another agent into the layout of all beliefs of others; see `as_motion`."""
        roster = self.roster
        if roster is None:
            return frozen(state)
        return as_motion(id, state, roster.model(id), roster.dimensions, is_state=is_state)

    def everybody(self, world: Snapshot) -> Tracks:
        """Write out a snapshot that all agents share: a row for each of them and each other."""
        return Tracks.of_everybody(world, world.roster.start(self._name), len(self.state))

    @property
    def state(self) -> Array:
        """What each agent believes of its own state, read-only; shape (n, nx)."""
        return self.state_column.values

    @state.setter
    def state(self, values: ArrayLike) -> None:
        self.state_column.values = values


class SelfAwareness(AwarenessVector):
    """An agent's awareness of itself: a view of its row, which a component may write."""

    __slots__ = ("_awareness", "_row")

    def __init__(self, id: str, awareness: GroupAwareness, row: int) -> None:
        self.id = id
        self._awareness = awareness
        self._row = row

    @property
    def state(self) -> Array:
        """A copy of the believed state; shape (nx,)."""
        return self._awareness.state_column.row(self._row)

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._awareness.state_column.set_row(self._row, value)

    @property
    def intent(self) -> TimeSeries:
        """Where the agent means to go."""
        return self._awareness.intent.row(self._row)

    @intent.setter
    def intent(self, series: TimeSeries) -> None:
        self._awareness.intent.set_row(self._row, series)

    @property
    def uncertainty(self) -> TimeSeries:
        """How unsure the belief is."""
        return self._awareness.uncertainty.row(self._row)

    @uncertainty.setter
    def uncertainty(self, series: TimeSeries) -> None:
        self._awareness.uncertainty.set_row(self._row, series)

    @property
    def risk(self) -> TimeSeries:
        """How dangerous the situation is."""
        return self._awareness.risk.row(self._row)

    @risk.setter
    def risk(self, series: TimeSeries) -> None:
        self._awareness.risk.set_row(self._row, series)


class AwarenessDatabase(MutableMapping[str, AwarenessVector]):
    """All that one agent is aware of, by id: itself, whom it perceives and whom it heard of.

    Of itself the `state` is that of its model. Of every other it is the motion, whoever perceived it or told of it: the
    position, then the velocity, in the dimensions of the world; NaN where nothing is known. `elements` names them.

    What the agent's own components wrote of another wins over what the group's components share. What another tells of
    its intent and risk stands beside where it is believed to be.

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
        return AwarenessVector(
            id,
            vector.state,
            vector.intent if len(vector.intent) else told.intent,
            vector.uncertainty,
            vector.risk if len(vector.risk) else told.risk,
        )

    def perceived(self, id: str) -> AwarenessVector | None:
        """What perceptions, estimators and the inbox tell of another now, whatever the agent's own components wrote."""
        tracked, world = self._tracked(id), self.world
        if tracked is not None or world is None or id not in world.roster:
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
            return world.roster.ids
        if tracks is None or roster is None:
            return ()
        return [
            roster.ids[other] for other in tracks.others[tracks.pointers[self._row] : tracks.pointers[self._row + 1]]
        ]

    def __setitem__(self, id: str, vector: AwarenessVector) -> None:
        if id == self._own.id:
            self._own.state = vector.state
            self._own.intent, self._own.uncertainty, self._own.risk = vector.intent, vector.uncertainty, vector.risk
            return
        state = self._awareness.motion(id, vector.state)
        self._others[id] = AwarenessVector(id, state, vector.intent, vector.uncertainty, vector.risk)
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
