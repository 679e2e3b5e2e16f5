"""Convex polygons in the plane, as lists of corners in counter-clockwise order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

Corner: TypeAlias = tuple[float, float]
Corners: TypeAlias = Sequence[Corner]


def regular(sides: int, radius: float) -> list[Corner]:
    """Return a regular polygon around the origin, with its corners at a distance; the first lies on the x axis."""
    angles = [2.0 * math.pi * number / sides for number in range(sides)]
    return [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]


def faces(corners: Corners) -> list[tuple[float, float, float]]:
    """Return the faces of a polygon: unit normals that point outwards, and the offset of each; a.x <= d inside."""
    found = []
    for (x, y), (further_x, further_y) in zip(corners, [*corners[1:], corners[0]], strict=True):
        along_x, along_y = further_x - x, further_y - y
        length = math.hypot(along_x, along_y)
        normal = along_y / length, -along_x / length
        found.append((*normal, normal[0] * x + normal[1] * y))
    return found


def support(corners: Corners, x: float, y: float) -> float:
    """Return the greatest scalar product of a vector with a point of a polygon."""
    return max([x * corner_x + y * corner_y for corner_x, corner_y in corners])


def clipped(corners: Corners, x: float, y: float, offset: float, tolerance: float = 0.0) -> list[Corner]:
    """Return the part of a polygon where a.p <= d; empty if there is none.

    Args:
        corners: The polygon.
        x: First element of the normal a.
        y: Second element of the normal a.
        offset: The offset d.
        tolerance: The distance beyond the offset up to which a corner counts as inside.
    """
    kept: list[Corner] = []
    excess = [x * corner[0] + y * corner[1] - offset for corner in corners]
    for number, corner in enumerate(corners):
        before, here = excess[number - 1], excess[number]
        if (before > tolerance) != (here > tolerance) and before != here:
            share = min(max(before / (before - here), 0.0), 1.0)
            last = corners[number - 1]
            kept.append((last[0] + share * (corner[0] - last[0]), last[1] + share * (corner[1] - last[1])))
        if here <= tolerance:
            kept.append(corner)
    return kept


def intersection(one: Corners, other: Corners) -> list[Corner]:
    """Return the common part of two polygons; empty if there is none."""
    found = list(one)
    for x, y, offset in faces(other):
        found = clipped(found, x, y, offset) if found else []
    return found


def minkowski_sum(one: Corners, other: Corners) -> list[Corner]:
    """Return all sums of a point of one polygon and a point of another."""
    sums = sorted({(first[0] + second[0], first[1] + second[1]) for first in one for second in other})
    lower, upper = _chain(sums), _chain(sums[::-1])
    return lower[:-1] + upper[:-1]


def negated(corners: Corners) -> list[Corner]:
    """Return the polygon mirrored at the origin."""
    return [(-x, -y) for x, y in corners]


def _chain(points: Corners) -> list[Corner]:
    """Return one half of the convex hull of sorted points (A. M. Andrew, Information Processing Letters 9, 1979)."""
    chain: list[Corner] = []
    for point in points:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        chain.append(point)
    return chain


def _turn(one: Corner, two: Corner, three: Corner) -> float:
    return (two[0] - one[0]) * (three[1] - one[1]) - (two[1] - one[1]) * (three[0] - one[0])
