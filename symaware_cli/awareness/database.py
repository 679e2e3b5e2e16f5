"""The awareness database of one agent: its awareness of itself and of others, by id."""

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
from symaware_cli.awareness.value_range import FINITE, ValueRange, require_within
from symaware_cli.world import SECOND, StatesById, frozen, motion_quantities

if TYPE_CHECKING:
    from symaware_cli.world import Snapshot

Array = NDArray[np.float64]

#: The motion of others; NaN where it is not known.
_MOTION = ValueRange(nan=True)

_NOTHING = TimeSeries()
_NO_PART: Mapping[str, Said] = {}

#: The parts that every agent has; of others they are empty if nothing is known.
_EVERYBODYS = frozenset(part.name for part in PARTS)


class OtherAwareness(AwarenessVector):
    """The beliefs of an agent about another one: a view that reads and writes the present beliefs."""

    __slots__ = ("_database",)

    def __init__(self, id: str, database: AwarenessDatabase) -> None:
        self.id = id
        self._database = database

    @property
    def state(self) -> Array:
        """Position and velocity, read-only; shape (2d,).

        Raises:
            KeyError: The other agent is not known any more.
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
        """Copy and pickle the present values instead of the view."""
        return _value, (self.id, dict(self.items()))


def _value(id: str, parts: dict[str, Any]) -> AwarenessVector:
    return AwarenessVector(id, **parts)


class AwarenessDatabase(MutableMapping[str, AwarenessVector]):
    """The awareness of one agent of itself and of the others that it perceives or receives messages about, by id.

    The `state` of the agent itself is a state of its model.

    The `state` of every other agent is its motion, from any source: the position, then the velocity, in the dimensions
    of the world; NaN where nothing is known. `elements` returns them by name. Nothing is stored for each pair of
    agents: a value is looked up in the beliefs that the group's components share, in those that the agent's own
    components wrote, and in received messages. `_look_up` and `part` define which of these takes precedence.

    Attributes:
        others: The beliefs about others that the agent's own components wrote.
        received: The values that others sent about themselves, for the time of sending, by id.
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
        "received",
    )

    def __init__(self, own: SelfAwareness, awareness: GroupAwareness, row: int) -> None:
        self._own = own
        self._awareness = awareness
        self._row = row
        self._world: Snapshot | None = None
        self.others = OwnBeliefs()
        self.received = OwnBeliefs()
        #: The states that were looked up since the last change, or those that all agents share.
        self._states: dict[str, Array] = {}
        self._keeps = True
        self._version: object = None
        #: A view of each known agent, itself first, and the version of the sources that they are made from.
        self._views: dict[str, AwarenessVector] = {own.id: own}
        self._views_of: tuple[object, ...] = ()

    # Precedence of the sources

    def _look_up(self, id: str) -> Array:
        """The agent's own components take precedence over those of the group, and these over received messages."""
        state = self.others.motion(id)
        if state is None:
            state = self.perceived(id)
        if state is None:
            state = self.received.motion(id)
        if state is None:
            if id not in self.others and id not in self.received:
                raise KeyError(id)
            roster = self._awareness.roster
            state = np.full(2 * roster.dimensions if roster else 0, np.nan)
        if self._keeps:
            self._states[id] = state
        return state

    def part(self, name: str, id: str) -> Said | None:
        """Return the belief about a part of another agent, except its state: a series, maybe empty, or a vector.

        Values written by the agent's own components take precedence. Received values are used even if the state has
        another source, unless `Part.merge` is ``latest``: then they must have the same source. Returns None if nothing
        is known of a part that not every agent has.
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
        return self.received.parts.get(name, _NO_PART).get(id, empty)

    @property
    def parts(self) -> Sequence[str]:
        """The names of all parts that may have values, the declared ones first."""
        declared = self._awareness.parts
        return [*declared, *sorted({*self.others.parts, *self.received.parts}.difference(declared))]

    def held_part(self, name: str) -> dict[str, TimeSeries]:
        """Return the own values in effect of a part of other agents, by id in the roster's order.

        A vector is returned as a series with one point, now.
        """
        roster, own, received = (
            self._awareness.roster,
            self.others.parts.get(name, _NO_PART),
            self.received.parts.get(name, _NO_PART),
        )
        found: dict[str, TimeSeries] = {}
        if roster is None:
            return found
        for id in sorted({*own, *received}.intersection(roster.indices), key=roster.indices.__getitem__):
            value = self.part(name, id)
            if value is not None and (value is own.get(id) or value is received.get(id)):
                found[id] = value if isinstance(value, TimeSeries) else TimeSeries.sampled([self._now], value[None])
        return found

    def _shared(self) -> dict[str, Array] | None:
        """Return the states of all agents in one shared mapping, if no other source has to be considered."""
        if self.others.rows is not None:
            return self.others.rows
        world = self.world
        if world is None or self.others.places or self._awareness.tracks is not None:
            return None
        return world.motions

    def _forget(self) -> None:
        """Clear the cache, because a source has changed."""
        self._version = self._awareness.version
        shared = self._shared()
        self._keeps = shared is None
        self._states = {} if shared is None else shared

    def _changed(self, *parts: str) -> None:
        """Note that this agent's own beliefs changed."""
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

    # Beliefs from the group's components

    @property
    def world(self) -> Snapshot | None:
        """The snapshot of the whole world that this agent knows, if it perceives everything."""
        return self._world or self._awareness.world

    @world.setter
    def world(self, snapshot: Snapshot | None) -> None:
        self._world, self._version = snapshot, None
        self._awareness.holders.add(self._row)
        self._awareness.others_changed["state"].add(self._row)

    def see(self, snapshot: Snapshot) -> None:
        """Believe the true states of all agents, that of the agent itself included.

        Raises:
            KeyError: The agent is absent.
        """
        self.world = snapshot
        self._awareness.state_column.set_row(self._row, snapshot.state(self._own.id))

    def sees_all(self, now: int) -> bool:
        """Whether the agent believes the true states of all agents at an instant, in nanoseconds, and nothing else."""
        world = self._world or self._awareness.world
        return world is not None and world.time == now and not self.others.places

    def perceived(self, id: str) -> Array | None:
        """Return the motion of another by the group's components, without the agent's own; None if unknown."""
        place = self._place(id)
        if place is not None:
            motion: Array = self._awareness.tracks.motions[place]  # type: ignore[union-attr]
            return motion
        world = self.world
        return None if world is None else world.motions.get(id)

    def _place(self, id: str) -> int | None:
        """Return the row of the group's tracks for another agent."""
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
        """Return all beliefs that this agent holds itself, for another process."""
        return self.others, self._world, self.received

    @held.setter
    def held(self, held: tuple[OwnBeliefs, Snapshot | None, OwnBeliefs]) -> None:
        self.others, self._world, self.received = held
        self._version = None

    def tracks(self, now: int) -> Tracks:
        """Return the believed motion of the other agents in columns: the states of `items`, with covariances and ages.

        Args:
            now: The time that ages refer to, in nanoseconds.
        """
        tracks, world, roster = self._awareness.tracks, self.world, self._awareness.roster
        if roster is None:
            raise RuntimeError("the agents are not in a world yet")
        width = 2 * roster.dimensions
        others = [id for id in self._known() if id in roster and id != self._own.id]
        count = len(others)
        motions, covariances = np.full((count, width), np.nan), np.zeros((count, width, width))
        instants = np.full(count, now, np.int64)
        held, received = [], []
        tracked, places = [], []
        perceived = []
        own, said = self.others.places, self.received.places
        for row, id in enumerate(others):
            if id in own:
                held.append(row)
            elif tracks is not None and (place := self._place(id)) is not None:
                tracked.append(row)
                places.append(place)
            elif world is not None and id in world:
                perceived.append(row)
            elif id in said:
                received.append(row)
        for table, rows in ((self.others, held), (self.received, received)):
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
        """Set the believed motion of another agent; other beliefs about it are kept.

        Args:
            id: The id of the other agent.
            state: Its motion, the state of its model, or its position.
            is_state: Whether to interpret the numbers as a state of the model if a motion has the same length.

        Raises:
            ValueError: It is none of these, or infinite.
        """
        motion = self._awareness.motion(id, state, is_state=is_state)
        require_within(_MOTION, motion, f"the state of {id}")
        self.others.set_motion(id, motion, self._now)
        self._changed("state")

    def set_states(self, states: Mapping[str, ArrayLike]) -> None:
        """Set the states that a perception returned, by id in the order of the models, including the agent's own.

        Raises:
            ValueError: One is neither a motion, nor a state of its model, nor a position, or infinite.
        """
        own, roster = self._own.id, self._awareness.roster
        if type(states) is StatesById and states.snapshot.present is None:
            places, motions, rows = states.snapshot.roster.indices, states.motions, states.rows
        elif roster is not None and (table := roster.motions(states, _check_motions)) is not None:
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
        """Set a part of another agent; other beliefs about it are kept.

        Raises:
            ValueError: The value is not finite, and the part does not declare that.
        """
        if name == "state":
            self.set_state(id, value)  # type: ignore[arg-type]
            return
        value = value if isinstance(value, TimeSeries) else frozen(value)
        part = self._awareness.parts.get(name)
        require_within(FINITE if part is None else part.bounds, value, f"the {name} of {id}")
        if self.others.set_part(name, id, value):
            self._changed(name)

    def receive(self, vector: AwarenessVector, time: int, *, alone: bool) -> None:
        """Store what another agent sent about itself.

        Args:
            vector: The received awareness, with its state as a motion.
            time: The time of sending, in nanoseconds.
            alone: Whether there is no other source for its position.
        """
        received = self.received
        received.set_motion(vector.id, vector.state, time)
        changed = [
            name for name, value in vector.items() if name != "state" and received.set_part(name, vector.id, value)
        ]
        self._changed(*(["state", *changed] if alone else changed))

    def receive_part(self, name: str, id: str, value: TimeSeries) -> None:
        """Store a part of another agent as if it had sent it; other beliefs about it are kept."""
        received = self.received
        if (len(value) or id in received.parts.get(name, _NO_PART)) and received.set_part(name, id, value):
            self._changed(name)

    def forget(self, id: str) -> None:
        """Forget what another agent sent."""
        if id in self.received:
            self.received.remove(id)
            self._changed(*self.received.parts)

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
        """Return the believed state of an agent, by the names of its elements.

        Raises:
            KeyError: The agent is not known.
        """
        roster, state = self._awareness.roster, self[id].state
        if roster is None:
            return {}
        model = roster.model(id)
        own = model is not None and id == self._own.id
        quantities = model.state if model is not None and own else motion_quantities(roster.dimensions)
        return {quantity.name: float(value) for quantity, value in zip(quantities, state, strict=True)}

    def _known(self) -> dict[str, AwarenessVector]:
        """A view of each known agent: itself, those known by the group's components in the roster's order, others."""
        awareness, held, received = self._awareness, self.others, self.received
        world = self._world or awareness._world
        shared = awareness.tracks if world is None else world.roster if world.present is None else world
        sources = (shared, held.version, received.version)
        if sources != self._views_of:
            known: Sequence[str] = ()
            if world is not None:
                known = world.ids
            elif awareness.tracks is not None and awareness.roster is not None:
                ids = awareness.roster.ids
                known = [ids[other] for other in self._tracked().tolist()]
            ids = (*known, *sorted({*held, *received}.difference(known)))
            # Not changed in place, because a caller may be iterating over it.
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
        """The agents in the group's tracks, as indices in the roster, ascending; shape (k,)."""
        tracks = self._awareness.tracks
        if tracks is None:
            return np.empty(0, np.intp)
        return tracks.others[tracks.pointers[self._row] : tracks.pointers[self._row + 1]]

    def items(self) -> ItemsView[str, AwarenessVector]:
        """The known agents, itself first, each with a view of the beliefs about it."""
        return self._known().items()

    def values(self) -> ValuesView[AwarenessVector]:
        """A view of the beliefs about each known agent, itself first."""
        return self._known().values()

    def __iter__(self) -> Iterator[str]:
        return iter(self._known())

    def __len__(self) -> int:
        return len(self._known())

    def __contains__(self, id: object) -> bool:
        return id in self._known()


def _check_motions(motions: Array) -> None:
    """Refuse states of others that are infinite."""
    require_within(_MOTION, motions, "the state of another agent")
