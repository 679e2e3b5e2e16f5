"""Functions of networks whose results do not depend on the processor, on libraries or on other rows.

Sums are taken in the order of their terms, one operation for all rows at a time, and exponentials are computed by
additions, multiplications and divisions, which IEEE 754 defines to the bit. So the result for a row is the same alone
and among other rows, with every BLAS and every mathematical library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: ln 2 in two parts, of which the first has few digits, so that its multiples are exact (W. J. Cody, W. Waite,
#: "Software manual for the elementary functions", Prentice-Hall 1980).
_LN2_HIGH, _LN2_LOW = 0.693145751953125, 1.4286068203094172e-06
_INVERSE_LN2 = 1.4426950408889634

#: Arguments beyond which exp overflows or is 0.
_LEAST, _GREATEST = -745.0, 709.0

#: 1/2!, 1/3! and so on: the remainder of the series is below 2e-17 for arguments up to ln(2)/2.
_COEFFICIENTS = tuple(1.0 / float(factorial) for factorial in np.cumprod(np.arange(1, 15, dtype=np.int64))[1:])


def product(values: Array, weights: Array, bias: Array | None = None) -> Array:
    """Return values (..., k) times weights (k, m), plus a bias that can be broadcast; shape (..., m)."""
    shape = (*values.shape[:-1], weights.shape[1])
    found, term = np.zeros(shape), np.empty(shape)
    # One input after the other, so that the order of the sum does not depend on the number of rows.
    for number in range(len(weights)):
        np.multiply(values[..., number, None], weights[number], out=term)
        np.add(found, term, out=found)
    return found if bias is None else np.add(found, bias)


def less_one(values: Array) -> Array:
    """Return exp(x) - 1, with an error of a few units in the last place."""
    scale, series = _reduced(values)
    return np.where(scale == 1.0, series, scale * series + (scale - 1.0))


def exponential(values: Array) -> Array:
    """Return exp(x), with an error of a few units in the last place; at most 8.3e307."""
    scale, series = _reduced(values)
    return scale * (series + 1.0)


def _reduced(values: Array) -> tuple[Array, Array]:
    """Return a power of 2, and exp(r) - 1 for the rest r of the exponents; their product is exp(x)."""
    bounded = np.clip(values, _LEAST, _GREATEST)
    power = np.rint(bounded * _INVERSE_LN2)
    rest = (bounded - power * _LN2_HIGH) - power * _LN2_LOW
    series = np.full_like(rest, _COEFFICIENTS[-1])
    for coefficient in reversed(_COEFFICIENTS[:-1]):
        series = series * rest + coefficient
    scale: Array = np.ldexp(1.0, np.where(np.isnan(power), 0.0, power).astype(np.int64))
    return scale, rest + rest * rest * series


def sigmoid(values: Array) -> Array:
    """Return 1 / (1 + exp(-x))."""
    return 1.0 / (1.0 + exponential(-values))


def tangent(values: Array) -> Array:
    """Return the hyperbolic tangent."""
    found = less_one(-2.0 * np.abs(values))
    return np.copysign(-found / (found + 2.0), values)
