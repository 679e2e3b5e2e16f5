"""The awareness database: all that one agent is aware of, by id, as the paper has it."""

from __future__ import annotations

from collections.abc import ItemsView, Iterator, Mapping, MutableMapping, Sequence, ValuesView
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.awareness import AwarenessVector, GroupAwareness, SelfAwareness
from symaware_cli.awareness.own_beliefs import OwnBeliefs, Said
from symaware_cli.awareness.part import PARTS
from symaware_cli.awareness.time_series import TimeSeries
from symaware_cli.awareness.tracks import Tracks
from symaware_cli.world.arrays import frozen
from symaware_cli.world.motion import motion_quantities
from symaware_cli.world.snapshot import StatesById
from symaware_cli.world.time import SECOND

if TYPE_CHECKING:
    from symaware_cli.world.snapshot import Snapshot

Array = NDArray[np.float64]

_NOTHING = TimeSeries()
_NO_PART: Mapping[str, Said] = {}

#: The parts that every agent has; of others they are empty where nothing is known.
_EVERYBODYS = frozenset(part.name for part in PARTS)


class OtherAwareness(AwarenessVector):
    """What an agent believes of another: a view that looks it up when it is asked, and writes what is assigned."""

    __slots__ = ("_database",)

    def __init__(self, id: str, database: AwarenessDatabase) -> None:
        self.id = id
        self._database = database

    @property
    def state(self) -> Array:
        """Position and velocity, read-only; shape (2d,).

        Raises:
            KeyError: Nothing is known of it any more.
        """
        database = self._database
        if database._version is not database._awareness.version:
            database._forget()
        try:
            return database._states[self.id]
        except KeyError:
            return database._look_up(self.id)

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self["state"] = value

    def __getitem__(self, name: str) -> Any:
        if name == "state":
            return self.state
        value = self._database.part(name, self.id)
        if value is None:
            raise KeyError(name)
        return value

    def __setitem__(self, name: str, value: ArrayLike | TimeSeries) -> None:
        self._database.set_part(name, self.id, value)

    def __iter__(self) -> Iterator[str]:
        return (name for name in self._database.parts if name in self)

    def __contains__(self, name: object) -> bool:
        return name == "state" or (isinstance(name, str) and self._database.part(name, self.id) is not None)

    def __reduce__(self) -> Any:
        """A copy, and what another process gets, is the value as it is now."""
        return _value, (self.id, dict(self.items()))


def _value(id: str, parts: dict[str, Any]) -> AwarenessVector:
    return AwarenessVector(id, **parts)


