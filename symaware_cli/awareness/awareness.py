"""Situational awareness: the believed states, intents, uncertainties and risks, of oneself and of others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.column import Column, TableColumn
from symaware_cli.awareness.part import PARTS, Part
from symaware_cli.awareness.series_column import SeriesColumn
from symaware_cli.awareness.shared_beliefs import SharedBeliefs
from symaware_cli.awareness.signal import Signal, SignalColumn
from symaware_cli.awareness.time_series import TimeSeries
from symaware_cli.awareness.tracks import Tracks
from symaware_cli.awareness.value_range import FINITE, ValueRange, require_within
from symaware_cli.world import FARTHEST, Reading, frozen, record

Array = NDArray[np.float64]

#: A series without values; it cannot be changed.
_EMPTY = TimeSeries()


class AwarenessVector:
    """The situational awareness of one agent, as a plain value: the values of its parts by name.

    ``vector["attention"]`` reads and writes a part; those that every agent has are attributes as well. A part without a
    value is an empty `TimeSeries` if every agent has it, else reading it raises a `KeyError`.

    Attributes:
        id: The id of the agent that it describes.
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
        """The value of a part: a vector, shape (k,), or a `TimeSeries`."""
        return self._values[name]

    def __setitem__(self, name: str, value: ArrayLike | TimeSeries) -> None:
        self._values[name] = value if isinstance(value, TimeSeries) else frozen(value)

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def items(self) -> Iterator[tuple[str, Any]]:
        """The parts with their names and values."""
        return ((name, self[name]) for name in self)

    def replaced(self, **parts: ArrayLike | TimeSeries) -> AwarenessVector:
        """Return a copy with some parts replaced."""
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
        """The intended motion."""
        series: TimeSeries = self["intent"]
        return series

    @intent.setter
    def intent(self, series: TimeSeries) -> None:
        self["intent"] = series

    @property
    def uncertainty(self) -> TimeSeries:
        """The uncertainty of the belief."""
        series: TimeSeries = self["uncertainty"]
        return series

    @uncertainty.setter
    def uncertainty(self, series: TimeSeries) -> None:
        self["uncertainty"] = series

    @property
    def risk(self) -> TimeSeries:
        """The risk of the situation."""
        series: TimeSeries = self["risk"]
        return series

    @risk.setter
    def risk(self, series: TimeSeries) -> None:
        self["risk"] = series

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.id!r}, state={np.array2string(self.state, precision=4)})"


