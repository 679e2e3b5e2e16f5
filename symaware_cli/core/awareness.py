"""Situational awareness: what an agent believes, intends, doubts and fears, of itself and of others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core.column import Column, SeriesColumn, frozen
from symaware_cli.core.motion import as_motion
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
