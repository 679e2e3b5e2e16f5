"""Probability distributions, as scenarios and sweeps describe random numbers.

Delays, latencies, initial states, knowledge and the parameters of sweeps are described by the same words, and drawn
from by the same functions. A distribution is its quantile function, so that any design of points between 0 and 1 can be
drawn from it.

Reasons: docs/decisions/0071-one-distribution.md
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from symaware_cli.world.distribution_forms import RANDOM
from symaware_cli.world.number_range import LISTED, expanded
from symaware_cli.world.plugin import Parameters
from symaware_cli.world.time import LONGEST, nanoseconds

Array = NDArray[np.float64]
Part = TypeVar("Part")

#: The points between 0 and 1 that are used: at 0 and 1 themselves some quantiles are infinite.
_FIRST, _LAST = 2.0**-54, 1.0 - 2.0**-53

#: What stands for an end of an interval, up to rounding: the probability to lie beyond is 2^-40.
_ENDS = (2.0**-40, 1.0 - 2.0**-40)

#: The least probability of what bounds leave of a distribution; of less, rounding errors would be drawn.
_LEAST_SHARE = 2.0**-30


def _ndtri(points: Array) -> Array:
    from scipy.special import ndtri

    return ndtri(points)


def _ndtr(numbers: Array) -> Array:
    from scipy.special import ndtr

    return ndtr(numbers)


#: The quantile functions by the names of the forms.
_QUANTILES: Mapping[str, Callable[..., Array]] = {
    "uniform": lambda points, low, high: np.clip(low + (high - low) * points, low, high),
    "normal": lambda points, mean, deviation: mean + deviation * _ndtri(points),
    "lognormal": lambda points, median, deviation: median * np.exp(deviation * _ndtri(points)),
    "loguniform": lambda points, low, high: np.clip(np.exp(np.log(low) + np.log(high / low) * points), low, high),
    "exponential": lambda points, mean: -mean * np.log1p(-points),
}

#: The probabilities below a value of those that have no ends.
_BELOW: Mapping[str, Callable[..., Array]] = {
    "normal": lambda value, mean, deviation: _ndtr((value - mean) / deviation),
    "lognormal": lambda value, median, deviation: _ndtr(np.log(max(value, 0.0) / median) / deviation),
    "exponential": lambda value, mean: -np.expm1(-max(value, 0.0) / mean),
}


def _pairs(numbers: Sequence[Any]) -> list[tuple[float, float]]:
    """The two parts for each element.

    Raises:
        ValueError: They have different numbers of elements.
    """
    lengths = [len(each) for each in numbers if isinstance(each, list)]
    if len({*lengths}) > 1:
        raise ValueError(f"the two parts have {lengths[0]} and {lengths[1]} elements, and need as many in both")
    low, high = np.broadcast_arrays(*(np.array(each, float) for each in numbers))
    return list(zip(low.ravel().tolist(), high.ravel().tolist(), strict=True))


def _of_one_length(numbers: Any) -> Any:
    _pairs(numbers)
    return numbers


def _in_order(numbers: Any) -> Any:
    for low, high in _pairs(numbers):
        if low > high:
            raise ValueError(f"the low end {low} lies above the high end {high}")
        if not math.isfinite(high - low):
            raise ValueError("the distribution is too wide")
    return numbers


def _above_zero(numbers: Any) -> Any:
    for low, _ in _pairs(numbers):
        if low <= 0:
            raise ValueError(f"a logarithm needs numbers greater than 0, not {low:g}")
    return numbers


def _deviation(number: Any) -> Any:
    if np.min(number) < 0:
        raise ValueError("a deviation is at least 0")
    return number


def _deviation_of_logarithm(number: Any) -> Any:
    if np.max(number) > 10:
        raise ValueError("the deviation of a logarithm is at most 10")
    return _deviation(number)


def _mean(number: Any) -> Any:
    if np.min(number) < 0:
        raise ValueError("the mean or median of numbers that are never negative is at least 0")
    return number


def _options(value: Any) -> Any:
    value = expanded(value)
    return tuple(value) if isinstance(value, list) else value


class Distribution(Parameters, Generic[Part]):
    """Random values; the base of `ProbabilityDistribution` and `VectorDistribution`."""

    uniform: Annotated[tuple[Part, Part], AfterValidator(_in_order)] | None = Field(
        None, description="[low, high]: all numbers between them are equally likely."
    )
    normal: (
        Annotated[tuple[Part, Annotated[Part, AfterValidator(_deviation)]], AfterValidator(_of_one_length)] | None
    ) = Field(None, description="[mean, standard deviation]: the normal distribution.")
    lognormal: (
        Annotated[
            tuple[Annotated[Part, AfterValidator(_mean)], Annotated[Part, AfterValidator(_deviation_of_logarithm)]],
            AfterValidator(_of_one_length),
        ]
        | None
    ) = Field(None, description="[median, deviation of the logarithm]: numbers whose logarithm is normal.")
    loguniform: Annotated[tuple[Part, Part], AfterValidator(_above_zero), AfterValidator(_in_order)] | None = Field(
        None, description="[low, high], greater than 0: numbers whose logarithm is uniform."
    )
    exponential: Annotated[Part, AfterValidator(_mean)] | None = Field(
        None, description="The mean of the exponential distribution."
    )
    choice: (
        Annotated[tuple[Any, ...], BeforeValidator(_options), Field(min_length=1), WithJsonSchema(LISTED)] | None
    ) = Field(None, description="One of these values, or of a range such as `1..8`.")
    weights: tuple[float, ...] | None = Field(
        None, description="How likely each value of `choice` is, in any common unit; by default all are equally likely."
    )
    constant: float = Field(0.0, description="Constant that is added to every drawn number.")
    least: float | None = Field(
        None, description="Where a normal, lognormal or exponential distribution is truncated: the least number drawn."
    )
    greatest: float | None = Field(None, description="The greatest number drawn, likewise.")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if sum(getattr(self, form) is not None for form in RANDOM) != 1:
            raise ValueError(
                "give exactly one of `uniform`, `normal`, `lognormal`, `loguniform`, `exponential` and `choice`"
            )
        if self.choice is None:
            if self.weights is not None:
                raise ValueError("weights go with `choice`")
        elif self.constant:
            raise ValueError("a constant is added to numbers of the other forms")
        elif self.weights is not None:
            _check_weights(self.weights, len(self.choice))
        for name in ("least", "greatest"):
            if getattr(self, name) is not None and self.form not in _BELOW:
                raise ValueError(f"`{name}` is for distributions without ends: normal, lognormal or exponential")
        if self._is_truncated and not np.all(self._shares[1] - self._shares[0] >= _LEAST_SHARE):
            name = "greatest" if self.least is None else "least"
            raise ValueError(f"`{name}` excludes nearly all of the distribution")
        return self

    @property
    def form(self) -> str:
        """The form: one of `RANDOM`."""
        return next(form for form in RANDOM if getattr(self, form) is not None)

    @cached_property
    def _parts(self) -> Sequence[Array]:
        """The numbers of the form; each of shape () or (k,)."""
        content = getattr(self, self.form)
        return [np.array(each, float) for each in (content if isinstance(content, tuple) else (content,))]

    @property
    def _is_truncated(self) -> bool:
        return self.least is not None or self.greatest is not None

    @cached_property
    def _shares(self) -> tuple[Array, Array]:
        """The probabilities below the bounds, in the distribution without them."""
        shares = []
        for bound, everywhere in ((self.least, 0.0), (self.greatest, 1.0)):
            # Without deviation a bound that equals the mean is an end.
            with np.errstate(divide="ignore", invalid="ignore"):
                share = everywhere if bound is None else _BELOW[self.form](bound, *self._parts)
            shares.append(np.nan_to_num(np.array(share, float), nan=everywhere))
        return shares[0], shares[1]

    @property
    def elements(self) -> int:
        """How many elements it gives if its numbers are lists; otherwise 0."""
        return 0 if self.choice is not None else max(each.size if each.ndim else 0 for each in self._parts)

    @property
    def largest(self) -> float:
        """The magnitude of the largest number that describes it; 0 for a choice."""
        bounds = [self.constant, self.least or 0.0, self.greatest or 0.0]
        parts = [] if self.choice is not None else self._parts
        return max(float(np.abs(each).max()) for each in (*parts, np.array(bounds)))

    @property
    def is_drawn(self) -> bool:
        """Whether its values differ: it is not a choice from one value."""
        return self.choice is None or len(self.choice) > 1

    @property
    def is_zero(self) -> bool:
        """Whether it is a duration that always is zero, to the nanosecond."""
        return not self.is_drawn and nanoseconds(self.quantile(0.5)) == 0

    @property
    def is_plain_normal(self) -> bool:
        """Whether standard normal numbers are scaled to it by `scaled`: it is normal, without bounds."""
        return self.normal is not None and not self._is_truncated

    def scaled(self, standard: Array) -> Array:
        """Transform standard normal numbers to a plain normal distribution; shape (..., k), or (...)."""
        mean, deviation = self._parts
        return self._raised(mean + deviation * standard)

    def quantiles(self, points: Array) -> Array:
        """Return the numbers that are not exceeded with given probabilities.

        Args:
            points: Probabilities between 0 and 1; shape (..., k) for lists of k elements, else any.
        """
        points = np.clip(points, _FIRST, _LAST)
        if self.choice is not None:
            return np.array(self._chosen(points), float)
        quantile, parts = _QUANTILES[self.form], self._parts
        if not self._is_truncated:
            return self._raised(quantile(points, *parts))
        below, above = self._shares
        drawn = quantile(np.clip(below + (above - below) * points, _FIRST, _LAST), *parts)
        return self._raised(np.clip(drawn, self.least, self.greatest))

    def quantile(self, point: float) -> float:
        """Return the number that is not exceeded with a given probability; not of lists."""
        if not self.is_drawn:
            assert self.choice is not None
            return float(self.choice[0])
        return float(self.quantiles(np.array([point]))[0])

    def values(self, points: Array) -> Sequence[Any]:
        """Return the values at points of the open interval from 0 to 1, (n,): numbers, or options of a choice."""
        listed: list[Any] = self._chosen(points) if self.choice is not None else self.quantiles(points).tolist()
        return listed

    @property
    def landmarks(self) -> Sequence[Any]:
        """Representative values: every option of a choice, the ends of an interval, or the median without ends."""
        if self.choice is not None:
            return self.choice
        has_ends = self.form not in _BELOW or (self.greatest is not None and self.least is not None)
        return self.values(np.array(_ENDS if has_ends else (0.5,)))

    @property
    def lowest(self) -> float:
        """The lower bound of all numbers; negative infinity for a normal distribution without bounds."""
        if self.choice is not None:
            return float(min(self.choice))
        ends = {"normal": -math.inf, "lognormal": 0.0, "exponential": 0.0}
        lowest = ends[self.form] if self.form in ends else float(self._parts[0].min())
        return self.constant + (lowest if self.least is None else max(self.least, lowest))

    def _raised(self, drawn: Array) -> Array:
        return drawn + self.constant if self.constant else drawn

    def _chosen(self, points: Array) -> list[Any]:
        """Return the option in whose part of the interval from 0 to 1 each point lies, in their order."""
        assert self.choice is not None
        last = int(np.flatnonzero(np.diff(self._ends, prepend=0.0))[-1])
        places = np.minimum(np.searchsorted(self._ends, points, side="right"), last)
        return [self.choice[place] for place in places.tolist()]

    @cached_property
    def _ends(self) -> Array:
        """The ends of these parts."""
        assert self.choice is not None
        weights = np.ones(len(self.choice)) if self.weights is None else np.array(self.weights, float)
        ends: Array = np.cumsum(weights) / weights.sum()
        return ends


class ProbabilityDistribution(Distribution[float]):
    """A distribution: exactly one of `uniform`, `normal`, `lognormal`, `loguniform`, `exponential` and `choice`."""


class VectorDistribution(Distribution[float | Annotated[list[float], Field(min_length=1)]]):
    """A distribution whose numbers may be lists, with one for each element."""


def _check_weights(weights: Sequence[float], count: int) -> None:
    if len(weights) != count:
        raise ValueError(f"there are {len(weights)} weights for {count} options")
    if min(weights) < 0 or not 0 < sum(weights) < math.inf:
        raise ValueError("weights are at least 0, and one is greater")


def always(value: Any) -> ProbabilityDistribution:
    """The distribution that always gives one value."""
    # Without validation, whose model takes some milliseconds to build.
    return ProbabilityDistribution.model_construct(choice=(value,))


def _is_duration(distribution: ProbabilityDistribution) -> ProbabilityDistribution:
    if distribution.choice is not None and not all(_is_number(each) for each in distribution.choice):
        raise ValueError("every value of `choice` is a number [s]")
    if distribution.lowest == -math.inf:
        raise ValueError("a duration is never negative: `normal` needs a lower bound, such as least: 0")
    if distribution.lowest < 0:
        raise ValueError(f"a duration is never negative, and `{distribution.form}` may give {distribution.lowest:g} s")
    if max(distribution.largest, *distribution.choice or (0,)) > LONGEST:
        raise ValueError(f"a duration is at most {LONGEST:g} s, and `{distribution.form}` has a larger number")
    return distribution


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


Seconds = Annotated[float, Field(ge=0, le=LONGEST)]

#: How long something takes: a number of seconds, or a distribution from which each duration is drawn.
Latency = Seconds | Annotated[ProbabilityDistribution, AfterValidator(_is_duration)]


def duration_of(latency: float | ProbabilityDistribution) -> ProbabilityDistribution:
    """Return the distribution of a duration; a number is the duration that is always taken [s]."""
    return latency if isinstance(latency, ProbabilityDistribution) else always(latency)
