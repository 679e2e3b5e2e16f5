"""Confidence intervals of a share, a mean and a quantile, at a planned number of runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.world import generator

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class IntervalEstimate:
    """An estimate of a quantity with its confidence interval.

    Attributes:
        value: The estimate; NaN without data.
        lower: Lower end of the interval.
        upper: Upper end of the interval.
        count: The number of values behind the estimate.
        confidence: The probability that the interval covers the quantity, such as 0.95.
        method: The method of the interval, such as "Clopper-Pearson".
    """

    value: float
    lower: float
    upper: float
    count: int
    confidence: float
    method: str

    @property
    def halfwidth(self) -> float:
        """Half the width of the interval; infinite if an end is infinite."""
        return 0.5 * (self.upper - self.lower)

    def covers(self, value: float) -> bool:
        """Return whether a value lies in the interval, including its ends."""
        return self.lower <= value <= self.upper


def error_probability(confidence: float) -> float:
    """Return 1 - confidence.

    Raises:
        ValueError: The confidence is not between 0 and 1.
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"the confidence is between 0 and 1, such as 0.95, not {confidence:g}")
    return 1.0 - confidence


def finite_values(values: ArrayLike) -> Array:
    """Return the values that are not missing (NaN); shape (n,).

    Raises:
        ValueError: The values have more than one axis, or one is infinite.
    """
    array = np.asarray(values, float)
    if array.ndim != 1:
        raise ValueError(f"the values have {array.ndim} axes; they are a list of numbers")
    present: Array = array[~np.isnan(array)]
    if np.isinf(present).any():
        raise ValueError("one of the values is infinite, so their mean has no interval")
    return present


def unbounded(confidence: float, method: str, count: int = 0, value: float = math.nan) -> IntervalEstimate:
    """Return an estimate with an infinite interval, for too few values."""
    return IntervalEstimate(value, -math.inf, math.inf, count, confidence, method)


