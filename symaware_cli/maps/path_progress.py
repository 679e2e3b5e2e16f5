"""The progress of agents on their paths, by which a planner notices that they are held up.

Reasons: docs/decisions/0110-held-up-on-a-path.md
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Array, Indices, Mask

Instants = NDArray[np.int64]


class PathProgress(NamedTuple):
    """The progress of agents: the remaining lengths of their paths, and when these were last shortened.

    Attributes:
        left: The length of the rest of the path then [m]; infinite at first; shape (n,).
        since: That instant [ns]; shape (n,).
    """

    left: Array
    since: Instants

    @classmethod
    def none(cls, count: int, now: int = 0) -> PathProgress:
        """Return the progress of agents that have just got their paths."""
        return cls(np.full(count, np.inf), np.full(count, now, np.int64))

    def after(self, left: Array, now: int, least: float) -> PathProgress:
        """Return the progress at a later instant.

        Args:
            left: The lengths of the rests of the paths [m]; shape (n,).
            now: The instant [ns].
            least: By how much the rest has to become shorter to count as progress [m].
        """
        nearer: Mask = left <= self.left - least
        return PathProgress(np.where(nearer, left, self.left), np.where(nearer, now, self.since))

    def restarted(self, rows: Indices, now: int) -> PathProgress:
        """Return the progress after some agents have got new paths, or are to be given more time."""
        left, since = self.left.copy(), self.since.copy()
        left[rows], since[rows] = np.inf, now
        return PathProgress(left, since)


def lengths_left(corners: Array, counts: Indices, positions: Array) -> Array:
    """Return the lengths of the rests of paths: from positions to the corners after the segments nearest to them.

    Args:
        corners: The corners of the paths, padded by repeating the last [m]; shape (n, k, 2).
        counts: Their numbers; shape (n,). Without any, nothing is left.
        positions: Where the agents are [m]; shape (n, 2).
    """
    if corners.ndim != 3 or corners.shape[1] < 1:
        return np.zeros(len(positions))
    rows, legs = np.arange(len(corners)), np.diff(corners, axis=1)
    length = np.sqrt((legs * legs).sum(axis=2))
    following = np.zeros(len(corners), np.intp)
    if legs.shape[1]:
        square = np.where(length > 0.0, length * length, 1.0)
        share = np.clip(((positions[:, None] - corners[:, :-1]) * legs).sum(axis=2) / square, 0.0, 1.0)
        away = corners[:, :-1] + share[..., None] * legs - positions[:, None]
        following = (away * away).sum(axis=2).argmin(axis=1) + 1
    travelled = np.concatenate([np.zeros((len(corners), 1)), np.cumsum(length, axis=1)], axis=1)
    way = corners[rows, following] - positions
    left = np.sqrt((way * way).sum(axis=1)) + travelled[:, -1] - travelled[rows, following]
    return np.where(counts > 0, left, 0.0)
