"""The interval of a mean at a planned number of runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.study.statistics.interval_estimate import (
    Array,
    IntervalEstimate,
    error_probability,
    finite_values,
    unbounded,
)
from symaware_cli.world.chance import generator

_METHOD = "bootstrap (BCa)"

#: How many resamples are made, and how many numbers of them at a time.
RESAMPLES = 4_000
_BLOCK = 1_000_000


def bootstrap_mean(values: ArrayLike, seed: int, name: str, confidence: float = 0.95) -> IntervalEstimate:
    """Estimate a mean by resampling the values, with bias correction and acceleration (BCa).

    The interval is approximate: its coverage tends to the confidence as the values become many. Among fewer than about
    30 values of a skewed distribution it covers too rarely.

    Args:
        values: The values, in their unit; those that are missing (NaN) are left out. Shape (n,).
        seed: The seed of the sweep.
        name: What the values are, such as "closest": the resamples depend on the seed and the name alone.
        confidence: 1 - alpha.

    Returns:
        The mean with its interval; unbounded for fewer than two values, a point for values that are all the same.

    Source: B. Efron, "Better Bootstrap Confidence Intervals", Journal of the American Statistical Association 82, 1987;
    the acceleration of a mean by the jackknife is the skewness of the sample over 6 sqrt(n).
    """
    from scipy.special import ndtr, ndtri

    tail = error_probability(confidence) / 2
    sample = finite_values(values)
    count = len(sample)
    mean = float(sample.mean()) if count else float("nan")
    if count < 2:
        return unbounded(confidence, _METHOD, count, mean)
    deviations = sample - mean
    squares = float(np.sum(deviations**2))
    if sample.min() == sample.max() or not squares:
        return IntervalEstimate(mean, mean, mean, count, confidence, _METHOD)
    means = np.sort(_resampled_means(deviations, seed, name))
    # The share of resamples below the mean, ties by halves, kept away from 0 and 1.
    below = 0.5 * (np.searchsorted(means, 0.0, "left") + np.searchsorted(means, 0.0, "right")) / RESAMPLES
    bias = float(ndtri(np.clip(below, 0.5 / RESAMPLES, 1.0 - 0.5 / RESAMPLES)))
    acceleration = float(np.sum(deviations**3)) / (6.0 * squares**1.5)
    ends = []
    for probability in (tail, 1.0 - tail):
        shifted = bias + float(ndtri(probability))
        ends.append(float(ndtr(bias + shifted / (1.0 - acceleration * shifted))))
    lower, upper = np.quantile(means, ends)
    return IntervalEstimate(mean, mean + float(lower), mean + float(upper), count, confidence, _METHOD)


def _resampled_means(values: Array, seed: int, name: str) -> Array:
    """The means of the resamples; shape (RESAMPLES,)."""
    random = generator(seed, f"bootstrap {name}")
    rows = max(1, _BLOCK // len(values))
    means = [
        values[random.integers(0, len(values), (min(rows, RESAMPLES - begin), len(values)))].mean(axis=1)
        for begin in range(0, RESAMPLES, rows)
    ]
    return np.concatenate(means)
