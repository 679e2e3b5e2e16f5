"""The result of planners for single agents."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from symaware_cli.geometry import Array


class PlannedPath(NamedTuple):
    """The result of a search.

    Attributes:
        points: The start, the corners of the path, and the goal [m]; shape (k, 2). Empty without a path.
        cost: The cost of the path; infinite without a path.
        expanded: The number of cells, nodes or iterations that the search took.
        is_limited: Whether the search ended because of its limit.
    """

    points: Array
    cost: float
    expanded: int
    is_limited: bool


def no_path(expanded: int, is_limited: bool = False) -> PlannedPath:
    """Return the result of a search that found nothing."""
    return PlannedPath(np.empty((0, 2)), np.inf, expanded, is_limited)


def polyline(parts: list[Array]) -> Array:
    """Join lists of points (m, 2), without points that equal the one before them; shape (k, 2)."""
    points = np.concatenate(parts)
    kept = np.ones(len(points), bool)
    kept[1:] = (np.diff(points, axis=0) != 0.0).any(axis=1)
    joined: Array = points[kept]
    return joined
