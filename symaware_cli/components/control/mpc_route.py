"""Routes: shortest paths around static obstacles, by a visibility graph of their corners."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Environment
from symaware_cli.geometry.pieces import Pieces, crosses, separation_from_points

Array = NDArray[np.float64]

#: In distances to keep: the distance of corners, and the clearance of straight lines. The difference is how far a
#: vehicle may deviate without losing its route.
_CORNERS, _LINES = 1.05, 0.9

#: The number of corners around a disc.
_DISC_CORNERS = 8

#: With more pieces than this, the visibility graph is too large.
_MOST_PIECES = 50


def standing(environment: Environment) -> Pieces:
    """Return the pieces of static obstacles."""
    scenery = environment.scenery
    entities = [environment.obstacles[name] for name in scenery.names]
    rests = [each.path is None and each.mass is None for each in entities]
    return scenery.pieces.take(np.flatnonzero(np.array(rests, bool)[scenery.owner]))


class Routes:
    """The visibility graph of the corners of obstacles: straight lines that no obstacle blocks.

    A shortest path among polygons consists of such lines (T. Lozano-Pérez, M. A. Wesley, "An algorithm for planning
    collision-free paths among polyhedral obstacles", Communications of the ACM 22, 1979). Obstacles are grown by the
    distance to keep, with polygons around roundings. Heights are ignored.
    """

    def __init__(self, pieces: Pieces, keep: float) -> None:
        """Compute the distances between all pairs of corners.

        Args:
            pieces: The obstacles; more than fifty are ignored.
            keep: Distance to keep from them [m].
        """
        few = len(pieces) <= _MOST_PIECES
        self._grown = Pieces(pieces.vertices, pieces.normals, pieces.offsets, pieces.rounding + _LINES * keep)
        corners = _corners(pieces, _CORNERS * keep) if few else np.empty((0, 2))
        count = len(corners)
        inside = np.zeros(count, bool)
        for piece in range(len(pieces)) if few else ():
            one = self._grown.take(np.full(count, piece))
            inside |= separation_from_points(corners, np.zeros(count), one).distance < 0.0
        self._corners = np.unique(corners[~inside], axis=0)
        self._lengths = np.array([self.distances(corner, self._corners) for corner in self._corners])
        if len(self._corners):
            np.fill_diagonal(self._lengths, np.inf)

    def distances(self, origin: Array, targets: Array) -> Array:
        """Return the distances of points (m, 2) from one [m], infinite behind an obstacle; shape (m,)."""
        grown = self._grown
        ways = targets - origin
        low, high = grown.bounds()
        meets = (np.minimum(targets, origin)[:, None] <= high) & (np.maximum(targets, origin)[:, None] >= low)
        line, piece = np.nonzero(meets.all(axis=2))
        hidden = np.zeros(len(targets), bool)
        lines = Pieces.lines(np.broadcast_to(origin, (len(line), 2)), targets[line])
        hidden[line[crosses(lines, grown.take(piece))]] = True
        return np.where(hidden, np.inf, np.sqrt(np.square(ways).sum(axis=1)))

    def to(self, target: Array) -> Route:
        """Return the shortest paths to a point [m], shape (2,)."""
        return Route(self, target, self._corners, self._lengths)


class Route:
    """The shortest paths from any position to one point."""

    def __init__(self, routes: Routes, target: Array, corners: Array, lengths: Array) -> None:
        """Compute the distance from each corner.

        Args:
            routes: The visibility graph.
            target: The point [m]; shape (2,).
            corners: The corners [m]; shape (c, 2).
            lengths: The distance between each two of them, infinite if blocked [m]; shape (c, c).
        """
        self._routes = routes
        self._target = target
        self._corners = corners
        self._lengths = lengths
        self._straight = routes.distances(target, corners)
        remaining = self._straight
        # Add one line in each iteration, until no path gets shorter.
        while len(corners):
            shorter = np.minimum(remaining, (lengths + remaining).min(axis=1))
            if (shorter == remaining).all():
                break
            remaining = shorter
        self._remaining = remaining

    def by_way_of(self, position: Array) -> Array:
        """Return the corners to pass from a position [m], shape (2,); none if the path is straight or blocked.

        Returns:
            Shape (w, 2).
        """
        nothing = np.empty((0, 2))
        if not len(self._corners) or np.isfinite(self._routes.distances(position, self._target[None]))[0]:
            return nothing
        ways = self._routes.distances(position, self._corners) + self._remaining
        corner = int(ways.argmin())
        if not np.isfinite(ways[corner]):
            return nothing
        passed = [corner]
        while self._straight[corner] > self._remaining[corner]:
            corner = int((self._lengths[corner] + self._remaining).argmin())
            passed.append(corner)
        return self._corners[passed]


def _corners(pieces: Pieces, distance: float) -> Array:
    """Return points around each piece, such that lines between neighbours keep the distance [m]; shape (c, 2)."""
    corners: list[Array] = []
    for vertices, normals, rounding in zip(pieces.vertices, pieces.normals, pieces.rounding, strict=True):
        radius = distance + rounding
        real = np.flatnonzero(np.abs(normals).max(axis=1) > 0.0)
        if not len(real):
            angles = 2 * np.pi * np.arange(_DISC_CORNERS) / _DISC_CORNERS
            around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            corners.extend(vertices[0] + radius / np.cos(np.pi / _DISC_CORNERS) * around)
            continue
        for before, after in _neighbours(real.tolist()):
            corners.extend(vertices[after] + radius * each for each in _outwards(normals[before], normals[after]))
    return np.array(corners).reshape(-1, 2)


def _neighbours(edges: Sequence[int]) -> list[tuple[int, int]]:
    """Return each edge of a polygon with the next one."""
    return [*pairwise(edges), (edges[-1], edges[0])]


def _outwards(before: Array, after: Array) -> list[Array]:
    """Return the corners around a vertex between two edges of given normals, for a distance of one."""
    cosine = float(before @ after)
    if cosine >= 0.0:
        return [(before + after) / (1.0 + cosine)]
    # A sharp vertex gets two corners, since its tip would be far out; the lines continue along the edges.
    along = np.array([-before[1], before[0]])
    back = np.array([after[1], -after[0]])
    return [before + along, after + back]
