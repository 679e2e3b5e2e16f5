"""Delay distributions: draws message delays by quantile functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.network.channel.channel_parameters import DelayDistribution

Array = NDArray[np.float64]


def delays(delay: float | DelayDistribution, uniform: Array) -> Array:
    """Return delays for uniform numbers in (0, 1), by the distribution's quantile function [s]; shape (m,)."""
    if not isinstance(delay, DelayDistribution):
        return np.full(len(uniform), float(delay))
    return delay.constant + _drawn(delay, uniform)


def _drawn(delay: DelayDistribution, uniform: Array) -> Array:
    """Return the drawn part of delays [s]; shape (m,)."""
    if delay.uniform is not None:
        least, greatest = delay.uniform
        return least + (greatest - least) * uniform
    if delay.exponential is not None:
        return -delay.exponential * np.log1p(-uniform)
    from scipy.special import ndtr, ndtri

    if delay.lognormal is not None:
        median, deviation = delay.lognormal
        return median * np.exp(deviation * ndtri(uniform))
    assert delay.normal is not None
    mean, deviation = delay.normal
    if deviation == 0.0:
        return np.full(len(uniform), mean)
    # Truncated at 0: only quantiles of delays above it are used.
    below = ndtr(-mean / deviation)
    drawn: Array = np.maximum(mean + deviation * ndtri(below + (1.0 - below) * uniform), 0.0)
    return drawn
