"""Paired comparison of two variants, run by run, with common random numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.studies.statistics.interval_estimate import Array, IntervalEstimate, quantile, student_mean, variance


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """The paired difference of two variants; each difference is the second's value minus the first's in one run.

    Attributes:
        mean: The mean difference, in the unit of the values, with the interval of the paired t test.
        median: The median difference, with the interval that corresponds to the sign test.
        greater: The number of runs with a greater value in the second variant.
        less: The number of runs with a lesser value there. The values of all other runs are equal.
        sign_test: The two-sided p value of the exact sign test: the probability of an imbalance at least this great if
            greater and lesser values are equally likely. For values of 0 and 1 it is McNemar's exact test. 1 without
            differences.
        variance_ratio: The variance of the mean difference for the same number of runs without common random numbers,
            divided by the variance with them: independent runs would have to be this many times as numerous for the
            same precision. Below 1, common random numbers do harm. NaN if no value varies; infinite if values vary but
            the difference does not.
        correlation: The correlation of the two variants' values; NaN if those of one do not vary.
    """

    mean: IntervalEstimate
    median: IntervalEstimate
    greater: int
    less: int
    sign_test: float
    variance_ratio: float
    correlation: float

    def without_intervals(self) -> PairedComparison:
        """Return the comparison without the values that assume independent runs: intervals, test and variance ratio."""
        mean, median = (replace(each, lower=math.nan, upper=math.nan, method="") for each in (self.mean, self.median))
        return replace(self, mean=mean, median=median, sign_test=math.nan, variance_ratio=math.nan)


def compare(first: ArrayLike, second: ArrayLike, confidence: float = 0.95) -> PairedComparison:
    """Compare two variants at a planned number of runs.

    The interval of the mean difference is that of the paired t test, `student_mean` of the differences. The variance
    ratio is (s_1^2 + s_2^2) / s^2, with the sample variances of both variants and of the differences.

    Args:
        first: The value of each run of the first variant; booleans count as 1 and 0. Shape (n,).
        second: The values of the second variant, in the same order of runs, with the same random numbers. Runs with
            either value missing (NaN) are left out. Shape (n,).
        confidence: 1 - alpha.

    Raises:
        ValueError: The numbers of values differ, or a value is infinite.

    Sources: W. J. Conover, "Practical Nonparametric Statistics", 3rd edition, Wiley 1999, section 3.4 (sign test);
    A. M. Law, "Simulation Modeling and Analysis", 5th edition, McGraw-Hill 2015, section 11.2 (common random numbers).
    """
    one, other = np.asarray(first, float), np.asarray(second, float)
    if one.ndim != 1 or one.shape != other.shape:
        raise ValueError(f"values are compared run by run, but have the shapes {one.shape} and {other.shape}")
    present = ~(np.isnan(one) | np.isnan(other))
    one, other = one[present], other[present]
    if not (np.isfinite(one).all() and np.isfinite(other).all()):
        raise ValueError("one of the values is infinite, so differences have no mean")
    differences = other - one
    greater, less = int(np.sum(differences > 0)), int(np.sum(differences < 0))
    variances = [variance(each) for each in (one, other, differences)]
    return PairedComparison(
        mean=student_mean(differences, confidence),
        median=quantile(differences, 0.5, confidence),
        greater=greater,
        less=less,
        sign_test=_sign_test(min(greater, less), greater + less),
        variance_ratio=_ratio(variances[0] + variances[1], variances[2]),
        correlation=_correlation(one, other, variances[0] * variances[1]),
    )


def _sign_test(fewer: int, count: int) -> float:
    from scipy.special import bdtr

    return min(1.0, 2.0 * float(bdtr(float(fewer), count, 0.5))) if count else 1.0


def _ratio(unpaired: float, paired: float) -> float:
    if paired > 0:
        return unpaired / paired
    return math.inf if unpaired > 0 else math.nan


def _correlation(one: Array, other: Array, product: float) -> float:
    if not product > 0:
        return math.nan
    covariance = float(np.sum((one - one.mean()) * (other - other.mean()))) / (len(one) - 1)
    return covariance / math.sqrt(product)
