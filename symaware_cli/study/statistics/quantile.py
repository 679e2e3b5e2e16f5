"""The interval of a quantile at a planned number of runs."""

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

_METHOD = "order statistics"


def quantile(values: ArrayLike, probability: float, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a quantile, whatever the distribution, by two of the sorted values.

    The number of values at most the quantile is binomial, so the l-th and the u-th value bracket it with at least the
    stated probability, where l and u are the greatest and the least with

        P(Bin(n, q) <= l - 1) <= alpha / 2  and  P(Bin(n, q) >= u) <= alpha / 2.

    An end is infinite where no value is extreme enough.

    Args:
        values: The values, in their unit; those that are missing (NaN) are left out. Shape (n,).
        probability: Which quantile, q, between 0 and 1: 0.5 for the median.
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
        return unbounded(confidence, _METHOD)
    # P(Bin(n, q) <= k) for k = 0..n-1.
    below = np.array(bdtr(np.arange(float(count)), count, probability), float)
    first = int(np.searchsorted(below, tail, side="right"))
    last = int(np.searchsorted(below, 1.0 - tail, side="left")) + 1
    lower = float(ordered[first - 1]) if first else -math.inf
    upper = float(ordered[last - 1]) if last <= count else math.inf
    value = float(np.quantile(ordered, probability))
    return IntervalEstimate(value, lower, upper, count, confidence, _METHOD)
