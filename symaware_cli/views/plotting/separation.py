"""Separation of bodies over time: the least distance between two outlines at each instant.

The separation is 0 if two bodies touch, and negative if they overlap. As in the world, round agents are balls, and
agents with corners are compared from above once their bounding balls meet; obstacles are compared from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import BodyOutlines, Pieces, separation
from symaware_cli.views.plotting.motion import Motion, Obstacles

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Maximum number of agents times instants, which takes some seconds; with more, instants are omitted.
_WORK = 2_000_000


@dataclass(frozen=True)
class LeastSeparation:
    """The least separation over time.

    Attributes:
        times: (m,) simulated time [ns].
        least: (m,) the minimum over all pairs, between outlines; negative if they overlap [m].
        pair: (m, 2) the indices of that pair: an agent, and another agent or an obstacle.
        centres: (m,) the distance between the centres of that pair [m]; NaN for obstacles.
        typical: (m,) the median over agents of the separation from the nearest other agent [m]; NaN for obstacles.
        every: One in this number of recorded instants was evaluated.
    """

    times: NDArray[np.int64]
    least: Array
    pair: Indices
    centres: Array
    typical: Array
    every: int

    @property
    def lowest(self) -> int:
        """The index of the instant of the minimum separation."""
        return int(np.nanargmin(self.least))


def among(motion: Motion) -> LeastSeparation | None:
    """Return the separation between agents; None with fewer than two agents."""
    count = motion.positions.shape[1]
    if count < 2:
        return None
    steps, every = _instants(motion, count)
    all_bodies, rows = _bodies(motion), len(steps)
    least, centres, typical = np.full(rows, np.nan), np.full(rows, np.nan), np.full(rows, np.nan)
    pair = np.zeros((rows, 2), np.intp)
    for row, step in enumerate(steps.tolist()):
        positions = motion.positions[step]
        present = np.flatnonzero(~np.isnan(positions[:, 0]))
        if len(present) < 2:
            continue
        bodies = all_bodies if len(present) == count else all_bodies.some(present)
        gap, other = bodies.nearest_to_each(positions[present], motion.headings[step, present])
        one = int(gap.argmin())
        pair[row] = present[one], present[other[one]]
        least[row], typical[row] = gap[one], np.median(gap)
        centres[row] = np.linalg.norm(positions[pair[row, 0]] - positions[pair[row, 1]])
    if np.isnan(least).all():
        return None
    return LeastSeparation(motion.times[steps], least, np.sort(pair, axis=1), centres, typical, every)


def from_obstacles(motion: Motion, obstacles: Obstacles) -> LeastSeparation | None:
    """Return the separation of agents from obstacles; None if there are none."""
    agents, count = motion.positions.shape[1], len(obstacles.names)
    if not agents or not count:
        return None
    listed = [(number, piece) for number, pieces in enumerate(obstacles.pieces) for piece in pieces]
    owner = np.array([number for number, _ in listed], np.intp)
    pieces = Pieces.of(piece for _, piece in listed)
    steps, every = _instants(motion, agents * len(owner) // 16)
    bodies = _bodies(motion)
    least, pair = np.full(len(steps), np.nan), np.zeros((len(steps), 2), np.intp)
    still = not any(obstacles.moves(number) for number in range(count))
    for row, step in enumerate(steps.tolist()):
        if row == 0 or not still:
            placed = pieces.placed(obstacles.positions[step, owner, :2], obstacles.headings[step, owner])
            low, high = placed.bounds()
        everywhere, headings = motion.positions[step, :, :2], motion.headings[step]
        present = np.flatnonzero(~np.isnan(everywhere[:, 0]))
        if not len(present):
            continue
        points = everywhere[present]
        outside = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
        inside = np.maximum(np.minimum(points[:, None] - low, high - points[:, None]).min(axis=2), 0.0)
        # A body is at least as far from a piece as its bounding ball is from the bounding rectangle of the piece.
        bound = np.hypot(outside[..., 0], outside[..., 1]) - inside - bodies.radii[present, None]
        one, piece = (np.array([place]) for place in divmod(int(bound.argmin()), len(owner)))
        first = separation(bodies.placed(present[one], everywhere, headings), placed.take(piece)).distance
        one, piece = np.nonzero(bound <= first[0] + 1e-9)  # keeps at least that pair despite rounding
        gaps = separation(bodies.placed(present[one], everywhere, headings), placed.take(piece)).distance
        best = int(gaps.argmin())
        least[row], pair[row] = gaps[best], (present[one[best]], owner[piece[best]])
    if np.isnan(least).all():
        return None
    nothing = np.full(len(steps), np.nan)
    return LeastSeparation(motion.times[steps], least, pair, nothing, nothing, every)


def _bodies(motion: Motion) -> BodyOutlines:
    return BodyOutlines([shape.pieces[0] if shape else None for shape in motion.shapes])


def _instants(motion: Motion, work: int) -> tuple[Indices, int]:
    """Return the indices of the instants to evaluate, given the work for each, and the stride between them."""
    every = max(1, -(-len(motion.times) * work // _WORK))
    last = len(motion.times) - 1
    return np.unique(np.append(np.arange(0, last + 1, every), last)), every
