"""Choice of the confidence interval of an estimate, given the design and how the number of runs was determined."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from symaware_cli.studies.statistics.interval_estimate import (
    Array,
    IntervalEstimate,
    bootstrap_mean,
    clopper_pearson,
    student_mean,
)
from symaware_cli.studies.statistics.stopping import Mean, Share

#: From this number of values on, the interval of a mean is Student's, which is then close to the bootstrap interval.
_MANY = 300


@dataclass(frozen=True, slots=True)
class IntervalChoice:
    """Computes estimates with the interval that is valid for them.

    If all runs of a planned number are complete, intervals for a fixed number of runs are used. Otherwise shares, and
    means of values with declared bounds, have confidence sequences, which may be watched, and other means have no
    intervals. Dependent runs have no intervals at all.

    Attributes:
        is_final: Whether these are all runs of a planned number.
        is_independent: Whether the runs are independent of each other.
        confidence: The confidence of the intervals.
    """

    is_final: bool
    is_independent: bool
    confidence: float

    def share(self, values: Array) -> IntervalEstimate:
        """Estimate the share of ones among zeros and ones; shape (n,)."""
        if not self.is_independent:
            return self.plain(values)
        if self.is_final:
            return clopper_pearson(int(np.sum(values)), len(values), self.confidence)
        return self._watched(values, Share())

    def mean(self, values: Array, bounds: tuple[float, float] | None, seed: int, name: str) -> IntervalEstimate:
        """Estimate the mean of values.

        Args:
            values: Shape (n,).
            bounds: The least and the greatest possible value; None if not declared.
            seed: Seed of the bootstrap.
            name: The name of the quantity, which distinguishes bootstraps with the same seed.
        """
        if not self.is_independent or (not self.is_final and bounds is None):
            return self.plain(values)
        if not self.is_final and bounds is not None:
            return self._watched(values, Mean(*bounds))
        if len(values) < _MANY:
            return bootstrap_mean(values, seed, name, self.confidence)
        return student_mean(values, self.confidence)

    def plain(self, values: Array) -> IntervalEstimate:
        """Return the mean without an interval."""
        mean = float(np.mean(values)) if len(values) else math.nan
        return IntervalEstimate(mean, math.nan, math.nan, len(values), self.confidence, "")

    def _watched(self, values: Array, estimand: Share | Mean) -> IntervalEstimate:
        sequence = estimand.sequence(self.confidence)
        sequence.update(values)
        return sequence.estimate()
