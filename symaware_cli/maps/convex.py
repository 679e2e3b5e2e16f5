"""Convex pieces of polygons: a constrained Delaunay triangulation whose triangles are joined where that stays convex.

The triangles are joined along their common edges in turn, as by S. Hertel and K. Mehlhorn (Fast triangulation of simple
polygons, FCT 1983), who show that the pieces are at most four times as many as in the best partition.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.geometry import Array

#: Relative to the square of the extent: smaller areas are rounding errors.
_TINY = 1e-12

Corner = tuple[float, float]


def convex_pieces(rings: Sequence[Array]) -> list[Array]:
    """Partition a polygon into convex pieces.

    Args:
        rings: The outer ring, counter-clockwise, then holes, each closed by its first corner [m]; shape (k, 2) each.

    Returns:
        The corners of each piece, counter-clockwise, without the first at the end; shape (k, 2) each.
    """
    outer = [(x, y) for x, y in rings[0][:-1].tolist()]
    extent = float(np.ptp(rings[0], axis=0).max())
    least = _TINY * extent * extent
    if len(rings) == 1 and _is_convex(outer, least):
        return [np.array(outer)]
    import shapely

    polygon = shapely.Polygon(rings[0], rings[1:])
    pieces: dict[int, list[Corner]] = {}
    for triangle in shapely.constrained_delaunay_triangles(polygon).geoms:
        one, two, three = [(float(x), float(y)) for x, y in triangle.exterior.coords[:3]]
        area = _cross(one, two, three)
        if abs(area) > least:
            pieces[len(pieces)] = [one, two, three] if area > 0.0 else [one, three, two]
    owner = {edge: number for number, corners in pieces.items() for edge in _edges(corners)}
    for start, end in list(owner):
        if (start, end) not in owner or (end, start) not in owner:
            continue
        first, second = owner[start, end], owner[end, start]
        if first == second:
            continue
        # From the end of the edge around the first piece to its start, and on around the second.
        joined = _from(pieces[first], end) + _from(pieces[second], start)[1:-1]
        if _is_convex(joined, least):
            del owner[start, end], owner[end, start], pieces[second]
            pieces[first] = joined
            owner |= dict.fromkeys(_edges(joined), first)
    return [np.array(corners) for corners in pieces.values()]


def _edges(corners: list[Corner]) -> list[tuple[Corner, Corner]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def _from(corners: list[Corner], first: Corner) -> list[Corner]:
    place = corners.index(first)
    return corners[place:] + corners[:place]


def _cross(one: Corner, two: Corner, three: Corner) -> float:
    return (two[0] - one[0]) * (three[1] - one[1]) - (two[1] - one[1]) * (three[0] - one[0])


def _is_convex(corners: list[Corner], least: float) -> bool:
    """Whether a simple polygon turns to the left at each corner, and not straight on."""
    return all(
        _cross(corners[number - 2], corners[number - 1], corners[number]) > least for number in range(len(corners))
    )
