"""Situational awareness: what an agent believes, intends, doubts and fears, of itself and of others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.column import Column, SeriesColumn
from symaware_cli.awareness.part import PARTS, Part
from symaware_cli.awareness.shared_beliefs import SharedBeliefs
from symaware_cli.awareness.signal import Signal, SignalColumn
from symaware_cli.awareness.table_column import TableColumn
from symaware_cli.awareness.time_series import TimeSeries
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
        columns: The column of each part and signal, by name: a row of numbers, a series or a table for each agent.
        observation: What perception measured last, for those who estimate.
        readings: The scans and images that sensors took last, by the name of the component, for those who use it.
        signals: What components hand out, by component and name, such as ``radar.returns``.
    """

    __slots__ = ("columns", "observation", "readings", "signals", "state_column")

    def __init__(
        self, state: Array, name: str = "", parts: Iterable[Part] = (), signals: Mapping[str, Signal] | None = None
    ) -> None:
        """Begin with a belief of each state, and nothing else.

        Args:
            state: What each agent believes; shape (n, nx).
            name: The group's.
            parts: Those beside the ones that every group has.
            signals: What components hand out, by component and name.

        Raises:
            ValueError: A vector or a table has no columns.
        """
        super().__init__(len(state), name, (*PARTS, *parts))
        self.state_column = Column(state)
        self.columns: dict[str, SignalColumn] = {
            part.name: self.state_column if part.name == "state" else part.column(len(state))
            for part in self.parts.values()
        }
        self.signals: dict[str, Signal] = {}
        self.declare(signals or {})
        self.observation: Observation | None = None
        self.readings: dict[str, Reading] = {}

    def declare(self, signals: Mapping[str, Signal]) -> None:
        """Make room for what components hand out, by component and name.

        Raises:
            ValueError: A vector or a table has no columns.
        """
        self.columns |= {name: signal.column(len(self.state)) for name, signal in signals.items()}
        self.signals |= signals

    def __getitem__(self, name: str) -> Any:
        """A part or signal of all agents.

        Of a vector the read-only array, shape (n, k); of a table those of all agents, each read-only, shape (m, k); of
        a series the column, to be `set`.
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
    """An agent's awareness of itself: a view of its row, which a component may write.

    What components hand out is there by name, too, but it is no part of what the agent is aware of: nobody is told.
    """

    __slots__ = ("_awareness", "_row")

    def __init__(self, id: str, awareness: GroupAwareness, row: int) -> None:
        self.id = id
        self._awareness = awareness
        self._row = row

    def __getitem__(self, name: str) -> Any:
        """What a part or signal says: a copy of a vector, shape (k,), a `TimeSeries`, or a table, shape (m, k)."""
        return self._awareness._column(name).row(self._row)

    def __setitem__(self, name: str, value: ArrayLike | TimeSeries) -> None:
        # Looked up here: agents in Python write so many times a step.
        column = self._awareness.columns.get(name) or self._awareness._column(name)
        column.set_row(self._row, value)  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[str]:
        return iter(self._awareness.parts)

    def __contains__(self, name: object) -> bool:
        return name in self._awareness.parts
