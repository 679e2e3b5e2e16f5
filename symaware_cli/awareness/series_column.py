"""Series columns: a time series for every agent of a group, with common times or each with its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.column import Array
from symaware_cli.awareness.time_series import TimeSeries
from symaware_cli.awareness.value_range import FINITE, NotFiniteError, ValueRange
from symaware_cli.world import SECOND, frozen, said_of

#: The series of a column: the common times and values, and the series of single rows.
HeldSeries: TypeAlias = tuple[NDArray[np.int64] | None, Array, dict[int, TimeSeries]]


class SeriesColumn:
    """A time series for every agent of a group.

    A group component writes all series at once as arrays with common times; a component of one agent writes its own
    row. The value that was written last counts.

    Attributes:
        bounds: The numbers that may be written.
        count: The number of agents.
        fresh: Whether something was written since `take_beyond` was last called.
        author: The name of the written quantity, the path of the writing component and its plugin, for the
            `NotFiniteError` of a deferred series.
    """

    __slots__ = (
        *("_changed", "_deferred", "_every", "_rows", "_since", "_times", "_values", "_width"),
        *("author", "bounds", "count", "fresh"),
    )

    def __init__(self, count: int, bounds: ValueRange = FINITE) -> None:
        """Begin without series.

        Args:
            count: The number of agents.
            bounds: The numbers that may be written.
        """
        self.count = count
        self.bounds = bounds
        self.author = ("series", "", "")
        self.fresh = False
        #: The rows written since `take_beyond` was last called; None for all.
        self._since: set[int] | None = set()
        self._times: NDArray[np.int64] | None = None
        self._values: Array = np.empty((count, 0, 0))
        self._deferred: Callable[[], tuple[ArrayLike, ArrayLike]] | None = None
        self._width: int | None = None
        self._rows: dict[int, TimeSeries] = {}
        self._changed: set[int] = set()
        self._every = False

    def set(self, times: ArrayLike, values: ArrayLike) -> None:
        """Replace every agent's series.

        Args:
            times: The common times of all series, ascending, in nanoseconds; shape (h,) or a scalar.
            values: One scalar (n,), a scalar for each time (n, h) or a vector for each time (n, h, k).

        Raises:
            ValueError: The shapes do not match.
        """
        self._put(times, values)
        self._rows.clear()
        self._every = self.fresh = True
        self._since = None

    def _put(self, times: ArrayLike, values: ArrayLike) -> None:
        instants = np.array(times, np.int64, ndmin=1)
        array = frozen(values)
        if array.ndim < 3:
            array = array.reshape(len(array), -1, 1)
        if array.shape[:2] != (self.count, len(instants)):
            raise ValueError(f"expected values for {self.count} agents at {len(instants)} instants, not {array.shape}")
        # Several times as fast as `all` for few instants.
        if np.count_nonzero(instants[1:] > instants[:-1]) < len(instants) - 1:
            raise ValueError("the times of a series must ascend")
        instants.setflags(write=False)
        self._times, self._values, self._width, self._deferred = instants, array, array.shape[2], None

    def defer(self, compute: Callable[[], tuple[ArrayLike, ArrayLike]]) -> None:
        """Replace every agent's series by one that is computed when it is first read.

        Args:
            compute: Returns the arguments of `set`. It may be called at any later time, so it must not read data that
                can change.
        """
        self._deferred = compute
        self._rows.clear()
        self._every = self.fresh = True
        self._since = None

    def settle(self) -> None:
        """Compute a deferred series.

        Raises:
            NotFiniteError: It is out of bounds, and the turn in which it was deferred is over.
        """
        if self._deferred is None:
            return
        deferred = self._deferred
        self._put(*deferred())
        if not self.fresh and not self.bounds.includes(self._values):
            self._deferred = deferred
            row = self.bounds.rows_beyond(self._values)[0]
            what, path, use = self.author
            raise NotFiniteError(f"its {what} {self.problem(row)}", path, use)

    def row(self, index: int) -> TimeSeries:
        """Return one agent's series."""
        own = self._rows.get(index)
        if own is not None:
            return own
        self.settle()
        if self._times is None:
            return TimeSeries()
        return TimeSeries.sampled(self._times, self._values[index])

    def present(self, index: int) -> Array:
        """Return the first vector of one agent's series, shape (k,); NaN if it is empty."""
        series = self.row(index)
        return series.values[0] if len(series) else np.full(self._width or 1, np.nan)

    def set_row(self, index: int, series: TimeSeries) -> None:
        """Replace one agent's series.

        Raises:
            TypeError: The value is not a `TimeSeries`.
            ValueError: Its vectors have another length than those of the group's other series.
        """
        if not isinstance(series, TimeSeries):
            raise TypeError(f"expected a TimeSeries, not {type(series).__name__}")
        if self._deferred is not None:
            self.settle()
        empty = series.times.size == 0
        if empty and self._times is None and index not in self._rows:
            return  # empty before and now: not a change to record
        if not empty:
            width = series.values.shape[1]
            if self._width not in (None, width):
                raise ValueError(f"expected vectors of {self._width} as in the group's other series, not of {width}")
            self._width = width
        self._rows[index] = series
        self._changed.add(index)
        self.fresh = True
        if self._since is not None:
            self._since.add(index)

    def passes(self) -> bool:
        """Whether `take_beyond` returns no rows; then they count as looked at."""
        if self._beyond():
            return False
        self._since, self.fresh = set(), False
        return True

    def take_beyond(self) -> list[int]:
        """Return the rows out of bounds that were written since the last call, ascending.

        A deferred series is not computed: `settle` looks at it.
        """
        beyond = self._beyond()
        self._since, self.fresh = set(), False
        return beyond

    def _beyond(self) -> list[int]:
        since, beyond, rows = self._since, [], self._rows
        if since is None and self._deferred is None and not self.bounds.includes(self._values):
            beyond = [row for row in self.bounds.rows_beyond(self._values) if row not in rows]
        if not rows:
            return beyond
        for row in rows if since is None else since:
            if row in rows and not self.bounds.includes(rows[row].values):
                beyond.append(row)
        return sorted(beyond)

    def problem(self, row: int) -> str:
        """Describe the invalid values of a row that is out of bounds."""
        own = self._rows.get(row)
        times, values = (self._times, self._values[row]) if own is None else (own.times, own.values)
        assert times is not None
        point = self.bounds.rows_beyond(values)[0]
        return f"{said_of(values[point])} at {times[point] / SECOND:g} s"

    def clear(self, rows: Sequence[int]) -> None:
        """Empty the series of some rows."""
        for row in rows:
            self.set_row(row, TimeSeries())
        self.take_beyond()

    def held(self) -> HeldSeries:
        """Return the present values, for `put_back`."""
        self.settle()
        return self._times, self._values, dict(self._rows)

    def put_back(self, rows: Sequence[int], held: HeldSeries) -> None:
        """Put back the series that some rows had, where they were written since; deferred series stay deferred."""
        times, values, own = held
        untouched = self._deferred is None and self._times is times and self._values is values
        for row in rows:
            series = own.get(row)
            if untouched and self._rows.get(row) is series:
                continue
            if series is None:
                series = TimeSeries() if times is None else TimeSeries.sampled(times, values[row])
            self._rows[row] = series
            self._changed.add(row)

    @property
    def is_unwritten(self) -> bool:
        """Whether no series was ever written."""
        return self._times is None and self._deferred is None and not self._rows

    @property
    def shared(self) -> tuple[NDArray[np.int64], Array] | None:
        """The times (h,) and values (n, h, k) if all series have the same times, else None."""
        self.settle()
        return None if self._times is None or self._rows else (self._times, self._values)

    def take_changes(self) -> Sequence[int] | None:
        """Return the rows written since the last call, ascending; None stands for every row."""
        every, changed = self._every, self._changed
        self._every = False
        if not changed:
            return None if every else []
        self._changed = set()
        return None if every else sorted(changed)

    def maxima(self) -> Array:
        """The largest value of each agent's series, 0 where it is empty or has none above; shape (n,)."""
        self.settle()
        if self._times is not None and self._values.size:
            peaks: Array = np.maximum(self._values.reshape(self.count, -1).max(axis=1), 0.0)
        else:
            peaks = np.zeros(self.count)
        for row, series in self._rows.items():
            peaks[row] = series.values.max(initial=0.0) if len(series) else 0.0
        return peaks

    def peaks(self) -> Array:
        """Return the largest value of each agent's series; shape (n,). Minus infinity where it is empty."""
        self.settle()
        peaks: Array = np.full(self.count, -math.inf)
        if self._times is not None and self._values.size:
            peaks = self._values.reshape(self.count, -1).max(axis=1)
        for row, series in self._rows.items():
            peaks[row] = series.values.max(initial=-math.inf)
        return peaks

    def maximum(self) -> tuple[float, int] | None:
        """Return the largest value of any series and its row; None if all are empty."""
        if self.is_unwritten:
            return None
        self.settle()
        best: tuple[float, int] | None = None
        if self._times is not None and self._values.size:
            peaks = self._values.reshape(self.count, -1).max(axis=1)
            if self._rows:
                peaks[list(self._rows)] = -math.inf
            row = int(peaks.argmax())
            best = (float(peaks[row]), row)
        for row, series in sorted(self._rows.items()):
            if len(series) and (best is None or series.values.max() > best[0]):
                best = (float(series.values.max()), row)
        return best if best is None or best[0] > -math.inf else None
