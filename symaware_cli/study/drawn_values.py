"""A parameter of a sweep that is drawn: from which distribution, as a file says it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from symaware_cli.scenario.section import Section
from symaware_cli.study.statistics.parameter_distribution import (
    Choice,
    LogUniformDistribution,
    NormalDistribution,
    ParameterDistribution,
    UniformDistribution,
)
from symaware_cli.study.values import expanded

_LISTED = {
    "anyOf": [{"type": "array", "minItems": 1}, {"type": "string", "pattern": r"\.\."}],
    "description": "A list of values, or a range such as `0..1 by 0.1`, with both ends.",
}
Values = Annotated[list[Any], BeforeValidator(expanded), Field(min_length=1), WithJsonSchema(_LISTED)]

#: What is an end of an interval, up to rounding: where the probability to lie beyond is 2^-40.
_ENDS = (2.0**-40, 1.0 - 2.0**-40)


def _sound(kind: type[Any]) -> AfterValidator:
    """Make sure that two numbers make a distribution, so that a problem is shown where they stand."""

    def check(numbers: tuple[float, float]) -> tuple[float, float]:
        kind(*numbers)
        return numbers

    return AfterValidator(check)


Pair = tuple[float, float]


class DrawnValues(Section):
    """A distribution from which each run draws a value: exactly one of `uniform`, `normal`, `log_uniform`, `choice`."""

    uniform: Annotated[Pair, _sound(UniformDistribution)] | None = Field(
        None, description="[low, high]: all numbers between them are equally likely."
    )
    normal: Annotated[Pair, _sound(NormalDistribution)] | None = Field(None, description="[mean, standard deviation].")
    log_uniform: Annotated[Pair, _sound(LogUniformDistribution)] | None = Field(
        None, description="[low, high], greater than 0: numbers whose logarithm is uniform."
    )
    choice: Values | None = Field(None, description="One of these values, or of a range such as `1..8`.")
    weights: list[float] | None = Field(
        None, description="How likely each value of `choice` is, in any common unit; by default all are equally likely."
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if len(self.model_fields_set - {"weights"}) != 1 or self._said is None:
            raise ValueError("say exactly one of uniform, normal, log_uniform and choice")
        if self.weights is not None and self.choice is None:
            raise ValueError("weights go with `choice`")
        if self.choice is not None:
            Choice(self.choice, self.weights)
        return self

    @property
    def _said(self) -> str | None:
        return next((name for name in ("uniform", "normal", "log_uniform", "choice") if getattr(self, name)), None)

    @cached_property
    def distribution(self) -> ParameterDistribution:
        """The distribution, which turns numbers between 0 and 1 into values."""
        if self.choice is not None:
            return Choice(self.choice, self.weights)
        if self.uniform is not None:
            return UniformDistribution(*self.uniform)
        if self.log_uniform is not None:
            return LogUniformDistribution(*self.log_uniform)
        assert self.normal is not None
        return NormalDistribution(*self.normal)

    @property
    def landmarks(self) -> Sequence[Any]:
        """Values that stand for all: every option of a choice, both ends of an interval, or the mean."""
        if self.choice is not None:
            return self.choice
        return self.distribution.values(np.array(_ENDS if self.normal is None else (0.5,)))
