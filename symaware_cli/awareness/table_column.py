"""Any number of rows of numbers for every agent of a group, such as what a sensor found around each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.world.arrays import frozen

Array = NDArray[np.float64]


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
