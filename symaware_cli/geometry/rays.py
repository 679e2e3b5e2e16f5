"""Ray casting in the plane: distances along rays to convex pieces.

As in `symaware_cli.geometry.pieces`, pieces are convex cores rounded by a radius, seen from above.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.geometry.pieces import Pieces, following
from symaware_cli.geometry.scenery import Scenery
from symaware_cli.geometry.shape import Shape
from symaware_cli.geometry.vectors import Array, Indices, Mask

#: The number of pairs of a ray and a piece that are computed together, to bound memory.
_TOGETHER = 1 << 17

#: A whole turn [rad], and a greater angle between the rays of successive fans in one array.
_TURN, _APART = 2.0 * np.pi, 8.0


def nearest_hits(origins: Array, directions: Array, pieces: Pieces, source: Indices, piece: Indices) -> Array:
    """Return the distances along fans of rays to the nearest of some pieces.

    Args:
        origins: The origin of each fan [m]; shape (n, 2).
        directions: Unit vectors; shape (n, k, 2).
        pieces: The pieces.
        source: The fans in the pairs of a fan and a piece to test; shape (m,).
        piece: The pieces of these pairs, as rows of `pieces`; shape (m,).

    Returns:
        Distances [m], infinite if a ray hits none; 0 if it starts inside of a piece; shape (n, k).
    """
    count, width = directions.shape[:2]
    distances = np.full(count * width, np.inf)
    order, first, number = _windows(origins, directions, pieces, source, piece)
    ends = np.cumsum(number)
    start = 0
    while start < len(source):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _TOGETHER, "right")))
        some = slice(start, stop)
        one = np.repeat(source[some], number[some])
        within = np.arange(len(one)) - np.repeat(ends[some] - number[some] - done, number[some])
        ray = order[one, (np.repeat(first[some], number[some]) + within) % max(width, 1)]
        if len(ray):
            other = np.repeat(piece[some], number[some])
            hit = _entry(origins.take(one, 0), directions[one, ray], pieces.take(other))
            np.minimum.at(distances, one * width + ray, hit)
        start = stop
    return distances.reshape(count, width)


def _windows(
    origins: Array, directions: Array, pieces: Pieces, source: Indices, piece: Indices
) -> tuple[Indices, Indices, Indices]:
    """Find the rays of fans that can meet pieces: those between the directions of the outermost vertices.

    A map has hundreds of pieces within reach of a fan, and each is in the way of few of its rays. The windows are a
    little wider than the pieces, so that distances do not depend on the rounding of angles.

    Args:
        origins: See `nearest_hits`.
        directions: See `nearest_hits`.
        pieces: See `nearest_hits`.
        source: See `nearest_hits`.
        piece: See `nearest_hits`.

    Returns:
        The rays of each fan by ascending angle, (n, k); and for each pair the place of the first ray of its window in
        this order, (m,), and the number of rays from there on, cyclically, (m,).
    """
    width = directions.shape[1]
    angles = np.arctan2(directions[..., 1], directions[..., 0])
    order: Indices = np.argsort(angles, axis=1, kind="stable")
    # One ascending array for all fans.
    ranked = (np.take_along_axis(angles, order, 1) + _APART * np.arange(len(angles))[:, None]).ravel()
    low, high = pieces.bounds()
    to_centre = (0.5 * (low + high)).take(piece, 0) - origins.take(source, 0)
    to_vertex = pieces.vertices.take(piece, 0) - origins.take(source, 0)[:, None]
    rounding = pieces.rounding.take(piece)
    middle = np.arctan2(to_centre[:, 1], to_centre[:, 0])
    # Seen from outside of a convex piece, all of it is less than half a turn from the direction of its centre.
    turn = np.arctan2(_cross(to_centre[:, None], to_vertex), (to_centre[:, None] * to_vertex).sum(axis=2))
    distance = np.sqrt((to_vertex * to_vertex).sum(axis=2))
    nearest = np.maximum(distance.min(axis=1), 1e-12)
    extent = np.sqrt(((high - low) ** 2).sum(axis=1)).take(piece)
    spread = np.arcsin(np.minimum(rounding[:, None] / np.maximum(distance, 1e-12), 1.0))
    margin = 1e-9 * (1.0 + extent / nearest)
    least, most = (turn - spread).min(axis=1) - margin, (turn + spread).max(axis=1) + margin
    real = np.isfinite(pieces.offsets.take(piece, 0))
    heights = (pieces.normals.take(piece, 0) * origins.take(source, 0)[:, None]).sum(axis=2)
    outside = np.where(real, heights - np.where(real, pieces.offsets.take(piece, 0), 0.0), -np.inf).max(axis=1)
    is_outside = np.where(real.any(axis=1), outside, nearest) > rounding + 1e-9 * (1.0 + extent)
    whole = ~is_outside | (most - least >= _TURN)
    begin = np.remainder(middle + least + np.pi, _TURN) - np.pi
    end = begin + (most - least)
    around = end > np.pi
    fans = _APART * source
    first = np.searchsorted(ranked, fans + begin, "left") - source * width
    last = np.searchsorted(ranked, fans + np.where(around, end - _TURN, end), "right") - source * width
    number = np.where(whole, width, np.maximum(last - first + np.where(around, width, 0), 0))
    return order, np.where(whole, 0, first), np.minimum(number, width)


def _entry(origins: Array, directions: Array, pieces: Pieces) -> Array:
    """Return the distances at which rays enter pieces, row by row; (m, 2) each to (m,).

    A rounded polygon is the union of discs at its vertices, and of its edges moved outwards by the radius (with the
    area in between): the ray enters it where it first meets any of them.
    """
    # Coordinate by coordinate: reducing along an axis of two elements is several times as slow.
    rounding = pieces.rounding[:, None]
    vertex_x, vertex_y = pieces.vertices[..., 0], pieces.vertices[..., 1]
    normal_x, normal_y = pieces.normals[..., 0], pieces.normals[..., 1]
    origin_x, origin_y = origins[:, 0, None], origins[:, 1, None]
    along_x, along_y = directions[:, 0, None], directions[:, 1, None]
    to_x, to_y = vertex_x - origin_x, vertex_y - origin_y
    along = to_x * along_x + to_y * along_y
    squared = to_x * to_x + to_y * to_y
    beneath = rounding * rounding - squared + along * along
    half = np.sqrt(np.maximum(beneath, 0.0))
    meets = (beneath >= 0.0) & (along + half >= 0.0)
    discs = np.where(meets, np.maximum(along - half, 0.0), np.inf)
    real = np.isfinite(pieces.offsets)
    edge_x, edge_y = following(vertex_x) - vertex_x, following(vertex_y) - vertex_y
    speed = normal_x * along_x + normal_y * along_y
    # The distance of the ray's origin outside of each edge of the core.
    height = (normal_x * origin_x + normal_y * origin_y) - np.where(real, pieces.offsets, 0.0)
    inwards = real & (speed < 0.0) & (height >= rounding)
    distance = np.where(inwards, (rounding - height) / np.where(inwards, speed, -1.0), np.inf)
    reached = np.where(inwards, distance, 0.0)
    beside = _beside(reached * along_x - to_x, reached * along_y - to_y, edge_x, edge_y)
    sides = np.where(inwards & beside, distance, np.inf)
    inside = real.any(axis=1) & (~real | (height <= 0.0)).all(axis=1)
    near = real & (height >= 0.0) & (height <= rounding)
    if near.any():
        inside |= (near & _beside(-to_x, -to_y, edge_x, edge_y)).any(axis=1)
    return np.where(inside, 0.0, np.minimum(_least(discs), _least(sides)))


def _least(values: Array) -> Array:
    """Return the least of each row; column by column, which is faster for a few columns."""
    least: Array = np.minimum.reduce([values[:, column] for column in range(values.shape[1])])
    return least


def _beside(x: Array, y: Array, edge_x: Array, edge_y: Array) -> Mask:
    """Return whether points, relative to the starts of edges, project onto the edge; (m, k) each."""
    share, length = x * edge_x + y * edge_y, edge_x * edge_x + edge_y * edge_y
    # With a tolerance, so that no ray slips through between two edges.
    beside: Mask = (share >= -1e-12 * length) & (share <= (1.0 + 1e-12) * length)
    return beside


def _cross(one: Array, other: Array) -> Array:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]


class BodiesInPlane:
    """The outlines of all agents, seen from above."""

    def __init__(self, shapes: Sequence[Shape | None]) -> None:
        """Store the shape of each agent by index; None for those without one."""
        parts = [(index, piece) for index, shape in enumerate(shapes) if shape for piece in shape.pieces]
        self._owners: Indices = np.array([index for index, _ in parts], np.intp)
        self._shapes = Pieces.of(piece for _, piece in parts)

    def placed(self, positions: Array, headings: Array, present: Mask | None) -> tuple[Pieces, Indices]:
        """Return the outlines at the poses of the agents.

        Args:
            positions: The positions of all agents [m]; shape (n, d).
            headings: The headings of all agents [rad]; shape (n,).
            present: Which agents are present; shape (n,). None for all.

        Returns:
            Convex pieces, and for each the index of its agent, ascending; shape (p,).
        """
        owners, shapes = self._owners, self._shapes
        if present is not None:
            here = np.flatnonzero(present[owners])
            owners, shapes = owners[here], shapes.take(here)
        return shapes.placed(positions[:, :2].take(owners, 0), headings.take(owners)), owners


def rays_in_plane(
    senders: Indices,
    origins: Array,
    directions: Array,
    reach: float,
    bodies: Pieces,
    owners: Indices,
    scenery: Scenery,
) -> Array:
    """Measure rays against the bodies of agents and the scenery; see `Environment.ray_cast`.

    Args:
        senders: The agent that casts each fan; shape (n,).
        origins: The origins of the fans [m]; shape (n, d).
        directions: Unit vectors; shape (n, k, 2).
        reach: The greatest distance [m].
        bodies: The outlines of agents.
        owners: The agent of each of them; shape (p,).
        scenery: The obstacles.
    """
    origins = np.ascontiguousarray(origins[:, :2])
    if len(bodies):
        low, high = bodies.bounds()
        meets = ((low[None] <= origins[:, None] + reach) & (high[None] >= origins[:, None] - reach)).all(axis=2)
        meets &= senders[:, None] != owners
        hits = nearest_hits(origins, directions, bodies, *np.nonzero(meets))
    else:
        hits = np.full(directions.shape[:2], np.inf)
    if len(scenery):
        hits = np.minimum(hits, nearest_hits(origins, directions, scenery.pieces, *scenery.candidates(origins, reach)))
    return np.where(hits <= reach, hits, np.inf)
