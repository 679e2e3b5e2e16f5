"""Minkowski sums of pairs of convex pieces: at which relative positions they overlap, and when they do.

Bodies A at the origin and B at x overlap exactly if x lies in the Minkowski sum of A and the reflection of B. If x
moves by v each second, they overlap at some time up to T exactly if x lies in the sum of that and the line from the
origin to -v T (C. Ericson, Real-Time Collision Detection, 2005, 3.10 and 5.5). The sum of convex polygons consists of
the edges of all of them, in the order of their directions (M. de Berg et al., Computational Geometry, 2008, 13.3).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from symaware_cli.geometry.pieces import Pieces, following
from symaware_cli.geometry.vectors import Array, Mask

#: The number of edges of polygons around circles; they are 0.9 % wider, and never inside.
_FACETS = 24


class Interval(NamedTuple):
    """Time intervals; empty if the start is later than the end.

    Attributes:
        start: The start of each; shape (m,).
        end: The end of each; shape (m,).
    """

    start: Array
    end: Array

    def also(self, other: Interval) -> Interval:
        """Return the intersections with other intervals."""
        return Interval(np.maximum(self.start, other.start), np.minimum(self.end, other.end))


def overlap_region(first: Pieces, second: Pieces, way: Array | None = None) -> Pieces:
    """Return the positions of the second, relative to the first, at which the two overlap, row by row.

    Args:
        first: One body of each pair, at its pose around the origin.
        second: The other, at its pose around the origin.
        way: The displacement of the second relative to the first [m]; shape (m, 2). They overlap at some time on it.

    Returns:
        Convex pieces, rounded by the sum of both roundings.
    """
    if way is None and not (first.vertices.any() or second.vertices.any()):
        return Pieces.points(np.zeros((len(first), 2)), first.rounding + second.rounding)
    lines = None if way is None else np.stack([np.zeros_like(way), -way], axis=1)
    operands = [first.vertices, -second.vertices, *([] if lines is None else [lines])]
    return _summed(operands, first.rounding + second.rounding)


def cornered(pieces: Pieces) -> Pieces:
    """Return polygons that contain rounded pieces and are slightly wider."""
    if not pieces.rounding.any():
        return pieces
    circles = pieces.rounding[:, None, None] * _unit_polygon()
    return _summed([pieces.vertices, circles], np.zeros(len(pieces)))


def _summed(polygons: list[Array], rounding: Array) -> Pieces:
    """Return the Minkowski sums of counter-clockwise convex polygons, (m, k, 2) each."""
    edges = np.concatenate([following(each) - each for each in polygons], axis=1)
    order = np.arctan2(edges[..., 1], edges[..., 0]).argsort(axis=1, kind="stable")
    edges = np.take_along_axis(edges, order[..., None], axis=1)
    vertices = np.cumsum(edges, axis=1)
    # The start of the edges is arbitrary; shift the polygon so that its extent is the sum of all extents.
    farthest = np.sum([each.max(axis=1) for each in polygons], axis=0)
    vertices += (farthest - vertices.max(axis=1))[:, None, :]
    length = np.sqrt(edges[..., 0] ** 2 + edges[..., 1] ** 2)
    real = length > 0.0
    # The edge to the next vertex is the next edge.
    edges, length, real = following(edges), following(length), following(real)
    normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1) / np.where(real, length, 1.0)[..., None]
    offsets = np.where(real, normals[..., 0] * vertices[..., 0] + normals[..., 1] * vertices[..., 1], np.inf)
    return Pieces(vertices, normals, offsets, rounding)


@cache
def _unit_polygon() -> Array:
    """Return a regular polygon around the unit circle."""
    angles = np.arange(_FACETS) * (2.0 * np.pi / _FACETS)
    polygon: Array = np.stack([np.cos(angles), np.sin(angles)], axis=1) / np.cos(np.pi / _FACETS)
    return polygon


def loosened(pieces: Pieces, angle: Array) -> Pieces:
    """Return pieces that contain others turned about the origin by up to an angle to either side.

    A point within R of the origin moves by at most 2 R sin(angle / 2), which is added to the rounding; if a disc around
    the origin is smaller than the result, the disc is used.

    Args:
        pieces: The pieces to turn.
        angle: The greatest angle [rad]; shape (m,).
    """
    if not angle.any():
        return pieces
    reach = np.sqrt((pieces.vertices**2).sum(axis=2)).max(axis=1)
    moved = 2.0 * reach * np.sin(0.5 * np.minimum(angle, np.pi))
    real = np.isfinite(pieces.offsets)
    inner = np.where(real.any(axis=1), np.where(real, pieces.offsets, np.inf).min(axis=1), 0.0)
    disc = (np.maximum(inner, 0.0) + moved >= reach)[:, None]
    return Pieces(
        np.where(disc[..., None], 0.0, pieces.vertices),
        np.where(disc[..., None], 0.0, pieces.normals),
        np.where(disc, np.inf, pieces.offsets),
        pieces.rounding + np.where(disc[:, 0], reach, moved),
    )


def width(pieces: Pieces, directions: Array) -> tuple[Array, Array]:
    """Return the extents of pieces along unit vectors.

    Args:
        pieces: The pieces.
        directions: The unit vectors; shape (m, k, 2).

    Returns:
        The least and the greatest coordinate along each direction [m]; shape (m, k) each.
    """
    along = (
        directions[..., None, 0] * pieces.vertices[:, None, :, 0]
        + directions[..., None, 1] * pieces.vertices[:, None, :, 1]
    )
    rounding = pieces.rounding[:, None]
    return along.min(axis=2) - rounding, along.max(axis=2) + rounding


def between(value: Array, rate: Array, low: Array, high: Array) -> Interval:
    """Return when values with constant rates lie between two bounds; any shape."""
    moving = rate != 0.0
    safe = np.where(moving, rate, 1.0)
    one, other = (low - value) / safe, (high - value) / safe
    inside = (low <= value) & (value <= high)
    start = np.where(moving, np.minimum(one, other), np.where(inside, -np.inf, np.inf))
    end = np.where(moving, np.maximum(one, other), np.where(inside, np.inf, -np.inf))
    return Interval(start, end)


def within(points: Array, velocities: Array, pieces: Pieces) -> Interval:
    """Return when points with constant velocities are within pieces, row by row.

    A rounded piece consists of its core, a rectangle on each of its edges and a disc around each of its vertices; as it
    is convex, a point is within it from the first of all their times to the last.

    Args:
        points: Positions at time 0 [m]; shape (m, 2).
        velocities: Velocities [m/s]; shape (m, 2).
        pieces: The pieces.

    Returns:
        Times [s], which may be before 0; empty intervals for points that never are.
    """
    vertices, normals, rounding = pieces.vertices, pieces.normals, pieces.rounding[:, None]
    real = np.isfinite(pieces.offsets)
    offsets = np.where(real, pieces.offsets, 0.0)
    x, y = points[:, 0, None], points[:, 1, None]
    u, v = velocities[:, 0, None], velocities[:, 1, None]
    out = x * normals[..., 0] + y * normals[..., 1] - offsets
    outwards = u * normals[..., 0] + v * normals[..., 1]
    inner = between(out, outwards, np.full_like(out, -np.inf), np.where(real, 0.0, np.inf))
    core = Interval(inner.start.max(axis=1), inner.end.min(axis=1))
    found = [_masked(core, real.sum(axis=1) >= 3)]
    rounded = np.broadcast_to(rounding > 0.0, out.shape)
    if rounded.any():
        # The x axis of each edge is its normal turned by a right angle.
        along_x, along_y = -normals[..., 1], normals[..., 0]
        edges = following(vertices) - vertices
        length = along_x * edges[..., 0] + along_y * edges[..., 1]
        away_x, away_y = x - vertices[..., 0], y - vertices[..., 1]
        rectangle = between(
            away_x * along_x + away_y * along_y, u * along_x + v * along_y, np.zeros_like(out), length
        ).also(between(out, outwards, np.zeros_like(out), np.broadcast_to(rounding, out.shape)))
        found += [_first_and_last(rectangle, rounded & real), _first_and_last(_near(away_x, away_y, u, v, rounding))]
    return Interval(np.min([each.start for each in found], axis=0), np.max([each.end for each in found], axis=0))


def _near(x: Array, y: Array, u: Array, v: Array, radius: Array) -> Interval:
    """Return when moving points are within a radius of the origin: the roots of |x + u t|^2 = r^2."""
    square, slope, gap = u * u + v * v, x * u + y * v, x * x + y * y - radius * radius
    moving = np.broadcast_to(square > 0.0, x.shape)
    safe = np.where(moving, square, 1.0)
    # How far the line passes from the origin, by a product without the cancellation of slope^2 - square gap.
    missed = (x * v - y * u) ** 2
    root = np.sqrt(np.maximum(radius * radius * safe - missed, 0.0))
    meets = np.where(moving, (missed <= radius * radius * safe), gap <= 0.0) & (radius > 0.0)
    start = np.where(moving, (-slope - root) / safe, -np.inf)
    end = np.where(moving, (-slope + root) / safe, np.inf)
    return _masked(Interval(start, end), meets)


def _masked(interval: Interval, some: Mask) -> Interval:
    """Return intervals selected by a mask, and empty ones elsewhere."""
    some = some & (interval.start <= interval.end)
    return Interval(np.where(some, interval.start, np.inf), np.where(some, interval.end, -np.inf))


def _first_and_last(intervals: Interval, some: Mask | bool = True) -> Interval:
    """Return the span of the intervals in each row; (m, k) to (m,)."""
    known = _masked(intervals, np.asarray(some))
    return Interval(known.start.min(axis=1), known.end.max(axis=1))