class AwarenessDatabase(MutableMapping[str, AwarenessVector]):
    """All that one agent is aware of, by id: itself, whom it perceives and whom it heard of.

    Of itself the `state` is that of its model. Of every other it is the motion, whoever perceived it or told of it: the
    position, then the velocity, in the dimensions of the world; NaN where nothing is known. `elements` names them.

    Nothing is kept for each pair: what is asked of another is looked up in what the group's components share, what the
    agent's own components wrote, and what it was told. `_look_up` and `part` have the rules which of them counts.

    Attributes:
        others: What the agent's own components wrote of others.
        told: What others told of themselves, as of then, by id.
    """

    __slots__ = (
        "_awareness",
        "_keeps",
        "_own",
        "_row",
        "_states",
        "_version",
        "_views",
        "_views_of",
        "_world",
        "others",
        "told",
    )

    def __init__(self, own: SelfAwareness, awareness: GroupAwareness, row: int) -> None:
        self._own = own
        self._awareness = awareness
        self._row = row
        self._world: Snapshot | None = None
        self.others = OwnBeliefs()
        self.told = OwnBeliefs()
        #: The states that were looked up since something changed, or those that all agents share.
        self._states: dict[str, Array] = {}
        self._keeps = True
        self._version: object = None
        #: A view of each whom it knows, itself first, and of what sources these are.
        self._views: dict[str, AwarenessVector] = {own.id: own}
        self._views_of: tuple[object, ...] = ()

    # Which source counts

    def _look_up(self, id: str) -> Array:
        """What the agent's own components wrote wins over what the group's perceive, and that over what is told."""
        state = self.others.motion(id)
        if state is None:
            state = self.perceived(id)
        if state is None:
            state = self.told.motion(id)
        if state is None:
            if id not in self.others and id not in self.told:
                raise KeyError(id)
            roster = self._awareness.roster
            state = np.full(2 * roster.dimensions if roster else 0, np.nan)
        if self._keeps:
            self._states[id] = state
        return state

    def part(self, name: str, id: str) -> Said | None:
        """What is believed of a part of another other than its state: a series, which may be empty, or a vector.

        What the agent's own components wrote counts first. What was told stands beside where another is believed to be,
        unless the latest counts of the part: then it comes from the same source as the state. None where nothing is
        known, and the part is none that everybody has.
        """
        own = self.others.parts.get(name, _NO_PART).get(id)
        if own is not None:
            return own
        part, empty = self._awareness.parts.get(name), _NOTHING if name in _EVERYBODYS else None
        if part is not None and part.merge == "latest":
            if id in self.others.places:
                return empty
            tracks, place = self._awareness.tracks, self._place(id)
            if tracks is not None and place is not None:
                if name != "uncertainty" or tracks.covariances is None:
                    return empty
                return TimeSeries.sampled([tracks.time], tracks.covariances[place].reshape(1, -1))
            if self.world is not None and id in self.world:
                return empty
        return self.told.parts.get(name, _NO_PART).get(id, empty)

    @property
    def parts(self) -> Sequence[str]:
        """The names of all parts that something may be believed of, the declared ones first."""
        declared = self._awareness.parts
        return [*declared, *sorted({*self.others.parts, *self.told.parts}.difference(declared))]

    def held_part(self, name: str) -> dict[str, TimeSeries]:
        """What it holds of a part of other agents by itself and what counts, by id in the roster's order.

        A vector is given as a series of one point, now.
        """
        roster, own, told = (
            self._awareness.roster,
            self.others.parts.get(name, _NO_PART),
            self.told.parts.get(name, _NO_PART),
        )
        found: dict[str, TimeSeries] = {}
        if roster is None:
            return found
        for id in sorted({*own, *told}.intersection(roster.indices), key=roster.indices.__getitem__):
            value = self.part(name, id)
            if value is not None and (value is own.get(id) or value is told.get(id)):
                found[id] = value if isinstance(value, TimeSeries) else TimeSeries.sampled([self._now], value[None])
        return found

    def _shared(self) -> dict[str, Array] | None:
        """The states of everybody in one mapping that is not this agent's alone, where that is all that counts."""
        if self.others.rows is not None:
            return self.others.rows
        world = self.world
        if world is None or self.others.places or self._awareness.tracks is not None:
            return None
        return world.motions

    def _forget(self) -> None:
        """Look everything up anew, because a source has changed."""
        self._version = self._awareness.version
        shared = self._shared()
        self._keeps = shared is None
        self._states = {} if shared is None else shared

    def _changed(self, *parts: str) -> None:
        """This agent holds something else by itself."""
        awareness, row = self._awareness, self._row
        changed = awareness.others_changed
        for part in parts:
            if part == "state":
                awareness.holders.add(row)
            if part in changed:
                changed[part].add(row)
            else:
                changed[part] = {row}
        self._version = None

    # What the group's components tell

    @property
    def world(self) -> Snapshot | None:
        """The snapshot of the whole world that this agent knows, if it perceives everything."""
        return self._world or self._awareness.world

    @world.setter
    def world(self, snapshot: Snapshot | None) -> None:
        self._world = snapshot
        self._changed("state")

    def perceived(self, id: str) -> Array | None:
        """The motion of another as the group's components tell it, whatever the own ones wrote; None if they do not."""
        place = self._place(id)
        if place is not None:
            motion: Array = self._awareness.tracks.motions[place]  # type: ignore[union-attr]
            return motion
        world = self.world
        return None if world is None else world.motions.get(id)

    def _place(self, id: str) -> int | None:
        """The row of the group's tracks that tells of another."""
        tracks, roster = self._awareness.tracks, self._awareness.roster
        index = None if tracks is None or roster is None else roster.indices.get(id)
        if index is None:
            return None
        others = self._tracked()
        place = int(np.searchsorted(others, index))
        if place == len(others) or others[place] != index:
            return None
        return int(tracks.pointers[self._row]) + place  # type: ignore[union-attr]

    @property
    def held(self) -> tuple[OwnBeliefs, Snapshot | None, OwnBeliefs]:
        """All that this agent holds by itself, for another process."""
        return self.others, self._world, self.told

    @held.setter
    def held(self, held: tuple[OwnBeliefs, Snapshot | None, OwnBeliefs]) -> None:
        self.others, self._world, self.told = held
        self._version = None

    def tracks(self, now: int) -> Tracks:
        """What it believes of where the other agents are, in columns; the state of `items`, with covariances and ages.

        Args:
            now: The instant that ages are counted to, in nanoseconds.
        """
        tracks, world, roster = self._awareness.tracks, self.world, self._awareness.roster
        if roster is None:
            raise RuntimeError("nobody is in a world yet")
        width = 2 * roster.dimensions
        others = [id for id in self._known() if id in roster and id != self._own.id]
        count = len(others)
        motions, covariances = np.full((count, width), np.nan), np.zeros((count, width, width))
        instants = np.full(count, now, np.int64)
        held, told = [], []
        tracked, places = [], []
        perceived = []
        own, said = self.others.places, self.told.places
        for row, id in enumerate(others):
            if id in own:
                held.append(row)
            elif tracks is not None and (place := self._place(id)) is not None:
                tracked.append(row)
                places.append(place)
            elif world is not None and id in world:
                perceived.append(row)
            elif id in said:
                told.append(row)
        for table, rows in ((self.others, held), (self.told, told)):
            if rows:
                chosen = np.fromiter((table.places[others[row]] for row in rows), np.intp, len(rows))
                motions[rows], instants[rows] = table.motions(chosen), table.times(chosen)
        if tracked and tracks is not None:
            motions[tracked], instants[tracked] = tracks.motions[places], tracks.instants[places]
            if tracks.covariances is not None:
                covariances[tracked] = tracks.covariances[places]
        if perceived and world is not None:
            indices = [roster.index(others[row]) for row in perceived]
            motions[perceived] = np.concatenate([world.positions[indices], world.velocities[indices]], axis=1)
            instants[perceived] = world.time
        return Tracks(
            now,
            np.array([0, count]),
            np.fromiter((roster.indices[id] for id in others), np.intp, count),
            motions[:, : width // 2],
            motions[:, width // 2 :],
            covariances=covariances if tracks is not None and tracks.covariances is not None and tracked else None,
            ages=(now - instants) / SECOND,
        )

    # Writing

    @property
    def _now(self) -> int:
        clock = self._awareness.clock
        return 0 if clock is None else clock.now

    def set_state(self, id: str, state: ArrayLike, *, is_state: bool = False) -> None:
        """Believe that another is somewhere; what else is believed of it stays.

        Args:
            id: Whom.
            state: Its motion, the state of its model, or its position.
            is_state: Whether as many numbers as the state of the model has are one, even if a motion has as many.

        Raises:
            ValueError: It is none of these.
        """
        self.others.set_motion(id, self._awareness.motion(id, state, is_state=is_state), self._now)
        self._changed("state")

    def set_states(self, states: Mapping[str, ArrayLike]) -> None:
        """Believe what a perception returns: states by id, as the models have them; also of oneself.

        Raises:
            ValueError: One is neither a motion, nor a state of its model, nor a position.
        """
        own, roster = self._own.id, self._awareness.roster
        if isinstance(states, StatesById) and states.snapshot.present is None:
            places, motions, rows = states.snapshot.roster.indices, states.motions, states.rows
        elif roster is not None and (table := roster.motions(states)) is not None:
            places, motions, rows = table
        else:
            for id, state in states.items():
                if id == own:
                    self._own.state = state
                else:
                    self.set_state(id, state, is_state=True)
            return
        if own in places:
            self._awareness.state_column.set_row(self._row, states[own])
        self.others.set_motions(places, motions, rows, self._now)
        self._changed("state")

    def set_part(self, name: str, id: str, value: ArrayLike | TimeSeries) -> None:
        """Believe a part of another; what else is believed of it stays."""
        if name == "state":
            self.set_state(id, value)  # type: ignore[arg-type]
        elif self.others.set_part(name, id, value if isinstance(value, TimeSeries) else frozen(value)):
            self._changed(name)

    def hear(self, vector: AwarenessVector, time: int, *, alone: bool) -> None:
        """Keep what another told.

        Args:
            vector: What it told; its state as a motion.
            time: When that was sent, in nanoseconds.
            alone: Whether nothing else tells where it is.
        """
        told = self.told
        told.set_motion(vector.id, vector.state, time)
        changed = [name for name, value in vector.items() if name != "state" and told.set_part(name, vector.id, value)]
        self._changed(*(["state", *changed] if alone else changed))

    def forget(self, id: str) -> None:
        """Forget what another told."""
        if id in self.told:
            self.told.remove(id)
            self._changed(*self.told.parts)

    def __setitem__(self, id: str, vector: AwarenessVector) -> None:
        if id == self._own.id:
            for name, value in vector.items():
                self._own[name] = value
            return
        for name, value in list(vector.items()):
            self.set_part(name, id, value)

    def __delitem__(self, id: str) -> None:
        self.others.remove(id)
        self._changed("state", *self.others.parts)

    # Reading

    def __getitem__(self, id: str) -> AwarenessVector:
        return self._known()[id]

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

    def _known(self) -> dict[str, AwarenessVector]:
        """A view of each whom it knows: itself, whom the group's components tell of in the roster's order, others."""
        awareness, held, told = self._awareness, self.others, self.told
        world = self._world or awareness._world
        shared = awareness.tracks if world is None else world.roster if world.present is None else world
        sources = (shared, held.version, told.version)
        if sources != self._views_of:
            known: Sequence[str] = ()
            if world is not None:
                known = world.ids
            elif awareness.tracks is not None and awareness.roster is not None:
                ids = awareness.roster.ids
                known = [ids[other] for other in self._tracked().tolist()]
            ids = (*known, *sorted({*held, *told}.difference(known)))
            # Not changed in place, because somebody may be going through them.
            views, own = self._views, self._own.id
            self._views = {own: self._own}
            if len(views) == 1:
                self._views.update(zip(ids, map(OtherAwareness, ids, repeat(self)), strict=True))
            else:
                self._views.update((id, views.get(id) or OtherAwareness(id, self)) for id in ids)
            self._views[own] = self._own
            self._views_of = sources
        return self._views

    def _tracked(self) -> NDArray[np.intp]:
        """Whom the group's tracks tell of, as indices in the roster, ascending; shape (k,)."""
        tracks = self._awareness.tracks
        if tracks is None:
            return np.empty(0, np.intp)
        return tracks.others[tracks.pointers[self._row] : tracks.pointers[self._row + 1]]

    def items(self) -> ItemsView[str, AwarenessVector]:
        """Whom it knows, itself first, each with a view of what it believes; no object is made for it."""
        return self._known().items()

    def values(self) -> ValuesView[AwarenessVector]:
        """A view of what it believes of each whom it knows, itself first."""
        return self._known().values()

    def __iter__(self) -> Iterator[str]:
        return iter(self._known())

    def __len__(self) -> int:
        return len(self._known())

    def __contains__(self, id: object) -> bool:
        return id in self._known()
