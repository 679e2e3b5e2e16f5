"""The interval of a mean of many values, at a planned number of runs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.study.statistics.interval_estimate import (
    IntervalEstimate,
    error_probability,
    finite_values,
    unbounded,
)


def student_mean(values: ArrayLike, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a mean by Student's t distribution: m ± t(1 - alpha / 2; n - 1) s / sqrt(n).

    The interval is exact for normal values and approximate otherwise; for skewed values it needs many of them.

    Args:
        values: The values, in their unit; those that are missing (NaN) are left out. Shape (n,).
        confidence: 1 - alpha.

    Returns:
        The mean with its interval; unbounded for fewer than two values, a point for values that are all the same.

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
    """The sample variance; exactly 0 for values that are all equal, NaN for fewer than two."""
    array = np.asarray(values, float)
    if len(array) < 2:
        return math.nan
    return 0.0 if (array == array[0]).all() else float(np.var(array, ddof=1))
