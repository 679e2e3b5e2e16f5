"""Rectangles that cover the marked cells of a grid, so that a map becomes few bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Rectangles of cells: the first column and row, and those after the last; shape (m, 4).
Rectangles = NDArray[np.intp]


def merged(marked: NDArray[np.bool_]) -> Rectangles:
    """Partition the marked cells of a grid into rectangles.

    Runs of marked cells in a row are joined with equal runs in the rows above, and the same is tried with rows and
    columns exchanged; the fewer rectangles are returned. For walls along the axes, that is at most a few more than the
    least number. The result depends on the cells alone.

    Args:
        marked: The cells; shape (rows, columns).

    Returns:
        The rectangles, ordered by their first row and column.
    """
    found = min(_of_runs(marked), _of_runs(marked.T)[:, [1, 0, 3, 2]], key=len)
    return found[np.lexsort((found[:, 0], found[:, 1]))]


def _of_runs(marked: NDArray[np.bool_]) -> Rectangles:
    """Join equal runs of successive rows."""
    if not marked.any():
        return np.empty((0, 4), np.intp)
    edges = np.diff(np.pad(marked.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, starts = np.nonzero(edges == 1)
    _, ends = np.nonzero(edges == -1)
    # Equal runs come after one another, from the lowest row on.
    order = np.lexsort((rows, ends, starts))
    rows, starts, ends = rows[order], starts[order], ends[order]
    begins = np.ones(len(rows), bool)
    begins[1:] = (np.diff(starts) != 0) | (np.diff(ends) != 0) | (np.diff(rows) != 1)
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(rows)) - 1
    return np.stack([starts[first], rows[first], ends[first], rows[last] + 1], axis=1)
