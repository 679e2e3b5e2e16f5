"""Two variants compared run by run, where both have the same chance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.studies.statistics.interval_estimate import Array, IntervalEstimate, quantile, student_mean, variance


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """What two variants differ by; each difference is that of the second from the first in one run.

    Attributes:
        mean: The mean difference, in the unit of the values, with the interval of the paired t test.
        median: The median difference, with the interval that belongs to the sign test.
        greater: How many runs have a greater value in the second variant.
        less: How many have a lesser one. The others are equal.
        sign_test: The two-sided p value of the exact sign test: how likely so great an imbalance of greater and less
            is where both are equally likely. For values of 0 and 1 it is McNemar's exact test. 1 without differences.
        variance_ratio: The variance of the mean difference of as many runs without common chance, over that with it:
            so many times the runs would be needed for the same precision. Below 1, common chance does harm. NaN where
            no value varies; infinite where the difference alone does not vary.
        correlation: Of the two variants' values; NaN where those of one do not vary.
    """

    mean: IntervalEstimate
    median: IntervalEstimate
    greater: int
    less: int
    sign_test: float
    variance_ratio: float
    correlation: float

    def without_intervals(self) -> PairedComparison:
        """Return the same without what assumes that runs are independent: intervals, test and variance ratio."""
        mean, median = (replace(each, lower=math.nan, upper=math.nan, method="") for each in (self.mean, self.median))
        return replace(self, mean=mean, median=median, sign_test=math.nan, variance_ratio=math.nan)


def compare(first: ArrayLike, second: ArrayLike, confidence: float = 0.95) -> PairedComparison:
    """Compare two variants at a number of runs that was planned beforehand.

    The interval of the mean difference is that of the paired t test, `student_mean` of the differences. The variance
    ratio is (s_1^2 + s_2^2) / s^2, with the sample variances of both variants and of the differences.

    Args:
        first: The value of each run of the first variant; true and false count as 1 and 0. Shape (n,).
        second: Those of the second, with the same chance run by run. Runs in which either is missing (NaN) are left
            out. Shape (n,).
        confidence: 1 - alpha.

    Raises:
        ValueError: They are not as many, or one is infinite.

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