@record
class Observation:
    """The measurements of a perception in one step, before an estimator processes them.

    Attributes:
        time: The time of the measurement, in nanoseconds; earlier than now if the perception has a delay.
        state: The agents' own states, or None if they were not measured; shape (n, nx).
        state_deviation: Standard deviation of each element of them; shape (nx,).
        tracks: The measured motion of the others that were seen.
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
        """Return whether this is the same measurement as another, which may come from another process."""
        if self is other:
            return True
        if other is None or self.time != other.time:
            return False
        own = self.state is other.state or (
            self.state is not None and other.state is not None and np.array_equal(self.state, other.state)
        )
        return own and self.tracks.repeats(other.tracks)


class GroupAwareness(SharedBeliefs):
    """The awareness of the agents of a group: of themselves in columns, of others sparsely.

    Attributes:
        columns: The column of each part and signal, by name: a row of numbers, a series or a table for each agent.
        observation: The latest measurements of the perception, for estimators.
        readings: The latest scans and images of sensors, by the name of the component.
        signals: The signals of components, by component and name, such as ``radar.returns``.
    """

    __slots__ = ("columns", "observation", "readings", "signals", "state_column")

    def __init__(
        self, state: Array, name: str = "", parts: Iterable[Part] = (), signals: Mapping[str, Signal] | None = None
    ) -> None:
        """Start with a belief of each state, and all other parts empty.

        Args:
            state: The belief of each agent of its own state; shape (n, nx).
            name: The name of the group.
            parts: The parts in addition to those that every group has.
            signals: The signals of components, by component and name.

        Raises:
            ValueError: A vector or a table has no columns.
        """
        super().__init__(len(state), name, (*PARTS, *parts))
        self.state_column = Column(state, ValueRange(FARTHEST))
        self.columns: dict[str, SignalColumn] = {
            part.name: self.state_column if part.name == "state" else part.column(len(state))
            for part in self.parts.values()
        }
        self.signals: dict[str, Signal] = {}
        self.declare(signals or {})
        self.observation: Observation | None = None
        self.readings: dict[str, Reading] = {}

    def check(self, vector: AwarenessVector) -> None:
        """Check that a value of the parts is within their bounds, before it is sent to others.

        Raises:
            ValueError: It is not.
        """
        for name, value in vector.items():
            part = self.parts.get(name)
            require_within(FINITE if part is None else part.bounds, value, f"the {name} of {vector.id}")

    def declare(self, signals: Mapping[str, Signal]) -> None:
        """Create the columns of signals, given by component and name.

        Raises:
            ValueError: A vector or a table has no columns.
        """
        self.columns |= {name: signal.column(len(self.state)) for name, signal in signals.items()}
        self.signals |= signals

    def __getitem__(self, name: str) -> Any:
        """A part or signal of all agents.

        For a vector the array, shape (n, k), for a table a list with a table of each agent, shape (m, k), both
        read-only; for a series the column, which can be `set`.
        """
        match column := self._column(name):
            case Column():
                return column.values
            case TableColumn():
                return column.tables
        return column

    def __setitem__(self, name: str, values: Any) -> None:
        """Replace a vector of all agents, shape (n, k), or a table of each, shape (m, k)."""
        match column := self._column(name):
            case Column():
                column.values = values
            case TableColumn():
                column.set(values)
            case _:
                raise TypeError(f"`{name}` is a series for each agent: `awareness[{name!r}].set(times, values)`")

    def _column(self, name: str) -> SignalColumn:
        column = self.columns.get(name)
        if column is None:
            there = ", ".join(self.columns)
            raise KeyError(f"there is no part or signal `{name}`, only {there}: a component declares what it writes")
        return column

    @property
    def state(self) -> Array:
        """The belief of each agent of its own state, read-only; shape (n, nx)."""
        return self.state_column.values

    @state.setter
    def state(self, values: ArrayLike) -> None:
        self.state_column.values = values

    @property
    def intent(self) -> SeriesColumn:
        """The intended motion of each agent."""
        return self.columns["intent"]  # type: ignore[return-value]

    @property
    def uncertainty(self) -> SeriesColumn:
        """The uncertainty of each belief."""
        return self.columns["uncertainty"]  # type: ignore[return-value]

    @property
    def risk(self) -> SeriesColumn:
        """The risk of each agent's situation."""
        return self.columns["risk"]  # type: ignore[return-value]


class SelfAwareness(AwarenessVector):
    """An agent's awareness of itself: a view of its row, which components may write.

    Signals can be read and written by name as well, but they are not part of awareness: they are not sent to others.
    """

    __slots__ = ("_awareness", "_row")

    def __init__(self, id: str, awareness: GroupAwareness, row: int) -> None:
        self.id = id
        self._awareness = awareness
        self._row = row

    def __getitem__(self, name: str) -> Any:
        """The value of a part or signal: a copy of a vector, shape (k,), a `TimeSeries`, or a table, shape (m, k)."""
        return self._awareness._column(name).row(self._row)

    def __setitem__(self, name: str, value: ArrayLike | TimeSeries) -> None:
        # Looked up directly, because components of single agents write often.
        column = self._awareness.columns.get(name) or self._awareness._column(name)
        column.set_row(self._row, value)  # type: ignore[arg-type]

    # Written by many components of single agents in each turn, so without a search for the column.

    @property
    def state(self) -> Array:
        """A copy of the agent's belief of its own state; shape (nx,)."""
        return self._awareness.state_column.row(self._row)

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._awareness.state_column.set_row(self._row, value)

    @property
    def intent(self) -> TimeSeries:
        """The intended motion."""
        return self._awareness.intent.row(self._row)

    @intent.setter
    def intent(self, series: TimeSeries) -> None:
        self._awareness.columns["intent"].set_row(self._row, series)  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[str]:
        return iter(self._awareness.parts)

    def __contains__(self, name: object) -> bool:
        return name in self._awareness.parts
