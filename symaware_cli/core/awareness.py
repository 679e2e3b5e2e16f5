"""Situational awareness: what an agent believes, intends, doubts and fears, of itself and of others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core.column import Column, SeriesColumn, frozen
from symaware_cli.core.motion import as_motion
from symaware_cli.core.part import PARTS, Part, PartColumn
from symaware_cli.core.reading import Reading
from symaware_cli.core.series import TimeSeries
from symaware_cli.core.tracks import Tracks

if TYPE_CHECKING:
    from symaware_cli.core.world import Roster, Snapshot

Array = NDArray[np.float64]

#: Nothing is said; it cannot be changed.
_EMPTY = TimeSeries()


class AwarenessVector:
    """The situational awareness of one agent, as a plain value: of each part what it says, by the part's name.

    ``vector["attention"]`` reads and writes a part; those that every agent has are attributes, too. A part that
    nothing is said of is an empty `TimeSeries` where every agent has it, else a `KeyError`.

    Attributes:
        id: Whom it is about.
    """

    __slots__ = ("_values", "id")

    def __init__(
        self,
        id: str,
        state: ArrayLike,
        intent: TimeSeries | None = None,
        uncertainty: TimeSeries | None = None,
        risk: TimeSeries | None = None,
        **parts: ArrayLike | TimeSeries,
    ) -> None:
        self.id = id
        self._values: dict[str, Array | TimeSeries] = {
            "state": frozen(state),
            "intent": _EMPTY if intent is None else intent,
            "uncertainty": _EMPTY if uncertainty is None else uncertainty,
            "risk": _EMPTY if risk is None else risk,
        }
        for name, value in parts.items():
            self._values[name] = value if isinstance(value, TimeSeries) else frozen(value)

    def __getitem__(self, name: str) -> Any:
        """What a part says: a vector, shape (k,), or a `TimeSeries`."""
        return self._values[name]

    def __setitem__(self, name: str, value: ArrayLike | TimeSeries) -> None:
        self._values[name] = value if isinstance(value, TimeSeries) else frozen(value)

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def items(self) -> Iterator[tuple[str, Any]]:
        """Each part that something may be said of: its name, and what it says."""
        return ((name, self[name]) for name in self)

    def replaced(self, **parts: ArrayLike | TimeSeries) -> AwarenessVector:
        """A plain value that says the same, but for some parts."""
        return AwarenessVector(self.id, **{**dict(self.items()), **parts})

    @property
    def state(self) -> Array:
        """The believed state; shape (nx,)."""
        state: Array = self["state"]
        return state

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self["state"] = value

    @property
    def intent(self) -> TimeSeries:
        """Where it means to go."""
        series: TimeSeries = self["intent"]
        return series

    @intent.setter
    def intent(self, series: TimeSeries) -> None:
        self["intent"] = series

    @property
    def uncertainty(self) -> TimeSeries:
        """How unsure the belief is."""
        series: TimeSeries = self["uncertainty"]
        return series

    @uncertainty.setter
    def uncertainty(self, series: TimeSeries) -> None:
        self["uncertainty"] = series

    @property
    def risk(self) -> TimeSeries:
        """How dangerous the situation is."""
        series: TimeSeries = self["risk"]
        return series

    @risk.setter
    def risk(self, series: TimeSeries) -> None:
        self["risk"] = series

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.id!r}, state={np.array2string(self.state, precision=4)})"


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
        parts: What parts it has, by name.
        columns: The column of each part, by name: a row of numbers for each agent, or a series for each.
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
        "columns",
        "observation",
        "others_changed",
        "parts",
        "readings",
        "roster",
        "seen",
        "state_column",
        "told",
        "world",
    )

    def __init__(self, state: Array, name: str = "", parts: Iterable[Part] = ()) -> None:
        """Begin with a belief of each state, and nothing else.

        Args:
            state: What each agent believes; shape (n, nx).
            name: The group's.
            parts: Those beside the ones that every group has.

        Raises:
            ValueError: A vector has no columns.
        """
        self.parts = {part.name: part for part in (*PARTS, *parts)}
        self.state_column = Column(state)
        self.columns: dict[str, PartColumn] = {
            part.name: self.state_column if part.name == "state" else part.column(len(state))
            for part in self.parts.values()
        }
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

    def __getitem__(self, name: str) -> Any:
        """A part of all agents: the read-only array of a vector, shape (n, k); the column of a series, to be `set`."""
        column = self._column(name)
        return column.values if isinstance(column, Column) else column

    def __setitem__(self, name: str, values: ArrayLike) -> None:
        """Replace a vector of all agents; shape (n, k)."""
        column = self._column(name)
        if not isinstance(column, Column):
            raise TypeError(f"the part `{name}` is a series for each agent: `awareness[{name!r}].set(times, values)`")
        column.values = values

    def _column(self, name: str) -> PartColumn:
        column = self.columns.get(name)
        if column is None:
            raise KeyError(
                f"there is no part `{name}`, only {', '.join(self.columns)}: a component declares the parts it writes"
            )
        return column

    @property
    def state(self) -> Array:
        """What each agent believes of its own state, read-only; shape (n, nx)."""
        return self.state_column.values

    @state.setter
    def state(self, values: ArrayLike) -> None:
        self.state_column.values = values

    @property
    def intent(self) -> SeriesColumn:
        """Where each agent means to go."""
        return self.columns["intent"]  # type: ignore[return-value]

    @property
    def uncertainty(self) -> SeriesColumn:
        """How unsure each belief is."""
        return self.columns["uncertainty"]  # type: ignore[return-value]

    @property
    def risk(self) -> SeriesColumn:
        """How dangerous the situation of each agent is."""
        return self.columns["risk"]  # type: ignore[return-value]


class SelfAwareness(AwarenessVector):
    """An agent's awareness of itself: a view of its row, which a component may write."""

    __slots__ = ("_awareness", "_row")

    def __init__(self, id: str, awareness: GroupAwareness, row: int) -> None:
        self.id = id
        self._awareness = awareness
        self._row = row

    def __getitem__(self, name: str) -> Any:
        """What a part says: a copy of a vector, shape (k,), or a `TimeSeries`."""
        return self._awareness._column(name).row(self._row)

    def __setitem__(self, name: str, value: ArrayLike | TimeSeries) -> None:
        self._awareness._column(name).set_row(self._row, value)  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[str]:
        return iter(self._awareness.columns)

    def __contains__(self, name: object) -> bool:
        return name in self._awareness.columns
