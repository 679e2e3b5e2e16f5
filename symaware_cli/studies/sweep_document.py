"""The format of sweep files: scenario, varied parameters, number of runs, and logs to keep.

Reasons: docs/decisions/0033-drawn-parameters.md
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema

from symaware_cli.core.identifiers import Name
from symaware_cli.language import Identifier, Section, Use
from symaware_cli.studies.claim import Claim
from symaware_cli.world import LISTED, ProbabilityDistribution, expanded

Values = Annotated[list[Any], BeforeValidator(expanded), Field(min_length=1), WithJsonSchema(LISTED)]

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
    over: dict[Target, Values | ProbabilityDistribution] = Field(
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
    def drawn(self) -> dict[str, ProbabilityDistribution]:
        """The drawn parameters, by path."""
        return {path: each for path, each in self.over.items() if isinstance(each, ProbabilityDistribution)}

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