def student_mean(values: ArrayLike, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a mean by Student's t distribution: m ± t(1 - alpha / 2; n - 1) s / sqrt(n).

    The interval is exact for normal values and approximate otherwise; skewed distributions need many values.

    Args:
        values: The values, in their unit; missing ones (NaN) are left out. Shape (n,).
        confidence: 1 - alpha.

    Returns:
        The mean with its interval; unbounded for fewer than two values, a point if all values are equal.

    Source: W. S. Gosset ("Student"), "The Probable Error of a Mean", Biometrika 6, 1908.
    """
    from scipy.special import stdtrit

    method, alpha = "Student's t", error_probability(confidence)
    sample = finite_values(values)
    count = len(sample)
    mean = float(np.mean(sample)) if count else math.nan
    if count < 2:
        return unbounded(confidence, method, count, mean)
    margin = float(stdtrit(count - 1, 1.0 - alpha / 2)) * math.sqrt(variance(sample) / count)
    return IntervalEstimate(mean, mean - margin, mean + margin, count, confidence, method)


def variance(values: ArrayLike) -> float:
    """Return the sample variance; exactly 0 if all values are equal, NaN for fewer than two."""
    array = np.asarray(values, float)
    if len(array) < 2:
        return math.nan
    return 0.0 if (array == array[0]).all() else float(np.var(array, ddof=1))


def clopper_pearson(successes: int, count: int, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a probability from the number of successes among runs whose number was fixed beforehand.

    The interval is exact: its coverage is at least the confidence for every number of runs:

        lower = BetaInv(alpha / 2; s, n - s + 1),  upper = BetaInv(1 - alpha / 2; s + 1, n - s).

    Args:
        successes: The number of successful runs, s.
        count: The number of runs, n.
        confidence: 1 - alpha.

    Raises:
        ValueError: There are more successes than runs, or a negative number.

    Source: C. J. Clopper and E. S. Pearson, "The Use of Confidence or Fiducial Limits Illustrated in the Case of the
    Binomial", Biometrika 26, 1934.
    """
    from scipy.special import betaincinv

    if not 0 <= successes <= count:
        raise ValueError(f"there are {successes} successes among {count} runs")
    tail = error_probability(confidence) / 2
    failures = count - successes
    lower = float(betaincinv(successes, failures + 1, tail)) if successes else 0.0
    upper = float(betaincinv(successes + 1, failures, 1 - tail)) if failures else 1.0
    value = successes / count if count else math.nan
    return IntervalEstimate(value, lower, upper, count, confidence, "Clopper-Pearson")


_ORDER_STATISTICS = "order statistics"


def quantile(values: ArrayLike, probability: float, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a quantile of any distribution; the interval's ends are order statistics.

    The number of values not exceeding the quantile is binomial, so the l-th and the u-th value bracket it with at least
    the stated probability, where l and u are the greatest and the least with

        P(Bin(n, q) <= l - 1) <= alpha / 2  and  P(Bin(n, q) >= u) <= alpha / 2.

    An end is infinite if no value is extreme enough.

    Args:
        values: The values, in their unit; missing ones (NaN) are left out. Shape (n,).
        probability: The probability of the quantile, q, between 0 and 1: 0.5 for the median.
        confidence: 1 - alpha.

    Source: W. J. Conover, "Practical Nonparametric Statistics", 3rd edition, Wiley 1999, section 3.2.
    """
    from scipy.special import bdtr

    if not 0.0 < probability < 1.0:
        raise ValueError(f"the probability of a quantile is between 0 and 1, not {probability:g}")
    tail = error_probability(confidence) / 2
    ordered = np.sort(finite_values(values))
    count = len(ordered)
    if not count:
        return unbounded(confidence, _ORDER_STATISTICS)
    # P(Bin(n, q) <= k) for k = 0..n-1.
    below = np.array(bdtr(np.arange(float(count)), count, probability), float)
    first = int(np.searchsorted(below, tail, side="right"))
    last = int(np.searchsorted(below, 1.0 - tail, side="left")) + 1
    lower = float(ordered[first - 1]) if first else -math.inf
    upper = float(ordered[last - 1]) if last <= count else math.inf
    value = float(np.quantile(ordered, probability))
    return IntervalEstimate(value, lower, upper, count, confidence, _ORDER_STATISTICS)


_BOOTSTRAP = "bootstrap (BCa)"

#: The number of resamples, and the number of values that are resampled at a time.
RESAMPLES = 4_000
_BLOCK = 1_000_000


def bootstrap_mean(values: ArrayLike, seed: int, name: str, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a mean with the bias-corrected and accelerated bootstrap interval (BCa).

    The interval is approximate: its coverage converges to the confidence as the number of values grows. With fewer than
    about 30 values of a skewed distribution its coverage is too low.

    Args:
        values: The values, in their unit; missing ones (NaN) are left out. Shape (n,).
        seed: The seed of the sweep.
        name: The name of the values, such as "closest"; the resamples depend only on the seed and the name.
        confidence: 1 - alpha.

    Returns:
        The mean with its interval; unbounded for fewer than two values, a point if all values are equal.

    Source: B. Efron, "Better Bootstrap Confidence Intervals", Journal of the American Statistical Association 82, 1987;
    the acceleration of a mean by the jackknife is the skewness of the sample over 6 sqrt(n).
    """
    from scipy.special import ndtr, ndtri

    tail = error_probability(confidence) / 2
    sample = finite_values(values)
    count = len(sample)
    mean = float(sample.mean()) if count else float("nan")
    if count < 2:
        return unbounded(confidence, _BOOTSTRAP, count, mean)
    deviations = sample - mean
    squares = float(np.sum(deviations**2))
    if sample.min() == sample.max() or not squares:
        return IntervalEstimate(mean, mean, mean, count, confidence, _BOOTSTRAP)
    means = np.sort(_resampled_means(deviations, seed, name))
    # The share of resamples below the mean, counting ties as one half, kept away from 0 and 1.
    below = 0.5 * (np.searchsorted(means, 0.0, "left") + np.searchsorted(means, 0.0, "right")) / RESAMPLES
    bias = float(ndtri(np.clip(below, 0.5 / RESAMPLES, 1.0 - 0.5 / RESAMPLES)))
    acceleration = float(np.sum(deviations**3)) / (6.0 * squares**1.5)
    ends = []
    for probability in (tail, 1.0 - tail):
        shifted = bias + float(ndtri(probability))
        ends.append(float(ndtr(bias + shifted / (1.0 - acceleration * shifted))))
    lower, upper = np.quantile(means, ends)
    return IntervalEstimate(mean, mean + float(lower), mean + float(upper), count, confidence, _BOOTSTRAP)


def _resampled_means(values: Array, seed: int, name: str) -> Array:
    """Return the means of the resamples; shape (RESAMPLES,)."""
    random = generator(seed, f"bootstrap {name}")
    rows = max(1, _BLOCK // len(values))
    means = [
        values[random.integers(0, len(values), (min(rows, RESAMPLES - begin), len(values)))].mean(axis=1)
        for begin in range(0, RESAMPLES, rows)
    ]
    return np.concatenate(means)
