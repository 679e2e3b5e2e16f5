"""Distributions of parameters, given by their quantile functions.

Reasons: docs/decisions/0033-drawn-parameters.md
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from symaware_cli.studies.statistics.interval_estimate import Array


class ParameterDistribution(Protocol):
    """A distribution with a quantile function, which maps any design of points between 0 and 1 to values."""

    def values(self, points: Array) -> Sequence[Any]:
        """Return the quantiles at points of the open interval from 0 to 1; shape (n,)."""


@dataclass(frozen=True, slots=True)
class UniformDistribution:
    """The uniform distribution on an interval.

    Attributes:
        low: The least value, in the parameter's unit.
        high: The greatest value, likewise.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _require_order(self.low, self.high)

    def values(self, points: Array) -> Sequence[float]:
        """Return low + (high - low) u for each point u."""
        return _listed(np.clip(self.low + (self.high - self.low) * points, self.low, self.high))


@dataclass(frozen=True, slots=True)
class NormalDistribution:
    """The normal distribution.

    Attributes:
        mean: The mean, in the parameter's unit.
        deviation: The standard deviation, likewise.
    """

    mean: float
    deviation: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.deviation) and self.deviation >= 0):
            raise ValueError("a normal distribution has a finite mean and a standard deviation of at least 0")

    def values(self, points: Array) -> Sequence[float]:
        """Return mean + deviation z for the standard normal quantile z of each point."""
        from scipy.special import ndtri

        return _listed(self.mean + self.deviation * ndtri(points))


@dataclass(frozen=True, slots=True)
class LogUniformDistribution:
    """The log-uniform distribution, such as for gains or noise levels of unknown magnitude.

    Attributes:
        low: The least value, greater than 0, in the parameter's unit.
        high: The greatest value, likewise.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _require_order(self.low, self.high)
        if self.low <= 0:
            raise ValueError(f"a logarithm needs numbers greater than 0, not {self.low:g}")

    def values(self, points: Array) -> Sequence[float]:
        """Return low (high / low)^u for each point u."""
        logarithm = math.log(self.low) + (math.log(self.high) - math.log(self.low)) * points
        return _listed(np.clip(np.exp(logarithm), self.low, self.high))


@dataclass(frozen=True, slots=True)
class Choice:
    """A discrete distribution over values of any type.

    Attributes:
        options: The values.
        weights: The relative probabilities of the values; None if all are equally likely.
    """

    options: Sequence[Any]
    weights: Sequence[float] | None = None
    _ends: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        weights = np.ones(len(self.options)) if self.weights is None else np.array(self.weights, float)
        if not len(self.options):
            raise ValueError("there is nothing to choose from")
        if weights.shape != (len(self.options),):
            raise ValueError(f"there are {len(weights)} weights for {len(self.options)} options")
        if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.sum() > 0):
            raise ValueError("weights are at least 0, and one is greater")
        object.__setattr__(self, "_ends", np.cumsum(weights) / weights.sum())

    def values(self, points: Array) -> Sequence[Any]:
        """Return the option for each point: options, in order, occupy parts of the interval from 0 to 1."""
        last = int(np.flatnonzero(np.diff(self._ends, prepend=0.0))[-1])
        places = np.minimum(np.searchsorted(self._ends, points, side="right"), last)
        return [self.options[place] for place in places.tolist()]


def _require_order(low: float, high: float) -> None:
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise ValueError(f"a distribution has two finite ends in order, not {low:g} and {high:g}")


def _listed(values: Array) -> list[float]:
    listed: list[float] = values.tolist()
    return listed
