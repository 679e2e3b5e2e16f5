"""Columns: one quantity of every agent of a group, as arrays that remember which rows changed.

An array that was returned for a whole column never changes: writing replaces the array. Rows are returned as copies. So
values that were read never alias values that are written later.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.time_series import TimeSeries
from symaware_cli.world.arrays import frozen, is_within, real

Array = NDArray[np.float64]


class Column:
    """A vector for every agent of a group; shape (n, k).

    Attributes:
        fresh: Whether something was written since this was last set to False; the runtime uses it to check for NaN.
        writes: How often the whole column or a row was written, not counting `restore`. A component can detect with it
            whether another has written since, also in another process.
    """

    __slots__ = ("_array", "_changed", "_every", "_own", "_shape", "fresh", "writes")

    def __init__(self, values: ArrayLike) -> None:
        self._array = frozen(values)
        self.writes = 0
        self._own = False  # whether the array was never returned, so that it may be written in place
        self._shape = self._array.shape[1:]
        self._changed: set[int] = set()
        self._every = True
        self.fresh = True

    @property
    def values(self) -> Array:
        """The whole column, read-only; shape (n, k)."""
        if self._own:
            self._array.flags.writeable = self._own = False
        return self._array

    @values.setter
    def values(self, values: ArrayLike) -> None:
        array = frozen(values)
        if array.shape != self._array.shape:
            raise ValueError(f"expected an array of shape {self._array.shape}, not {array.shape}")
        self._array, self._own = array, False
        self.writes += 1
        self._every = self.fresh = True

    def row(self, index: int) -> Array:
        """Return a copy of one agent's vector; shape (k,)."""
        row: Array = self._array[index].copy()
        return row

    def present(self, index: int) -> Array:
        """Return one agent's vector without a copy; must not be changed."""
        present: Array = self.values[index]
        return present

    def set_row(self, index: int, value: ArrayLike) -> None:
        """Replace one agent's vector.

        Raises:
            TypeError: The value is not made of real numbers.
            ValueError: It does not have shape (k,).
        """
        if type(value) is not np.ndarray or value.dtype != float:
            value = real(value)
        if value.shape != self._shape:
            raise ValueError(f"expected a vector of shape {self._shape}, not {value.shape}")
        if not self._own:
            self._array, self._own = self._array.copy(), True
        self._array[index] = value
        self.writes += 1
        self._changed.add(index)
        self.fresh = True

    def restore(self, rows: Sequence[int] | slice, before: Array) -> None:
        """Restore some rows, which were written since, from an earlier array of the column."""
        array = self.values.copy()
        array[rows] = before[rows]
        array.flags.writeable = False
        self._array = array

    def exchange(self, values: Array) -> Array:
        """Set an array that was read from this column, without counting a change; return the present one."""
        present = self.values
        self._array = values
        return present

    def take_changes(self) -> Sequence[int] | None:
        """Return the rows written since the last call, ascending; None stands for every row."""
        every, changed = self._every or len(self._changed) == len(self._array), self._changed
        self._every = False
        if changed:
            self._changed = set()
        return None if every else sorted(changed)

    def mark(self, rows: Sequence[int] | None) -> None:
        """Mark rows as written since the last call of `take_changes`; None stands for all rows."""
        if rows is None:
            self._every = True
        else:
            self._changed.update(rows)

    def rows_beyond(self, most: float) -> list[int]:
        """Return the rows with NaN, infinity, or a number whose magnitude exceeds a limit."""
        if is_within(self._array, most):
            return []
        bad: list[int] = np.flatnonzero(~(np.abs(self._array) <= most).all(axis=1)).tolist()
        return bad


