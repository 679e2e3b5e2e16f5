"""How long messages travel: distributions of delays, drawn by their quantiles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.network.channel.channel_parameters import DelayDistribution

Array = NDArray[np.float64]


def delays(delay: float | DelayDistribution, uniform: Array) -> Array:
    """Turn numbers from (0, 1) into delays of a distribution by its quantile function [s]; shape (m,)."""
    if not isinstance(delay, DelayDistribution):
        return np.full(len(uniform), float(delay))
    return delay.constant + _drawn(delay, uniform)


def _drawn(delay: DelayDistribution, uniform: Array) -> Array:
    """What is drawn from a distribution [s]; shape (m,)."""
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
    # Truncated at 0: only the part of (0, 1) that stands for delays above it is used.
    below = ndtr(-mean / deviation)
    drawn: Array = np.maximum(mean + deviation * ndtri(below + (1.0 - below) * uniform), 0.0)
    return drawn
