"""The arrangement of equal panels in a figure."""

from __future__ import annotations

#: Lengths in inches: the height of the title with the outer margins, and the least width of a figure.
_AROUND, _LEAST = 1.1, 6.02

#: The maximum number of panels side by side.
_COLUMNS = 3


def columns_of(count: int) -> int:
    """Return the number of columns for a number of panels; four panels are arranged two by two."""
    return 2 if count == 4 else min(_COLUMNS, count)


def natural_size(grid: tuple[int, int], panel: tuple[float, float]) -> tuple[float, float]:
    """Return width and height of a figure [inch] with rows and columns of panels of a width and height [inch]."""
    rows, columns = grid
    return max(panel[0] * columns, _LEAST), panel[1] * rows + _AROUND
