"""How far bodies were apart: from outline to outline, the least of all pairs at each instant.

Two bodies touch where this is 0, and overlap where it is negative. As in the world, round agents are balls, and agents
with corners count as seen from above once the balls around them meet; obstacles are seen from above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Shape
from symaware_cli.geometry.body_outlines import BodyOutlines
from symaware_cli.geometry.pieces import Pieces, separation
from symaware_cli.viewing.plotting.motion import Motion, Obstacles

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Beyond so many agents times instants, instants are left out; this takes some seconds.
_WORK = 2_000_000


@dataclass(frozen=True)
class LeastSeparation:
    """The least separation over time.

    Attributes:
        times: (m,) simulated time [ns].
        least: (m,) the least of all pairs, from outline to outline; negative where they overlap [m].
        pair: (m, 2) whose it is: an agent, and another agent or an obstacle, by index.
        centres: (m,) between the centres of these two [m]; NaN for obstacles.
        typical: (m,) the median over agents of the separation from whoever is nearest to each [m]; NaN for obstacles.
        every: One of how many recorded instants was looked at.
    """

    times: NDArray[np.int64]
    least: Array
    pair: Indices
    centres: Array
    typical: Array
    every: int

    @property
    def lowest(self) -> int:
        """The instant of the least separation of all, by index."""
        return int(np.nanargmin(self.least))


def among(motion: Motion) -> LeastSeparation | None:
    """Find how far agents are apart; None where there are no two."""
    count = motion.positions.shape[1]
    if count < 2:
        return None
    steps, every = _instants(motion, count)
    everybody = _Nearest(motion.shapes)
    rows = len(steps)
    least, centres, typical = np.full(rows, np.nan), np.full(rows, np.nan), np.full(rows, np.nan)
    pair = np.zeros((rows, 2), np.intp)
    for row, step in enumerate(steps.tolist()):
        positions = motion.positions[step]
        present = np.flatnonzero(~np.isnan(positions[:, 0]))
        if len(present) < 2:
            continue
        gap, other = everybody.of(present, positions[present], motion.headings[step, present])
        one = int(gap.argmin())
        pair[row] = present[one], present[other[one]]
        least[row], typical[row] = gap[one], np.median(gap)
        centres[row] = np.linalg.norm(positions[pair[row, 0]] - positions[pair[row, 1]])
    if np.isnan(least).all():
        return None
    return LeastSeparation(motion.times[steps], least, np.sort(pair, axis=1), centres, typical, every)


def from_obstacles(motion: Motion, obstacles: Obstacles) -> LeastSeparation | None:
    """Find how far agents are from obstacles; None where there are none."""
    agents, count = motion.positions.shape[1], len(obstacles.obstacle_views)
    if not agents or not count:
        return None
    listed = [
        (number, piece)
        for number, obstacle_view in enumerate(obstacles.obstacle_views)
        for piece in obstacle_view.shape.pieces
    ]
    owner = np.array([number for number, _ in listed], np.intp)
    pieces = Pieces.of(piece for _, piece in listed)
    steps, every = _instants(motion, agents * len(owner) // 16)
    bodies = _Nearest(motion.shapes).bodies
    least, pair = np.full(len(steps), np.nan), np.zeros((len(steps), 2), np.intp)
    still = not any(obstacles.moves(number) for number in range(count))
    for row, step in enumerate(steps.tolist()):
        if row == 0 or not still:
            placed = pieces.placed(obstacles.positions[step, owner, :2], obstacles.headings[step, owner])
            low, high = placed.bounds()
        points = motion.positions[step, :, :2]
        present = np.flatnonzero(~np.isnan(points[:, 0]))
        if not len(present):
            continue
        points, headings, everywhere = points[present], motion.headings[step], points
        outside = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
        inside = np.maximum(np.minimum(points[:, None] - low, high - points[:, None]).min(axis=2), 0.0)
        # A body is at least as far from a piece as the ball around it is from the rectangle around the piece.
        bound = np.hypot(outside[..., 0], outside[..., 1]) - inside - bodies.radii[present, None]
        one, piece = (np.array([place]) for place in divmod(int(bound.argmin()), len(owner)))
        first = separation(bodies.placed(present[one], everywhere, headings), placed.take(piece)).distance
        one, piece = np.nonzero(bound <= first[0] + 1e-9)  # so that rounding leaves at least that pair
        gaps = separation(bodies.placed(present[one], everywhere, headings), placed.take(piece)).distance
        best = int(gaps.argmin())
        least[row], pair[row] = gaps[best], (present[one[best]], owner[piece[best]])
    if np.isnan(least).all():
        return None
    nothing = np.full(len(steps), np.nan)
    return LeastSeparation(motion.times[steps], least, pair, nothing, nothing, every)


class _Nearest:
    """Who is nearest to each agent."""

    def __init__(self, shapes: Sequence[Shape | None]) -> None:
        self.bodies = BodyOutlines([shape.pieces[0] if shape else None for shape in shapes])
        self._alike = not self.bodies.any_cornered and len(set(self.bodies.radii.tolist())) == 1

    def of(self, agents: Indices, positions: Array, headings: Array) -> tuple[Array, Indices]:
        """Find who is nearest to each.

        Args:
            agents: (m,) by index.
            positions: (m, 3) [m].
            headings: (m,) [rad].

        Returns:
            The separation (m,) and who it is, as rows of what was given (m,).
        """
        from scipy.spatial import cKDTree

        count, radii = len(agents), self.bodies.radii[agents]
        everybody, turned = np.zeros((len(self.bodies), 3)), np.zeros(len(self.bodies))
        everybody[agents], turned[agents] = positions, headings
        tree, rows = cKDTree(positions), np.arange(count)
        asked = 2 if self._alike else min(count, 6)
        while True:
            apart, other = (np.asarray(found) for found in tree.query(positions, k=asked))
            one = np.repeat(agents, asked)
            gaps = self.bodies.gaps(one, agents[other.ravel()], apart.ravel(), everybody, turned).reshape(apart.shape)
            gaps[other == rows[:, None]] = np.inf
            best = gaps.argmin(axis=1)
            gap = gaps[rows, best]
            # Whoever was not looked at is farther away than the last who was.
            if asked == count or (gap <= apart[:, -1] - radii - radii.max()).all():
                return gap, other[rows, best]
            asked = min(count, 2 * asked)


def _instants(motion: Motion, work: int) -> tuple[Indices, int]:
    """Choose the instants to look at, by index, given how much there is to look at in each."""
    every = max(1, -(-len(motion.times) * work // _WORK))
    last = len(motion.times) - 1
    return np.unique(np.append(np.arange(0, last + 1, every), last)), every
