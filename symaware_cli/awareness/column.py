"""Columns: one quantity of every agent of a group, as arrays that remember which rows changed.

An array that was returned for a whole column never changes: writing replaces the array. Rows are returned as copies. So
values that were read never alias values that are written later.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.value_range import FINITE, ValueRange
from symaware_cli.world import frozen, real, said_of

Array = NDArray[np.float64]


class Column:
    """A vector for every agent of a group; shape (n, k).

    Attributes:
        bounds: The numbers that may be written.
        fresh: Whether something was written since `take_beyond` was last called.
        writes: The number of times that the whole column or a row was written, without `restore`. It shows whether
            another component has written since, also in another process.
        verified: An array that was found to be within bounds elsewhere: where it is written as it is, it is not looked
            at again. So true states that are perceived without errors are looked at once, where they are made.
    """

    #: No state: an array that is not known yet is looked at.
    uncaptured: ClassVar[Collection[str]] = ("verified",)

    __slots__ = (
        *("_array", "_changed", "_every", "_own", "_restored", "_shape", "_since"),
        *("bounds", "fresh", "verified", "writes"),
    )

    def __init__(self, values: ArrayLike, bounds: ValueRange = FINITE, *, fresh: bool = True) -> None:
        """Begin with some values.

        Args:
            values: Shape (n, k).
            bounds: The numbers that may be written.
            fresh: Whether the values count as written.
        """
        self.bounds = bounds
        self._array = frozen(values)
        self.writes = 0
        self.verified: Array | None = None
        self._own = False  # whether the array was never returned, so that it may be written in place
        self._shape = self._array.shape[1:]
        self._changed: set[int] = set()
        self._every = self.fresh = fresh
        #: The rows written since `take_beyond` was last called, None for all, and those restored since.
        self._since: set[int] | None = None if fresh else set()
        self._restored: Sequence[int] | slice | None = None

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
        self._since = None

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
        if self._since is not None:
            self._since.add(index)

    def restore(self, rows: Sequence[int] | slice, before: Array) -> None:
        """Restore some rows, which were written since, from an earlier array of the column."""
        array = self.values.copy()
        array[rows] = before[rows]
        array.flags.writeable = False
        self._array, self._restored = array, rows

    def exchange(self, values: Array) -> Array:
        """Set an array that was read from this column, without counting a change; return the present one."""
        present = self.values
        self._array = values
        return present

    def take_changes(self) -> Sequence[int] | None:
        """Return the rows written since the last call, ascending; None stands for every row."""
        every, changed = self._every, self._changed
        self._every = False
        if not changed:
            return None if every else []
        self._changed = set()
        return None if every or len(changed) == len(self._array) else sorted(changed)

    def mark(self, rows: Sequence[int] | None) -> None:
        """Mark rows as written since the last call of `take_changes`; None stands for all rows."""
        if rows is None:
            self._every = True
        else:
            self._changed.update(rows)

    def passes(self) -> bool:
        """Whether all rows are within bounds, so that `take_beyond` returns none; then they count as looked at."""
        if self._array is not self.verified and not self.bounds.includes(self._array):
            return False
        self._since, self._restored, self.fresh = set(), None, False
        return True

    def take_beyond(self) -> list[int]:
        """Return the rows out of bounds that were written since the last call and not restored, ascending."""
        since, restored = self._since, self._restored
        if self.passes():
            return []
        self._since, self._restored, self.fresh = set(), None, False
        beyond = self.bounds.rows_beyond(self._array)
        if restored is not None:
            kept = range(*restored.indices(len(self._array))) if isinstance(restored, slice) else {*restored}
            beyond = [row for row in beyond if row not in kept]
        return beyond if since is None else [row for row in beyond if row in since]

    def problem(self, row: int) -> str:
        """Describe the invalid values of a row that is out of bounds."""
        return said_of(self._array[row])

    def clear(self, rows: Sequence[int]) -> None:
        """Set some rows to NaN, as if they had never been written."""
        for row in rows:
            self.set_row(row, np.full(self._shape, np.nan))
        self.take_beyond()

    def held(self) -> Array:
        """Return the present values, for `put_back`."""
        return self.values

    def put_back(self, rows: Sequence[int], held: Array) -> None:
        """Put back the values that some rows had."""
        for row in rows:
            self.set_row(row, held[row])
        self.take_beyond()


class TableColumn:
    """A table for every agent of a group, which tracks the rows that were written; all tables have the same columns.

    Attributes:
        bounds: The numbers that may be written.
        fresh: Whether something was written since `take_beyond` was last called.
        width: The number of columns.
    """

    __slots__ = ("_changed", "_since", "_tables", "bounds", "fresh", "width")

    def __init__(self, count: int, width: int, bounds: ValueRange = FINITE) -> None:
        """Begin with empty tables.

        Args:
            count: The number of agents.
            width: The number of columns.
            bounds: The numbers that may be written.
        """
        self.width = width
        self.bounds = bounds
        self.fresh = False
        self._since: set[int] = set()
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
        self._since.update(range(len(tables)))
        self.fresh = True

    def row(self, index: int) -> Array:
        """One agent's table, read-only; shape (m, columns)."""
        return self._tables[index]

    present = row

    def set_row(self, index: int, table: ArrayLike) -> None:
        """Replace one agent's table; see `set`."""
        self._tables[index] = self._sound(table)
        self._changed.add(index)
        self._since.add(index)
        self.fresh = True

    def passes(self) -> bool:
        """Whether `take_beyond` returns no rows; then they count as looked at."""
        if not all(self.bounds.includes(self._tables[row]) for row in self._since):
            return False
        self._since, self.fresh = set(), False
        return True

    def take_beyond(self) -> list[int]:
        """Return the rows out of bounds that were written since the last call, ascending."""
        since, self._since, self.fresh = self._since, set(), False
        return sorted(row for row in since if not self.bounds.includes(self._tables[row]))

    def problem(self, row: int) -> str:
        """Describe the invalid values of a row that is out of bounds."""
        table = self._tables[row]
        return said_of(table[self.bounds.rows_beyond(table)[0]])

    def clear(self, rows: Sequence[int]) -> None:
        """Empty the tables of some rows."""
        for row in rows:
            self.set_row(row, ())
        self.take_beyond()

    def held(self) -> Sequence[Array]:
        """Return the present values, for `put_back`."""
        return self.tables

    def put_back(self, rows: Sequence[int], held: Sequence[Array]) -> None:
        """Put back the values that some rows had."""
        for row in rows:
            self.set_row(row, held[row])
        self.take_beyond()

    def take_changes(self) -> Sequence[int] | None:
        """Return the rows written since the last call, ascending; None stands for every row."""
        changed = self._changed
        if not changed:
            return []
        self._changed = set()
        return None if len(changed) == len(self._tables) else sorted(changed)

    def _sound(self, table: ArrayLike) -> Array:
        array = frozen(table)
        if not array.size and array.ndim < 3:
            array = frozen(np.empty((0, self.width)))
        if array.ndim != 2 or array.shape[1] != self.width:
            raise ValueError(f"expected a table of shape (any, {self.width}), not {array.shape}")
        return array
