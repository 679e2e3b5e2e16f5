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
    low, high = pieces.bounds()
    centres, reaches = 0.5 * (low + high), 0.5 * np.hypot(*(high - low).T)
    together = max(1, _TOGETHER // max(width, 1))
    for start in range(0, len(source), together):
        one, other = source[start : start + together], piece[start : start + together]
        to_centre = (centres.take(other, 0) - origins.take(one, 0))[:, None]
        towards = directions.take(one, 0)
        along, aside = (towards * to_centre).sum(axis=2), _cross(towards, to_centre)
        reach = reaches.take(other)[:, None]
        # Most rays miss the circle around a piece.
        row, ray = np.nonzero((np.abs(aside) <= reach) & (along >= -reach))
        if len(row):
            hit = _entry(origins.take(one.take(row), 0), towards[row, ray], pieces.take(other.take(row)))
            np.minimum.at(distances, one.take(row) * width + ray, hit)
    return distances.reshape(count, width)


def _entry(origins: Array, directions: Array, pieces: Pieces) -> Array:
    """Return the distances at which rays enter pieces, row by row; (m, 2) each to (m,).

    A rounded polygon is the union of discs at its vertices, and of its edges moved outwards by the radius (with the
    area in between): the ray enters it where it first meets any of them.
    """
    vertices, rounding = pieces.vertices, pieces.rounding[:, None]
    to_vertex = vertices - origins[:, None]
    along = (to_vertex * directions[:, None]).sum(axis=2)
    squared = (to_vertex * to_vertex).sum(axis=2)
    beneath = rounding * rounding - squared + along * along
    half = np.sqrt(np.maximum(beneath, 0.0))
    meets = (beneath >= 0.0) & (along + half >= 0.0)
    discs = np.where(meets, np.maximum(along - half, 0.0), np.inf)
    real = np.isfinite(pieces.offsets)
    edges = following(vertices) - vertices
    speed = (pieces.normals * directions[:, None]).sum(axis=2)
    # The distance of the ray's origin outside of each edge of the core.
    height = (pieces.normals * origins[:, None]).sum(axis=2) - np.where(real, pieces.offsets, 0.0)
    inwards = real & (speed < 0.0) & (height >= rounding)
    distance = np.where(inwards, (rounding - height) / np.where(inwards, speed, -1.0), np.inf)
    crossing = np.where(inwards, distance, 0.0)[..., None] * directions[:, None] - to_vertex
    sides = np.where(inwards & _beside(crossing, edges), distance, np.inf)
    inside = real.any(axis=1) & (~real | (height <= 0.0)).all(axis=1)
    inside |= (real & (height >= 0.0) & (height <= rounding) & _beside(-to_vertex, edges)).any(axis=1)
    return np.where(inside, 0.0, np.minimum(discs.min(axis=1), sides.min(axis=1)))


def _beside(points: Array, edges: Array) -> Mask:
    """Return whether points, relative to the starts of edges, project onto the edge; (m, k, 2) each."""
    share, length = (points * edges).sum(axis=2), (edges * edges).sum(axis=2)
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