class SeriesColumn:
    """A time series for every agent of a group.

    A group component writes all series at once as arrays with common times; a component of one agent writes its own
    row. The value that was written last counts.
    """

    __slots__ = ("_changed", "_deferred", "_every", "_rows", "_times", "_values", "_width", "count")

    def __init__(self, count: int) -> None:
        self.count = count
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
        self._every = True

    def _put(self, times: ArrayLike, values: ArrayLike) -> None:
        instants = np.array(times, np.int64, ndmin=1)
        array = frozen(values)
        if array.ndim < 3:
            array = array.reshape(len(array), -1, 1)
        if array.shape[:2] != (self.count, len(instants)):
            raise ValueError(f"expected values for {self.count} agents at {len(instants)} instants, not {array.shape}")
        if len(instants) > 1 and not (instants[1:] > instants[:-1]).all():
            raise ValueError("the times of a series must ascend")
        instants.flags.writeable = False
        self._times, self._values, self._width, self._deferred = instants, array, array.shape[2], None

    def defer(self, compute: Callable[[], tuple[ArrayLike, ArrayLike]]) -> None:
        """Replace every agent's series by one that is computed when it is first read.

        Args:
            compute: Returns the arguments of `set`. It may be called at any later time, so it must not read data that
                can change.
        """
        self._deferred = compute
        self._rows.clear()
        self._every = True

    def settle(self) -> None:
        """Compute a deferred series."""
        if self._deferred is not None:
            self._put(*self._deferred())

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

    @property
    def is_unwritten(self) -> bool:
        """Whether no series was ever written."""
        return self._times is None and self._deferred is None and not self._rows

    def put_back(self, series: Mapping[int, TimeSeries]) -> None:
        """Put back the series of some rows as they were read here before; what was deferred stays so."""
        unwritten = self._times is None and self._deferred is None
        for index, own in series.items():
            if self._rows.get(index) is own or (unwritten and index not in self._rows):
                continue
            self._rows[index] = own
            self._changed.add(index)

    @property
    def shared(self) -> tuple[NDArray[np.int64], Array] | None:
        """The times (h,) and values (n, h, k) if all series have the same times, else None."""
        self.settle()
        return None if self._times is None or self._rows else (self._times, self._values)

    def take_changes(self) -> Sequence[int] | None:
        """Return the rows written since the last call, ascending; None stands for every row."""
        every, changed = self._every, self._changed
        self._every = False
        if changed:
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
        self.settle()
        if self._times is None and not self._rows:
            return None
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


class TableColumn:
    """A table for every agent of a group, which tracks the rows that were written; all tables have the same columns.

    Attributes:
        width: The number of columns.
    """

    __slots__ = ("_changed", "_tables", "width")

    def __init__(self, count: int, width: int) -> None:
        self.width = width
        self._tables: list[Array] = [frozen(np.empty((0, width)))] * count
        self._changed: set[int] = set()

    @property
    def tables(self) -> tuple[Array, ...]:
        """The table of each agent, read-only; shape (m, columns)."""
        return tuple(self._tables)

    def set(self, tables: Sequence[ArrayLike]) -> None:
        """Replace every agent's table.

        Raises:
            TypeError: One is not made of real numbers.
            ValueError: There is not one for each agent, or one does not have shape (m, columns).
        """
        if len(tables) != len(self._tables):
            raise ValueError(f"expected a table for each of {len(self._tables)} agents, not {len(tables)}")
        self._tables = [self._sound(table) for table in tables]
        self._changed.update(range(len(tables)))

    def row(self, index: int) -> Array:
        """One agent's table, read-only; shape (m, columns)."""
        return self._tables[index]

    present = row

    def set_row(self, index: int, table: ArrayLike) -> None:
        """Replace one agent's table; see `set`."""
        self._tables[index] = self._sound(table)
        self._changed.add(index)

    def take_changes(self) -> Sequence[int] | None:
        """Return the rows written since the last call, ascending; None stands for every row."""
        changed, self._changed = self._changed, set()
        return None if len(changed) == len(self._tables) else sorted(changed)

    def _sound(self, table: ArrayLike) -> Array:
        array = frozen(table)
        if not array.size and array.ndim < 3:
            array = frozen(np.empty((0, self.width)))
        if array.ndim != 2 or array.shape[1] != self.width:
            raise ValueError(f"expected a table of shape (any, {self.width}), not {array.shape}")
        return array
