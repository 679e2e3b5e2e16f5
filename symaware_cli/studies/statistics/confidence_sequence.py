"""Confidence sequences: intervals valid at all times simultaneously, so that they may be watched as runs finish.

Reasons: docs/decisions/0030-statistics.md
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.studies.statistics.interval_estimate import Array, IntervalEstimate, error_probability


class ConfidenceSequence(ABC):
    """A sequence of intervals, one after each value, that all cover the quantity with probability at least 1 - alpha.

    The values are independent and identically distributed, as are those of runs with separate seeds. The interval after
    n values is the intersection of those computed from the first 1, 2, ..., n values: it never grows. If the
    intersection becomes empty, which has a probability of at most alpha, the interval stays a point.

    Several sequences may be computed at once, along further axes.

    Attributes:
        count: The number of values so far, n.
    """

    #: The name of the method.
    method: str

    def __init__(self, low: float, high: float, confidence: float, streams: tuple[int, ...] = ()) -> None:
        """Begin without values.

        Args:
            low: The lower bound of the values.
            high: The upper bound of the values.
            confidence: 1 - alpha.
            streams: The shape of a value: () for one sequence, (k,) for k at once.

        Raises:
            ValueError: The bounds are not finite and in order, or the confidence is not between 0 and 1.
        """
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"the bounds of a mean are two numbers in order, not {low:g} and {high:g}")
        self.low = low
        self.high = high
        self.confidence = confidence
        self.alpha = error_probability(confidence)
        self.count = 0
        self._lower = np.zeros(streams)
        self._upper = np.ones(streams)
        self._sum = np.zeros(streams)

    def update(self, values: ArrayLike) -> tuple[Array, Array]:
        """Add values.

        Args:
            values: In their unit; shape (m, *streams). The result does not depend on how they are split into blocks.

        Returns:
            The lower and the upper end after each of them; each of shape (m, *streams).

        Raises:
            ValueError: A value lies outside the bounds, or is not a number.
        """
        array = np.asarray(values, float)
        outside = ~((array >= self.low) & (array <= self.high))
        if outside.any():
            culprit = float(array[outside][0])
            raise ValueError(f"the value {culprit:g} is outside the bounds {self.low:g} and {self.high:g}")
        if not len(array):
            return array.copy(), array.copy()
        scaled = (array - self.low) / (self.high - self.low)
        sums = accumulated(self._sum, scaled)
        lower, upper = self._bounds(scaled, sums)
        lower = np.maximum.accumulate(np.concatenate([self._lower[None], lower]))[1:]
        upper = np.minimum.accumulate(np.concatenate([self._upper[None], upper]))[1:]
        # Once the ends have crossed, both stay at the end that did not move.
        lower, upper = self._uncrossed(lower, upper)
        self._sum, self._lower, self._upper = sums[-1], lower[-1], upper[-1]
        self.count += len(array)
        width = self.high - self.low
        return self.low + width * lower, self.low + width * upper

    def estimate(self, stream: tuple[int, ...] = ()) -> IntervalEstimate:
        """Return the mean of the values so far and the interval after the last of them."""
        width = self.high - self.low
        value = self.low + width * float(self._sum[stream]) / self.count if self.count else math.nan
        lower, upper = (self.low + width * float(end[stream]) for end in (self._lower, self._upper))
        return IntervalEstimate(value, lower, upper, self.count, self.confidence, self.method)

    @abstractmethod
    def _bounds(self, values: Array, sums: Array) -> tuple[Array, Array]:
        """Return the interval computed from all values up to each of these; `self.count` values came before.

        Args:
            values: Values scaled to 0 to 1; shape (m, *streams).
            sums: The sum of all values before each of these, and of all values; shape (m + 1, *streams).

        Returns:
            Its ends, scaled likewise; each of shape (m, *streams).
        """

    def _counts(self, values: Array) -> Array:
        """Return the number of values up to each of these; shape (m, 1, ...)."""
        counts = np.arange(self.count + 1.0, self.count + len(values) + 1.0)
        return counts.reshape(-1, *[1] * (values.ndim - 1))

    def _uncrossed(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        crossed = lower > upper
        if not crossed.any():
            return lower, upper
        first = np.argmax(crossed, axis=0)[None]
        ever = crossed.any(axis=0)
        # The ends before they crossed; one of them is the point nearest to the end that crossed it.
        before_lower = np.where(first > 0, np.take_along_axis(lower, np.maximum(first - 1, 0), 0), self._lower[None])[0]
        before_upper = np.where(first > 0, np.take_along_axis(upper, np.maximum(first - 1, 0), 0), self._upper[None])[0]
        rose = np.take_along_axis(lower, first, 0)[0] > before_upper
        point = np.where(rose, before_upper, before_lower)
        held = (np.arange(len(lower)).reshape(-1, *[1] * (lower.ndim - 1)) >= first) & ever
        return np.where(held, point, lower), np.where(held, point, upper)


def accumulated(before: Array, terms: Array) -> Array:
    """Return the cumulative sums of terms, starting from a previous sum; shape (m + 1, *streams)."""
    return np.cumsum(np.concatenate([before[None], terms]), axis=0)


#: Both parameters of the beta distribution that is mixed over, which minimizes the worst-case regret (Krichevsky and
#: Trofimov 1981) and gives narrow intervals for probabilities near 0 and 1.
PRIOR = 0.5

#: Newton's method stops at a step smaller than this, in log-odds.
_STEP = 1e-12
_MOST_STEPS = 100


class BetaMixture(ConfidenceSequence):
    """The confidence sequence of a probability, from values that are 0 or 1.

    With s ones among the first n values, and B the beta function,

        M_n(p) = B(a + s, a + n - s) / (B(a, a) p^s (1 - p)^(n - s)),  a = 1/2,

    is a martingale with mean 1 if p is the probability: the likelihood ratio of a mixture over all probabilities to p.
    By Ville's inequality it ever reaches 1 / alpha with a probability of at most alpha, so the set of all p for which
    M_n(p) < 1 / alpha covers the probability at all n simultaneously; it is an interval.

    Sources: H. Robbins, "Statistical Methods Related to the Law of the Iterated Logarithm", The Annals of Mathematical
    Statistics 41, 1970; S. R. Howard, A. Ramdas, J. McAuliffe, J. Sekhon, "Time-uniform, Nonparametric, Nonasymptotic
    Confidence Sequences", The Annals of Statistics 49, 2021 (beta-binomial mixtures).
    """

    method = "beta mixture"

    def __init__(self, confidence: float = 0.95, streams: tuple[int, ...] = ()) -> None:
        """Begin without values; see `ConfidenceSequence`."""
        super().__init__(0.0, 1.0, confidence, streams)

    def _bounds(self, values: Array, sums: Array) -> tuple[Array, Array]:
        if ((values != 0.0) & (values != 1.0)).any():
            raise ValueError("the values of a share are 0 and 1")
        return bounds(sums[1:], np.broadcast_to(self._counts(values), values.shape), self.alpha)


def bounds(successes: Array, counts: Array, alpha: float) -> tuple[Array, Array]:
    """Return the ends of the intervals for s successes among n values; the arrays have the same, arbitrary shape."""
    from scipy.special import betaln

    failures = counts - successes
    threshold = betaln(PRIOR + successes, PRIOR + failures) - betaln(PRIOR, PRIOR) + np.log(alpha)
    # With ones and zeros exchanged, the upper end is a lower end.
    return _lower(successes, failures, threshold), 1.0 - _lower(failures, successes, threshold)


def _lower(successes: Array, failures: Array, threshold: Array) -> Array:
    """Return the least probability at which s log p + (n - s) log(1 - p) reaches a threshold.

    In log-odds the function is concave, and s times the log-odds bounds it from above. Newton's method, started where
    that bound reaches the threshold, therefore approaches the root from below, and wherever it stops the interval is no
    narrower than the exact one.
    """
    from scipy.special import expit, log_expit

    shape, s, f = successes.shape, successes.ravel(), failures.ravel()
    goal = threshold.ravel()
    found = np.zeros(s.shape)
    rows: NDArray[np.intp] = np.flatnonzero(s > 0)
    odds = goal[rows] / s[rows]
    for _ in range(_MOST_STEPS):
        p = expit(odds)
        slope = s[rows] * (1.0 - p) - f[rows] * p
        value = s[rows] * log_expit(odds) + f[rows] * log_expit(-odds)
        step = (goal[rows] - value) / slope
        # Each element stops separately, so its bits do not depend on the others.
        moves = step > _STEP
        found[rows[~moves]] = p[~moves]
        rows, odds = rows[moves], (odds + step)[moves]
        if not len(rows):
            break
    found[rows] = expit(odds)
    return found.reshape(shape)


#: The maximum bet.
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
