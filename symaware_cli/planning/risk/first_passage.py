"""Bounds of the probability that a state ever leaves half spaces, at any of several instants."""

from __future__ import annotations

import numpy as np

from symaware_cli.geometry import Array, Mask
from symaware_cli.planning.risk.state_conditions import HalfSpaces, Tail, exceeding

#: Slopes that differ by no more than this part of their size are equal.
_EQUAL = 1e-9


class FirstPassage:
    """Bounds the probability that rows leave one of several half spaces at any instant of a sequence.

    As long as the slope s of a half space is the same and deviations add up along it (s A = s for each transition A),
    its margin is a constant of each instant plus a sum of independent symmetric terms. Then the probability of a
    negative margin at any of these instants is at most

    - the sum of the probabilities at each instant (Boole's inequality), and
    - twice the probability that the sum at the last instant exceeds the least mean (P. Levy's inequality); without an
      assumption about the distribution, once the bound that F. P. Cantelli's inequality gives for that, because it
      holds for the greatest of the sums, too (J. L. Doob's inequality).

    The lesser of the two counts. It is that of Levy for an agent that stands in noise for a long time: where it is at
    an instant, it nearly is at the next one. Half spaces and spans of time with another slope add up.
    """

    def __init__(self, tail: Tail) -> None:
        self._tail = tail
        #: The sum over spans of time that are over; shape (R,).
        self._before: Array | None = None
        # Of the present span, each of shape (k, R): whether there is one, the sum of its probabilities, its least mean,
        # and the last deviation; and its slopes, of shape (k, R, nx).
        self._open: Mask
        self._sum: Array
        self._least: Array
        self._deviation: Array
        self._slopes: Array

    def add(self, sides: HalfSpaces, mean: Array, covariance: Array, carried: Array, instants: Array) -> Array:
        """Add an instant, or several instants with the same mean and deviations no greater than the last one.

        Args:
            sides: The half spaces; as many for each call.
            mean: Shape (R, nx).
            covariance: At the last of the instants; shape (R, nx, nx).
            carried: The slopes s A since the instant before; shape (k, R, nx).
            instants: The number of these instants that count; shape (R,).

        Returns:
            The sum of the probabilities at these instants; shape (R,).
        """
        margins, deviations = sides.margins(mean), sides.deviations(covariance)
        counts = np.isfinite(margins) & (instants > 0)
        fails = exceeding(np.where(counts, margins, 1.0), deviations, self._tail)[0]
        added = np.where(counts, instants * fails, 0.0)
        if self._before is None:
            self._before = np.zeros(len(mean))
            self._open = np.zeros(counts.shape, bool)
            self._sum, self._least, self._deviation = np.zeros((3, *counts.shape))
            self._slopes = np.zeros(sides.slopes.shape)
        size = _EQUAL * (1.0 + np.abs(sides.slopes).max(axis=2))
        continues = self._open & counts
        for slopes in (self._slopes, carried):
            continues &= np.abs(slopes - sides.slopes).max(axis=2) <= size
        self._before = self._before + np.where(self._open & ~continues, self._of_span(), 0.0).sum(axis=0)
        self._sum = np.where(continues, self._sum, 0.0) + added
        self._least = np.where(counts, np.where(continues, np.minimum(self._least, margins), margins), 1.0)
        self._deviation, self._slopes, self._open = deviations, sides.slopes, counts
        total: Array = added.sum(axis=0)
        return np.minimum(total, 1.0)

    @property
    def is_empty(self) -> bool:
        """Whether there is no instant yet."""
        return self._before is None

    @property
    def risk(self) -> Array:
        """The bound for all instants so far, at least one; shape (R,)."""
        assert self._before is not None
        total: Array = self._before + np.where(self._open, self._of_span(), 0.0).sum(axis=0)
        return np.minimum(total, 1.0)

    def _of_span(self) -> Array:
        ever = exceeding(self._least, self._deviation, self._tail)[0]
        return np.minimum(self._sum, 2.0 * ever if self._tail == "normal" else ever)
