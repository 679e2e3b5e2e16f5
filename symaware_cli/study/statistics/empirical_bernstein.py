"""The confidence sequence of the mean of values between known bounds."""

from __future__ import annotations

import numpy as np

from symaware_cli.study.statistics.confidence_sequence import ConfidenceSequence, accumulated
from symaware_cli.study.statistics.interval_estimate import Array

#: No bet is larger than this.
_LARGEST = 0.5


class EmpiricalBernstein(ConfidenceSequence):
    """The confidence sequence of the mean of any distribution between known bounds; it adapts to the variance.

    For values X_1, X_2, ... scaled to 0 to 1, with

        mu_i = (1/2 + X_1 + ... + X_i) / (i + 1),
        sigma_i^2 = (1/4 + (X_1 - mu_1)^2 + ... + (X_i - mu_i)^2) / (i + 1),
        lambda_i = min(1/2, sqrt(2 log(2 / alpha) / (sigma_(i-1)^2 i log(1 + i)))),
        psi(lambda) = -log(1 - lambda) - lambda,

    the interval after n values is

        (sum lambda_i X_i ± (log(2 / alpha) + sum (X_i - mu_(i-1))^2 psi(lambda_i))) / sum lambda_i.

    Source: I. Waudby-Smith and A. Ramdas, "Estimating Means of Bounded Random Variables by Betting", Journal of the
    Royal Statistical Society B 86, 2024, theorem 2 (predictable plug-in), with their factor of 4 cancelled.
    """

    method = "empirical Bernstein"

    def __init__(self, low: float, high: float, confidence: float = 0.95, streams: tuple[int, ...] = ()) -> None:
        """Begin without values; see `ConfidenceSequence`."""
        super().__init__(low, high, confidence, streams)
        self._squares = np.zeros(streams)
        self._bets = np.zeros(streams)
        self._gains = np.zeros(streams)
        self._penalties = np.zeros(streams)

    def _bounds(self, values: Array, sums: Array) -> tuple[Array, Array]:
        counts = self._counts(values)
        before = np.concatenate([counts[:1] - 1.0, counts])
        means = (0.5 + sums) / (before + 1.0)
        squares = accumulated(self._squares, (values - means[1:]) ** 2)
        variances = (0.25 + squares[:-1]) / counts
        evidence = np.log(2.0 / self.alpha)
        bets = np.minimum(_LARGEST, np.sqrt(2.0 * evidence / (variances * counts * np.log1p(counts))))
        penalties = (values - means[:-1]) ** 2 * (-np.log1p(-bets) - bets)
        total = accumulated(self._bets, bets)
        gains = accumulated(self._gains, bets * values)
        penalty = accumulated(self._penalties, penalties)
        self._squares, self._bets, self._gains, self._penalties = squares[-1], total[-1], gains[-1], penalty[-1]
        centre = gains[1:] / total[1:]
        margin = (evidence + penalty[1:]) / total[1:]
        return centre - margin, centre + margin
