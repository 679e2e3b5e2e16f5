"""Outlines of shapes as polygons, and prisms over them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Piece = tuple[Sequence[Sequence[float]] | NDArray[np.float64], float]
"""A convex core (m, 2) and the radius by which it is rounded [m], as in `Shape.pieces`."""

#: Number of corners of a full circle.
_CORNERS = 32
#: Number of dashes of an interrupted outline, about.
_DASHES = 15


def outlines(pieces: Iterable[Piece]) -> list[Array]:
    """Return the corners of each piece, (m, 2) counter-clockwise [m]; a full circle has 32 corners."""
    return [_rounded(np.array(core, float), radius) for core, radius in pieces]


def circle(radius: float = 1.0, corners: int = _CORNERS) -> Array:
    """Return a closed circle around the origin: the last point equals the first; (corners + 1, 2) [m]."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def placed(outline: Array, positions: Array, headings: ArrayLike) -> Array:
    """Place an outline at the poses of bodies.

    Args:
        outline: (m, 2) [m].
        positions: (..., 3) [m].
        headings: (...) [rad].

    Returns:
        (..., m, 3) [m].
    """
    cosine, sine = np.cos(headings)[..., None], np.sin(headings)[..., None]
    corners = np.empty((*positions.shape[:-1], len(outline), 3))
    corners[..., 0] = positions[..., None, 0] + cosine * outline[:, 0] - sine * outline[:, 1]
    corners[..., 1] = positions[..., None, 1] + sine * outline[:, 0] + cosine * outline[:, 1]
    corners[..., 2] = positions[..., None, 2]
    return corners


def prism_surface(outline: Array, low: float, high: float) -> tuple[Array, NDArray[np.uint32]]:
    """Return the surface of a prism over a convex outline.

    Args:
        outline: (m, 2) [m].
        low: Its lower end [m].
        high: Its upper end [m]; equal to `low` if flat.

    Returns:
        Its vertices (v, 3) and triangles (t, 3).
    """
    count = len(outline)
    fan = np.array([(0, index, index + 1) for index in range(1, count - 1)], np.uint32)
    top = np.column_stack([outline, np.full(count, high)])
    if high == low:
        return top, fan
    bottom = np.column_stack([outline, np.full(count, low)])
    sides = [
        triangle
        for index in range(count)
        for following in [(index + 1) % count]
        for triangle in ((index, index + count, following), (following, index + count, following + count))
    ]
    triangles = np.concatenate([fan, fan[:, ::-1] + count, np.array(sides)]).astype(np.uint32)
    return np.concatenate([top, bottom]), triangles


def closed(outline: Array, height: float) -> list[Array]:
    """Return the one closed line around an outline (m, 2) [m], at a height [m]; (m + 1, 3)."""
    return [np.pad(np.concatenate([outline, outline[:1]]), ((0, 0), (0, 1)), constant_values=height)]


def dashes(outline: Array, height: float) -> list[Array]:
    """Return an interrupted line around an outline (m, 2) [m], at a height [m]: dashes, (2, 3) each."""
    (line,) = closed(outline, height)
    sides = np.linalg.norm(np.diff(line, axis=0), axis=1)
    length = float(sides.sum()) / _DASHES
    found = []
    for start, end, side in zip(line[:-1], line[1:], sides.tolist(), strict=True):
        count = max(1, round(side / length))
        ends = (np.arange(count)[:, None] + 0.5 + np.array([-0.25, 0.25])) / count
        found += list(start + ends[..., None] * (end - start))
    return found


def _rounded(core: Array, radius: float) -> Array:
    """Return the outline of a convex core, (m, 2) counter-clockwise, grown by a radius."""
    if radius == 0.0:
        return core
    from scipy.spatial import ConvexHull

    around = circle(radius)[:-1]
    points = (core[:, None] + around).reshape(-1, 2)
    return points[ConvexHull(points).vertices]
