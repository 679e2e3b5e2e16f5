"""Convex pieces in the plane: distances and overlaps of shapes, and lines that cross them.

Every shape consists of convex *pieces*: a core of one point, two points or a convex polygon, rounded by a radius. A
disc is a rounded point, a segment of a wall a rounded line, a box a polygon with rounding 0. The signed distance of
two pieces is that of their cores minus both radii, whether they overlap or not.

Positions in space are seen from above: only their first two coordinates count.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.geometry.vectors import Array, Indices, Mask

#: [m] Smaller distances count as rounding errors.
_TINY = 1e-12

#: [m] Deeper overlaps are no rounding errors.
_CERTAIN = 1e-9

Element = TypeVar("Element", bound=np.generic)


class Pieces:
    """Convex pieces, one in each row, padded to the same number of vertices.

    Attributes:
        vertices: The core of each, counter-clockwise [m]; shape (m, k, 2). Padded by repeating the last.
        normals: The outward unit normal of the edge from each vertex to the next; shape (m, k, 2). Zero without an
            edge.
        offsets: The offset of each edge along its normal [m]; shape (m, k). Infinite without an edge.
        rounding: The radius that rounds each core [m]; shape (m,).
    """

    __slots__ = ("normals", "offsets", "rounding", "vertices")

    def __init__(self, vertices: Array, normals: Array, offsets: Array, rounding: Array) -> None:
        self.vertices = vertices
        self.normals = normals
        self.offsets = offsets
        self.rounding = rounding

    @classmethod
    def of(cls, pieces: Iterable[tuple[Sequence[Sequence[float]] | Array, float]]) -> Pieces:
        """Create pieces from cores and radii, such as `Shape.pieces`."""
        listed = list(pieces)
        width = max((len(core) for core, _ in listed), default=1)
        vertices = np.zeros((len(listed), width, 2))
        for row, (core, _) in enumerate(listed):
            vertices[row] = [*core, *[core[-1]] * (width - len(core))]
        edges = np.roll(vertices, -1, axis=1) - vertices
        length = np.sqrt(edges[..., 0] ** 2 + edges[..., 1] ** 2)
        real = length > 0.0
        normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1) / np.where(real, length, 1.0)[..., None]
        offsets = np.where(real, (normals * vertices).sum(axis=2), np.inf)
        for row, (core, _) in enumerate(listed):
            if len(core) == 2:
                # Exactly opposite, so that no point is on the inner side of both.
                back = int(np.flatnonzero(real[row])[1])
                normals[row, back], offsets[row, back] = -normals[row, 0], -offsets[row, 0]
        return cls(vertices, normals, offsets, np.array([rounding for _, rounding in listed], float))

    @classmethod
    def points(cls, positions: Array, rounding: ArrayLike = 0.0) -> Pieces:
        """Return discs at positions (m, 2), by default points."""
        count = len(positions)
        radii: Array = np.broadcast_to(np.asarray(rounding, float), (count,))
        return cls(positions[:, None, :], np.zeros((count, 1, 2)), np.full((count, 1), np.inf), radii)

    @classmethod
    def lines(cls, origins: Array, targets: Array) -> Pieces:
        """Return straight lines from origins to targets, (m, 2) each, without thickness."""
        along = targets - origins
        length = np.sqrt(along[:, 0] ** 2 + along[:, 1] ** 2)
        real = length > 0.0
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.where(real, length, 1.0)[:, None]
        offset = np.where(real, (normal * origins).sum(axis=1), np.inf)
        opposite = np.where(real, -offset, np.inf)
        return cls(
            np.stack([origins, targets], axis=1),
            np.stack([normal, -normal], axis=1),
            np.stack([offset, opposite], axis=1),
            np.zeros(len(origins)),
        )

    def __len__(self) -> int:
        return len(self.vertices)

    def take(self, rows: Indices) -> Pieces:
        """Return the given rows, possibly repeated."""
        return Pieces(
            self.vertices.take(rows, 0),
            self.normals.take(rows, 0),
            self.offsets.take(rows, 0),
            self.rounding.take(rows),
        )

    def placed(self, positions: Array, headings: Array) -> Pieces:
        """Turn each about the origin by a heading [rad], shape (m,), and move it to a position [m], shape (m, 2)."""
        cosine, sine = np.cos(headings), np.sin(headings)
        vertices = _turned(self.vertices, cosine, sine) + positions[:, None, :]
        normals = _turned(self.normals, cosine, sine)
        offsets = self.offsets + (normals * positions[:, None, :]).sum(axis=2)
        return Pieces(vertices, normals, offsets, self.rounding)

    def bounds(self) -> tuple[Array, Array]:
        """Return the least and the greatest coordinates of each [m]; both of shape (m, 2)."""
        rounding = self.rounding[:, None]
        return self.vertices.min(axis=1) - rounding, self.vertices.max(axis=1) + rounding


def _turned(vectors: Array, cosine: Array, sine: Array) -> Array:
    """Turn vectors (m, k, 2) counter-clockwise, each row by its angle."""
    x, y = vectors[..., 0], vectors[..., 1]
    cosine, sine = cosine[:, None], sine[:, None]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def following(values: NDArray[Element]) -> NDArray[Element]:
    """Shift rows by one element to the left; like `numpy.roll`, several times as fast."""
    return np.concatenate([values[:, 1:], values[:, :1]], axis=1)


class Separation(NamedTuple):
    """The distances between pairs of pieces, and their nearest points.

    Attributes:
        distance: The distance of each pair [m]; if they overlap the negative depth, which is the shortest displacement
            that separates them; shape (m,).
        first: The point on the outline of the first that is nearest to the second, or deepest in it [m]; shape (m, 2).
        second: The corresponding point on the outline of the second [m]; shape (m, 2).
    """

    distance: Array
    first: Array
    second: Array


def separation(first: Pieces, second: Pieces) -> Separation:
    """Measure pairs of pieces, row by row.

    The overlap of cores is found by separating axes: the gap along the best normal of an edge (C. Ericson, Real-Time
    Collision Detection, 2005, 5.2.1). Overlapping cores are moved apart along it; the remaining distance is that of a
    vertex of one from an edge of the other (5.1.2). If several points are equally near, as with parallel edges, their
    mean is returned.

    Args:
        first: The first piece of each pair.
        second: The second piece; as many.
    """
    if first.vertices.shape[1] == 1:
        return separation_from_points(first.vertices[:, 0], first.rounding, second)
    gap, axis = _widest_gap(first, second)
    overlaps = (gap <= 0.0) & np.isfinite(gap)
    shift = np.where(overlaps, -gap, 0.0)[:, None] * axis
    one, other = _closest(first.vertices, second.vertices + shift[:, None, :])
    towards = other - one
    apart = np.sqrt(towards[:, 0] ** 2 + towards[:, 1] ** 2)
    direction = np.where((apart > _TINY)[:, None], towards / np.maximum(apart, _TINY)[:, None], axis)
    # Cores on a common line have the gap 0 along its normal, though they may be far apart on it.
    core = np.where(overlaps, gap, 0.0) + apart
    distance = core - first.rounding - second.rounding
    one = one + first.rounding[:, None] * direction
    other = other - shift - second.rounding[:, None] * direction
    return Separation(distance, one, other)


def separation_from_points(points: Array, rounding: Array, pieces: Pieces) -> Separation:
    """Do the same as `separation` for first pieces whose cores are points (m, 2), in fewer operations."""
    vertices = pieces.vertices
    count, width, _ = vertices.shape
    x, y = points[:, 0, None] - vertices[..., 0], points[:, 1, None] - vertices[..., 1]
    if width > 1:
        edges = following(vertices) - vertices
        edge_x, edge_y = edges[..., 0], edges[..., 1]
        length = edge_x * edge_x + edge_y * edge_y
        share = (x * edge_x + y * edge_y) / np.maximum(length, np.finfo(float).tiny)
        share = np.minimum(np.maximum(share, 0.0), 1.0)
        x, y = x - share * edge_x, y - share * edge_y
    squared = x * x + y * y
    best = squared.argmin(axis=1) + width * np.arange(count)
    away = np.stack([x.take(best), y.take(best)], axis=1)
    apart = np.sqrt(squared.take(best))
    normals = pieces.normals.reshape(-1, 2)
    sign: Array | float = 1.0
    if width > 1:
        sides = pieces.normals[..., 0] * points[:, 0, None] + pieces.normals[..., 1] * points[:, 1, None]
        sign = np.where((sides - pieces.offsets).max(axis=1) >= 0.0, 1.0, -1.0)
        sign[np.isinf(pieces.offsets).all(axis=1)] = 1.0
    core = sign * apart
    if apart.min(initial=1.0) > _TINY:
        outwards = away / core[:, None]
    else:
        some = apart > _TINY
        outwards = np.where(some[:, None], away / np.where(some, core, 1.0)[:, None], normals.take(best, 0))
        outwards[~some & (np.abs(outwards).max(axis=1) == 0.0)] = (1.0, 0.0)
    return Separation(
        core - rounding - pieces.rounding,
        points - rounding[:, None] * outwards,
        points - away + pieces.rounding[:, None] * outwards,
    )


def _widest_gap(first: Pieces, second: Pieces) -> tuple[Array, Array]:
    """Return the widest gap between two cores along the normal of an edge, and that normal, from first to second.

    If neither has an edge, the gap is minus infinity, and the normal is the x axis.
    """
    one = _products(first.normals, second.vertices).min(axis=2) - first.offsets
    other = _products(second.normals, first.vertices).min(axis=2) - second.offsets
    gaps = np.concatenate([one, other], axis=1)
    normals = np.concatenate([first.normals, -second.normals], axis=1)
    rows, best = np.arange(len(gaps)), gaps.argmax(axis=1)
    gap, axis = gaps[rows, best], normals[rows, best]
    axis[np.isneginf(gap)] = (1.0, 0.0)
    return gap, axis


def _products(ones: Array, others: Array) -> Array:
    """Return the scalar products of all pairs of vectors: (m, a, 2) and (m, b, 2) to (m, a, b)."""
    return ones[:, :, None, 0] * others[:, None, :, 0] + ones[:, :, None, 1] * others[:, None, :, 1]


def _closest(first: Array, second: Array) -> tuple[Array, Array]:
    """Return the closest points of cores that do not overlap, (m, a, 2) and (m, b, 2); two arrays of shape (m, 2)."""
    on_second, on_first = _on_edges(first, second), _on_edges(second, first)
    shape = (len(first), first.shape[1] * second.shape[1], 2)
    corners_of_first = np.broadcast_to(first[:, :, None, :], on_second.shape)
    corners_of_second = np.broadcast_to(second[:, :, None, :], on_first.shape)
    ones = np.concatenate([corners_of_first.reshape(shape), on_first.reshape(shape)], axis=1)
    others = np.concatenate([on_second.reshape(shape), corners_of_second.reshape(shape)], axis=1)
    difference = others - ones
    distance = np.sqrt(difference[..., 0] ** 2 + difference[..., 1] ** 2)
    nearest = distance <= distance.min(axis=1, keepdims=True) + _TINY
    weights = (nearest / nearest.sum(axis=1, keepdims=True))[..., None]
    return (weights * ones).sum(axis=1), (weights * others).sum(axis=1)


def _on_edges(points: Array, vertices: Array) -> Array:
    """Return the point of each edge that is nearest to each point: (m, p, 2) and (m, k, 2) to (m, p, k, 2)."""
    edges = np.roll(vertices, -1, axis=1) - vertices
    length = np.maximum((edges * edges).sum(axis=2), np.finfo(float).tiny)
    along = _products(points, edges) - (vertices * edges).sum(axis=2)[:, None, :]
    share = np.clip(along / length[:, None, :], 0.0, 1.0)
    on_edges: Array = vertices[:, None, :, :] + share[..., None] * edges[:, None, :, :]
    return on_edges


def crosses(lines: Pieces, pieces: Pieces) -> Mask:
    """Return whether straight lines cross the inside of pieces, row by row; shape (m,)."""
    gap, _ = _widest_gap(lines, pieces)
    # The gap is never wider than the distance, so it decides most rows.
    through = (gap < -_CERTAIN) & np.isfinite(gap)
    unclear = np.flatnonzero(~through & (gap < pieces.rounding))
    if len(unclear):
        through[unclear] = separation(lines.take(unclear), pieces.take(unclear)).distance < -_TINY
    return through
