"""Intervals that hold at all times together, so that they may be watched while runs come in."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.study.statistics.interval_estimate import Array, IntervalEstimate, error_probability


class ConfidenceSequence(ABC):
    """An interval after each value of a sequence; with probability at least 1 - alpha, all of them cover the quantity.

    The values are independent and identically distributed, as those of runs with seeds of their own are. The interval
    after n values is the intersection of those made from the first 1, 2, ..., n values: it never grows. Should the
    intersection become empty, which has a probability of at most alpha, it stays a point.

    Several sequences may be followed at once, along further axes.

    Attributes:
        count: How many values there were so far, n.
    """

    #: How the intervals are made.
    method: str

    def __init__(self, low: float, high: float, confidence: float, streams: tuple[int, ...] = ()) -> None:
        """Begin without values.

        Args:
            low: What no value is less than.
            high: What no value is greater than.
            confidence: 1 - alpha.
            streams: The shape of a value: () for one sequence, (k,) for k at once.

        Raises:
            ValueError: The bounds are not finite and in order, or the confidence is not between 0 and 1.
        """
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ValueError(f"the bounds of a mean are two numbers in order, not {low:g} and {high:g}")
        self.low = low
        self.high = high
        self.confidence = confidence
        self.alpha = error_probability(confidence)
        self.count = 0
        self._lower = np.zeros(streams)
        self._upper = np.ones(streams)
        self._sum = np.zeros(streams)

    def update(self, values: ArrayLike) -> tuple[Array, Array]:
        """Take further values.

        Args:
            values: In their unit; shape (m, *streams). It makes no difference in how many blocks they come.

        Returns:
            The lower and the upper end after each of them; each of shape (m, *streams).

        Raises:
            ValueError: A value lies outside the bounds, or is not a number.
        """
        array = np.asarray(values, float)
        outside = ~((array >= self.low) & (array <= self.high))
        if outside.any():
            culprit = float(array[outside][0])
            raise ValueError(f"the value {culprit:g} is outside the bounds {self.low:g} and {self.high:g}")
        if not len(array):
            return array.copy(), array.copy()
        scaled = (array - self.low) / (self.high - self.low)
        sums = accumulated(self._sum, scaled)
        lower, upper = self._bounds(scaled, sums)
        lower = np.maximum.accumulate(np.concatenate([self._lower[None], lower]))[1:]
        upper = np.minimum.accumulate(np.concatenate([self._upper[None], upper]))[1:]
        # Once they have crossed, both stay where the one was that had not moved.
        lower, upper = self._uncrossed(lower, upper)
        self._sum, self._lower, self._upper = sums[-1], lower[-1], upper[-1]
        self.count += len(array)
        width = self.high - self.low
        return self.low + width * lower, self.low + width * upper

    def estimate(self, stream: tuple[int, ...] = ()) -> IntervalEstimate:
        """Return the mean of the values so far and the interval after the last of them."""
        width = self.high - self.low
        value = self.low + width * float(self._sum[stream]) / self.count if self.count else math.nan
        lower, upper = (self.low + width * float(end[stream]) for end in (self._lower, self._upper))
        return IntervalEstimate(value, lower, upper, self.count, self.confidence, self.method)

    @abstractmethod
    def _bounds(self, values: Array, sums: Array) -> tuple[Array, Array]:
        """The interval made of all values up to each of these; `self.count` is how many came before.

        Args:
            values: Scaled to 0 to 1; shape (m, *streams).
            sums: The sums of all up to before each, and of all; shape (m + 1, *streams).

        Returns:
            Its ends, scaled likewise; each of shape (m, *streams).
        """

    def _counts(self, values: Array) -> Array:
        """How many values there are up to each of these; shape (m, 1, ...)."""
        counts = np.arange(self.count + 1.0, self.count + len(values) + 1.0)
        return counts.reshape(-1, *[1] * (values.ndim - 1))

    def _uncrossed(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        crossed = lower > upper
        if not crossed.any():
            return lower, upper
        first = np.argmax(crossed, axis=0)[None]
        ever = crossed.any(axis=0)
        # The ends before they crossed; one of them is the point that is nearest to what crossed it.
        before_lower = np.where(first > 0, np.take_along_axis(lower, np.maximum(first - 1, 0), 0), self._lower[None])[0]
        before_upper = np.where(first > 0, np.take_along_axis(upper, np.maximum(first - 1, 0), 0), self._upper[None])[0]
        rose = np.take_along_axis(lower, first, 0)[0] > before_upper
        point = np.where(rose, before_upper, before_lower)
        held = (np.arange(len(lower)).reshape(-1, *[1] * (lower.ndim - 1)) >= first) & ever
        return np.where(held, point, lower), np.where(held, point, upper)


def accumulated(before: Array, terms: Array) -> Array:
    """The sums of terms, one after the other, onto what there was before; shape (m + 1, *streams)."""
    return np.cumsum(np.concatenate([before[None], terms]), axis=0)
