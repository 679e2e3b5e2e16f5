"""Situational awareness: what an agent believes, intends, doubts and fears, of itself and of others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.column import Column, SeriesColumn
from symaware_cli.awareness.part import PARTS, Part, PartColumn
from symaware_cli.awareness.series import TimeSeries
from symaware_cli.awareness.shared_beliefs import SharedBeliefs
from symaware_cli.awareness.tracks import Tracks
from symaware_cli.world.arrays import frozen
from symaware_cli.world.reading import Reading

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


class GroupAwareness(SharedBeliefs):
    """The awareness that the agents of a group have: of themselves as columns, of others sparsely.

    Attributes:
        columns: The column of each part, by name: a row of numbers for each agent, or a series for each.
        observation: What perception measured last, for those who estimate.
        readings: What further sensors measured last, by the name of the component, for those who use it.
    """

    __slots__ = ("columns", "observation", "readings", "state_column")

    def __init__(self, state: Array, name: str = "", parts: Iterable[Part] = ()) -> None:
        """Begin with a belief of each state, and nothing else.

        Args:
            state: What each agent believes; shape (n, nx).
            name: The group's.
            parts: Those beside the ones that every group has.

        Raises:
            ValueError: A vector has no columns.
        """
        super().__init__(len(state), name, (*PARTS, *parts))
        self.state_column = Column(state)
        self.columns: dict[str, PartColumn] = {
            part.name: self.state_column if part.name == "state" else part.column(len(state))
            for part in self.parts.values()
        }
        self.observation: Observation | None = None
        self.readings: dict[str, Reading] = {}

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
