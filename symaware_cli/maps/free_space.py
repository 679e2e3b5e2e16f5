"""Free space: the positions and straight lines on which a disc touches no obstacle.

Reasons: docs/decisions/0095-planners-off-the-grid.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array, Indices, Mask, Pieces, Scenery, separation
from symaware_cli.specification import PlacedRegion

#: The least radius of a disc [m]: positive, so that not even a point passes between two obstacles that touch.
LEAST_RADIUS = 1e-9

#: Pairs of a line and a piece, or points of lines, that are measured together, to bound memory.
_TOGETHER = 1 << 16

#: Candidate positions for a body that is nearer to an obstacle than its radius: directions, and distances in radii.
_DIRECTIONS, _DISTANCES = 32, np.arange(1, 13) / 6.0

#: The relative distance between two points of a line at which its distance from a region is computed, in radii.
_SPACING = 0.5


class FreeSpace:
    """The positions and straight lines on which a disc touches no obstacle.

    Attributes:
        radius: The radius of the disc [m].
        reach: The limit up to which distances from obstacles are computed [m].
        scenery: The obstacles.
    """

    def __init__(self, obstacles: Mapping[str, Obstacle], radius: float, reach: float) -> None:
        """Place the obstacles; moving ones at their initial positions."""
        self.radius = max(radius, LEAST_RADIUS)
        self.reach = max(reach, self.radius)
        self.scenery = Scenery(obstacles)

    def clearances(self, points: Array) -> Array:
        """Return the distances of positions (m, 2) from the nearest obstacle [m], at most `reach`; shape (m,)."""
        found = np.full(len(points), self.reach)
        if len(self.scenery) and len(points):
            near = self.scenery.nearest(points, self.reach)
            np.minimum.at(found, near.row, near.distance)
        return found

    def clear(self, starts: Array, ends: Array, radius: float | None = None) -> Mask:
        """Return whether a disc on straight lines between points, (m, 2) each, touches no obstacle; shape (m,).

        Args:
            starts: The starts of the lines [m].
            ends: The ends of the lines [m].
            radius: The radius of the disc [m]; by default the radius of this space.
        """
        clear = np.ones(len(starts), bool)
        if not len(self.scenery) or not len(starts):
            return clear
        least = self.radius if radius is None else radius
        lengths = np.sqrt(((ends - starts) ** 2).sum(axis=1))
        line, piece = self.scenery.candidates(0.5 * (starts + ends), least + 0.5 * lengths)
        for first in range(0, len(line), _TOGETHER):
            one, other = line[first : first + _TOGETHER], piece[first : first + _TOGETHER]
            lines = Pieces.lines(starts.take(one, 0), ends.take(one, 0))
            touching = separation(lines, self.scenery.pieces.take(other)).distance < least
            clear[one[touching]] = False
        return clear

    def joined(self, points: Array, clearance: Array, first: Indices, second: Indices) -> Mask:
        """Return between which pairs of positions a disc can move; equal to `clear`, but faster.

        Clearance changes by at most the distance travelled, so only lines near obstacles need to be measured.

        Args:
            points: Positions [m]; shape (n, 2).
            clearance: The distances of the positions from obstacles [m]; shape (n,).
            first: The first position of each pair; shape (m,).
            second: The second position of each pair; shape (m,).

        Returns:
            Shape (m,).
        """
        starts, ends = points.take(first, 0), points.take(second, 0)
        lengths = np.sqrt(((ends - starts) ** 2).sum(axis=1))
        one, other = clearance.take(first), clearance.take(second)
        possible = np.minimum(one, other) >= self.radius
        doubtful = np.flatnonzero(possible & (0.5 * (one + other - lengths) < self.radius))
        possible[doubtful] = self.clear(starts[doubtful], ends[doubtful])
        return possible

    def freed(self, position: Array) -> Array | None:
        """Return the nearest candidate position that the disc fits in, (2,); the position itself if it is free.

        On the way there a body that is nearer to an obstacle than its radius counts as narrower, so that it can leave
        the obstacle.

        Returns:
            None if there is no such position within two radii, or the position itself is in an obstacle.
        """
        here = float(self.clearances(position[None])[0])
        if here >= self.radius:
            return position
        if here < 0.0:
            return None
        angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        outwards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = position + (self.radius * _DISTANCES[:, None, None] * outwards).reshape(-1, 2)
        fits = self.clearances(points) >= self.radius
        points = points[fits]
        possible = np.flatnonzero(self.clear(np.broadcast_to(position, points.shape), points, here))
        return points[possible[0]] if len(possible) else None

    def outside(self, starts: Array, ends: Array, regions: Sequence[PlacedRegion]) -> Mask:
        """Return whether a disc on straight lines between points, (m, 2) each, stays out of all regions; shape (m,).

        The depth of a point in a region changes by at most the distance travelled, so it is computed at some points of
        each line, and a line counts as reaching into a region if it may do so between two of them.
        """
        outside = np.ones(len(starts), bool)
        if not regions or not len(starts):
            return outside
        lengths = np.sqrt(((ends - starts) ** 2).sum(axis=1))
        spacing = max(_SPACING * self.radius, 1e-3 * float(lengths.max(initial=0.0)), 1e-6)
        counts = np.ceil(lengths / spacing).astype(np.intp) + 1
        together = max(1, _TOGETHER // int(counts.max()))
        for begin in range(0, len(starts), together):
            some = slice(begin, begin + together)
            line = np.repeat(np.arange(len(starts))[some], counts[some])
            number = np.arange(len(line)) - np.repeat(np.cumsum(counts[some]) - counts[some], counts[some])
            share = (number / np.maximum(counts[line] - 1, 1))[:, None]
            points = starts[line] + share * (ends - starts)[line]
            for region in regions:
                outside[line[region.robustness(points) > -(self.radius + 0.5 * spacing)]] = False
        return outside
