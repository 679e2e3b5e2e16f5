"""An estimate with its interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class IntervalEstimate:
    """An estimate of a quantity, and an interval that covers the quantity with at least some probability.

    Attributes:
        value: The estimate; NaN without data.
        lower: Lower end of the interval.
        upper: Upper end of the interval.
        count: How many values it was made from.
        confidence: The probability that the interval covers the quantity, such as 0.95.
        method: How the interval was made, such as "Clopper-Pearson".
    """

    value: float
    lower: float
    upper: float
    count: int
    confidence: float
    method: str

    @property
    def halfwidth(self) -> float:
        """Half the width of the interval; infinite where one end is."""
        return 0.5 * (self.upper - self.lower)

    def covers(self, value: float) -> bool:
        """Whether a value lies in the interval, its ends included."""
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
    """Return the values without those that are missing (NaN); shape (n,).

    Raises:
        ValueError: They have more than one axis, or one is infinite.
    """
    array = np.asarray(values, float)
    if array.ndim != 1:
        raise ValueError(f"the values have {array.ndim} axes; they are a list of numbers")
    present: Array = array[~np.isnan(array)]
    if np.isinf(present).any():
        raise ValueError("one of the values is infinite, so their mean has no interval")
    return present


def unbounded(confidence: float, method: str, count: int = 0, value: float = math.nan) -> IntervalEstimate:
    """Return the estimate from too few values to say anything."""
    return IntervalEstimate(value, -math.inf, math.inf, count, confidence, method)
