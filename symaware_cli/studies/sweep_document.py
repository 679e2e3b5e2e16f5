"""The format of sweep files: scenario, varied parameters, number of runs, and logs to keep."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from symaware_cli.core.identifiers import Name
from symaware_cli.language import Identifier, Section, Use
from symaware_cli.studies.claim import Claim
from symaware_cli.studies.statistics.parameter_distribution import (
    Choice,
    LogUniformDistribution,
    NormalDistribution,
    ParameterDistribution,
    UniformDistribution,
)

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})\s*\.\.\s*({_NUMBER})(?:\s+by\s+({_NUMBER}))?\s*", re.ASCII)

#: The maximum length of a range, which bounds the matching time of the pattern [characters].
_LONGEST = 200

#: The maximum number of values of a range, its greatest number, and its least step.
_MOST, _GREATEST, _LEAST_STEP = 100_000, Decimal("1e30"), Decimal("1e-30")


def is_range(text: str) -> bool:
    """Return whether a text is a range, such as ``0..1 by 0.1``."""
    return len(text) <= _LONGEST and ".." in text and _RANGE.fullmatch(text) is not None


def expanded(value: Any) -> Any:
    """Return the values of a range, including both ends; other values are returned unchanged.

    The values are rounded as a person would write them: ``0..1 by 0.1`` contains 0.3, not 0.30000000000000004.

    Raises:
        ValueError: The range is empty, infinite or too long, or has neither a step nor integer ends.
    """
    found = _RANGE.fullmatch(value) if isinstance(value, str) and is_range(value) else None
    if found is None:
        return value
    if found[3] is None and not all(re.fullmatch(r"[-+]?\d+", text) for text in (found[1], found[2])):
        ends = f"{found[1]}..{found[2]}"
        raise ValueError(
            f"the range {ends} has no step: write `{ends} by STEP` for values that far apart, or "
            f"{{uniform: [{found[1]}, {found[2]}]}} to draw from between them"
        )
    first, last, step = (Decimal(text) for text in (found[1], found[2], found[3] or "1"))
    if max(each.copy_abs() for each in (first, last, step)) > _GREATEST or 0 < step.copy_abs() < _LEAST_STEP:
        raise ValueError(f"numbers of a range are at most {_GREATEST:g}, and its step is at least {_LEAST_STEP:g}")
    if step == 0 or (last - first) / step < 0:
        raise ValueError(f"the range never gets from {first} to {last} by {step}")
    count = int((last - first) / step) + 1
    if count > _MOST:
        raise ValueError(f"the range has {count:,} values; at most {_MOST:,} make sense")
    is_whole = all(re.fullmatch(r"[-+]?\d+", text) for text in (found[1], found[3] or "1"))
    return [int(first + step * k) if is_whole else float(first + step * k) for k in range(count)]


_LISTED = {
    "anyOf": [{"type": "array", "minItems": 1}, {"type": "string", "pattern": r"\.\."}],
    "description": "A list of values, or a range such as `0..1 by 0.1`, with both ends.",
}
Values = Annotated[list[Any], BeforeValidator(expanded), Field(min_length=1), WithJsonSchema(_LISTED)]

#: The probabilities of the ends of an interval, up to rounding: those of lying beyond are 2^-40.
_ENDS = (2.0**-40, 1.0 - 2.0**-40)


def _sound(kind: type[Any]) -> AfterValidator:
    """Validate that two numbers define a distribution, so that a problem is located at them."""

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
        """The distribution, which maps numbers between 0 and 1 to values."""
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
        """Representative values: every option of a choice, both ends of an interval, or the mean."""
        if self.choice is not None:
            return self.choice
        return self.distribution.values(np.array(_ENDS if self.normal is None else (0.5,)))


#: The version of the format that this package reads.
FORMAT = 1

#: The maximum numbers of runs of a sweep and of combinations of parameters.
MOST_RUNS, MOST_CELLS = 10_000_000, 100_000

Target = Annotated[str, Field(min_length=1, max_length=500)]
Changes = dict[Target, Any]


def _kept(text: str) -> str:
    if not re.fullmatch(r"none|failed|all|worst:[1-9][0-9]{0,5}", text):
        raise ValueError("say none, failed, all, or worst:N such as worst:5")
    return text


#: The pattern of a claim in the schema, for editors; `Claim.parse` checks the rest.
_CLAIM = {"type": "string", "maxLength": 500, "pattern": r"^\s*P\(.+\)\s*>"}


def _claim(text: str) -> str:
    return str(Claim.parse(text))


def _stated(text: object) -> object:
    """Return a claim, or None for `none`, which removes the claim of the file from the command line."""
    return None if text == "none" else text


class MetricUse(Use):
    """A metric of a plugin."""


class SweepDocument(Section):
    """A sweep for `symaware sweep`: many runs of one scenario."""

    symaware_sweep: Literal[1] = Field(alias="symaware-sweep", description="Version of the format of sweeps.")
    scenario: str = Field(
        min_length=1, description="The scenario file, or a log of it, relative to the folder of this file."
    )
    description: str = Field("", description="What is asked, and what is expected.")
    seed: int = Field(0, ge=0, lt=2**63, description="Seed of the sweep, from which the seed of each run is derived.")
    runs: int = Field(1, ge=1, le=MOST_RUNS, description="Runs of each combination of parameters and variant.")
    set: Changes = Field(default_factory=dict, description="Values that all runs share, by their paths.")
    over: dict[Target, Values | DrawnValues] = Field(
        default_factory=dict,
        description="What varies, by the paths of its values in the scenario: lists, of which every combination is "
        "run, and distributions such as {uniform: [0, 1]}, from which each run draws.",
    )
    design: Literal["random", "latin-hypercube", "sobol"] = Field(
        "random",
        description="How the `runs` of each combination draw from distributions: independently, with one run in each "
        "of `runs` equally likely parts of each distribution, or filling the space of all of them evenly.",
    )
    together: list[dict[Target, Values]] = Field(
        default_factory=list,
        description="Values that vary together: in each mapping all lists have the same length, and the first values "
        "are run with each other, then the second ones.",
    )
    variants: dict[Name, Changes] = Field(
        default_factory=dict, description="Variants of the scenario by name, each with the values that it changes."
    )
    paired: bool = Field(
        False, description="Whether all variants share the seed of each run, so that they differ in nothing else."
    )
    metrics: dict[Identifier, str | MetricUse] = Field(
        default_factory=dict,
        description="Further metrics by name: a series that is reduced, such as `max(highest_risk)`, "
        "`final(position.leader[0])` or `mean(...)`, or a metric of a plugin.",
    )
    until: str | None = Field(
        None,
        max_length=500,
        description="Rule that ends the runs of each combination before `runs` of them were made, such as "
        "`halfwidth(satisfied.safe) < 0.01`.",
    )
    claim: Annotated[
        Annotated[str, AfterValidator(_claim), WithJsonSchema(_CLAIM)] | None, BeforeValidator(_stated)
    ] = Field(
        None,
        max_length=500,
        description="What `symaware certify` is to certify, such as `P(safe) > 0.99 with confidence 0.99, sequential`: "
        "`fixed` looks once, after all `runs`; `sequential` ends the runs of a combination when it is established.",
    )
    bounds: dict[str, tuple[float, float]] = Field(
        default_factory=dict,
        description="The least and the greatest possible value of metrics, in their units: without them, `until` "
        "cannot be about their means.",
    )
    confidence: float = Field(0.95, gt=0, lt=1, description="Confidence of the intervals that `until` is about.")
    keep: Annotated[str, AfterValidator(_kept)] = Field(
        "none",
        description="Which logs are kept: none, failed (of failed runs), worst:N (of the N runs with the least "
        "robustness or, without specifications, the least separation), or all.",
    )
    timeout: float | None = Field(
        None, gt=0, le=1e6, description="Wall time after which a run is given up [s]. By default there is no limit."
    )

    @property
    def listed(self) -> dict[str, list[Any]]:
        """The listed parameters, by path."""
        return {path: each for path, each in self.over.items() if isinstance(each, list)}

    @property
    def drawn(self) -> dict[str, DrawnValues]:
        """The drawn parameters, by path."""
        return {path: each for path, each in self.over.items() if isinstance(each, DrawnValues)}

    @property
    def claimed(self) -> Claim | None:
        """The parsed claim; None without one."""
        return None if self.claim is None else Claim.parse(self.claim)

    @property
    def may_stop(self) -> bool:
        """Whether a combination may end before all planned runs are executed, depending on their results."""
        return self.until is not None or (self.claimed is not None and self.claimed.rule == "sequential")

    @property
    def is_independent(self) -> bool:
        """Whether the runs of a combination are independent, as intervals and rules assume."""
        return self.design == "random"
