"""What a search for a violation may vary, and its candidates as work: points between 0 and 1 stand for values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from symaware_cli.language import Catalogue, ScenarioError, prepared
from symaware_cli.language.build import Built, build_composition
from symaware_cli.language.compose import compose
from symaware_cli.specification import VERDICTS, Outcome
from symaware_cli.studies import (
    FORMAT,
    Array,
    Block,
    LostResultError,
    ParameterChange,
    Row,
    Runner,
    SweepDocument,
    SweepError,
    SweepSource,
    unknown_specification,
)
from symaware_cli.world import ProbabilityDistribution

#: The path of the seed, which is not changed in the scenario, but given to its run.
SEED = "seed"


class CandidatePlan:
    """A `RunPlan` of candidates.

    Attributes:
        document: What all of them share.
        values: What each changes in the scenario, by its number.
    """

    def __init__(self, shared: Mapping[str, Any]) -> None:
        self.document = SweepDocument.model_validate({"symaware-sweep": FORMAT, "scenario": "-", "set": shared})
        self.values: Mapping[int, Mapping[str, Any]] = {}

    def changes(self, index: int) -> Sequence[ParameterChange]:
        """See `RunPlan`."""
        own = {path: value for path, value in self.values[index].items() if path != SEED}
        return [ParameterChange(path, value, ("set", path)) for path, value in {**self.document.set, **own}.items()]

    def seed(self, index: int) -> int | None:
        """See `RunPlan`."""
        return self.values[index].get(SEED)


class CandidateWork:
    """`Work` that makes the rows of candidates."""

    def __init__(self, scenario: str, shared: Mapping[str, Any], batch: int | None = None) -> None:
        """Prepare.

        Args:
            scenario: The scenario file.
            shared: What all candidates change in it, by its path.
            batch: See `Runner`.
        """
        self._content = {"scenario": scenario, "shared": {**shared}, "batch": batch}
        self._plan = CandidatePlan(shared)
        self._runner = Runner(self._plan, Path(scenario), batch)

    def open(self) -> None:
        """See `Work`."""

    def prepare(self) -> None:
        """See `Work`."""
        self._plan.values = {0: {}}
        self._runner.prepare()

    def results(self, block: Block) -> Iterator[Row]:
        """See `Work`."""
        self._plan.values = dict(zip(block.indices, block.values, strict=True))
        yield from self._runner.rows(block.indices)

    def refusal(self, candidates: Sequence[Mapping[str, Any]]) -> str | None:
        """Say why candidates with some values are run one by one; None if they are batched."""
        self._plan.values = dict(enumerate(candidates))
        return self._runner.refusal(range(len(candidates)))

    def to_json(self) -> dict[str, Any]:
        """See `Work`."""
        return self._content

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> CandidateWork:
        """See `Work`."""
        return cls(**content)

    def received(self, content: dict[str, Any]) -> Row:
        """See `Work`."""
        return Row(**content)

    def lost(self, index: int, why: str) -> Row:
        """See `Work`; without its outcome a search would go elsewhere."""
        raise LostResultError(f"run {index} of the search was lost: {why}")


#: The verdict that a search is for.
VIOLATED = VERDICTS[-1]


class SearchSpace:
    """The coordinates of a search, and the runs at its points.

    Attributes:
        distributions: From which distribution each value comes, by its path in the scenario.
        specification: The name of the specification that is to be violated.
    """

    def __init__(self, source: SweepSource, specification: str, seeds: int = 0) -> None:
        """Take what varies from a sweep: lists and distributions.

        Args:
            source: The sweep.
            specification: The name of the specification.
            seeds: How many seeds are tried, from 0 on; 0 for that of the scenario alone.

        Raises:
            SweepError: Nothing varies, or there is no such specification.
            ScenarioError: The scenario has problems.
        """
        document = source.plan.document
        self._scenario = source.scenario
        self._shared = [ParameterChange(path, value, ("set", path)) for path, value in document.set.items()]
        self._catalogue = Catalogue()
        self.specification = specification
        distributions = {path: ProbabilityDistribution(choice=tuple(each)) for path, each in document.listed.items()}
        distributions.update(document.drawn)
        if seeds:
            distributions[SEED] = ProbabilityDistribution(choice=tuple(range(seeds)))
        if not distributions:
            raise SweepError("there is nothing to vary: --over 'PATH={uniform: [0, 1]}', or --seeds 100")
        self.distributions: Mapping[str, ProbabilityDistribution] = distributions
        known = self.built({}).document.specifications
        if specification not in known:
            raise unknown_specification(specification, known)
        # Values elsewhere may be refused, which makes runs that fail; a path that does not exist is reported at once.
        self.built(self.values(np.full(len(distributions), 0.5)))

    def values(self, point: Array) -> dict[str, Any]:
        """Return the values at a point (d,), by their paths."""
        inside = np.clip(point, 2.0**-53, 1.0 - 2.0**-53)
        pairs = zip(self.distributions.items(), inside, strict=True)
        return {path: each.values(np.array([coordinate]))[0] for (path, each), coordinate in pairs}

    def simpler(self, path: str, value: Any) -> Sequence[float]:
        """Return near numbers with fewer significant digits, the simplest first, that the distribution may give."""
        distribution = self.distributions[path]
        if distribution.choice is not None or not isinstance(value, float):
            return ()
        low, high = distribution.values(np.array([2.0**-53, 1.0 - 2.0**-53]))
        found = [float(round(value)) + 0.0, *(float(f"{value:.{digits}g}") for digits in range(1, 7))]
        return [each for each in dict.fromkeys(found) if each != value and low <= each <= high]

    def built(self, values: Mapping[str, Any]) -> Built:
        """Build the scenario with some values.

        Raises:
            ScenarioError: They are not valid.
        """
        changes = [*self._shared, *(ParameterChange(path, value, ("over", path)) for path, value in values.items())]
        composition = compose(self._scenario, [each.assignment() for each in changes])
        return build_composition(composition, self._scenario.parent, None, self._catalogue)

    def outcome(self, values: Mapping[str, Any]) -> Outcome | None:
        """Run the scenario with some values, and return what became of the specification; None if it failed.

        Raises:
            KeyboardInterrupt: A signal ended the run.
        """
        try:
            built = self.built(values)
        except ScenarioError:
            return None
        with prepared(built, None, may_exit=False) as run:
            run.advance()
        if run.signal is not None:
            raise KeyboardInterrupt
        if run.failure is not None:
            return None
        return next(each for each in run.summary.specifications if each.name == self.specification)

    def work(self, batch: int | None = None) -> CandidateWork:
        """Return what makes the rows of runs with some values.

        Args:
            batch: See `Runner`.
        """
        shared = {change.target: change.value for change in self._shared}
        return CandidateWork(str(self._scenario), shared, batch)

    def is_violated(self, row: Row) -> bool:
        """Whether a run violates the specification."""
        return row.verdicts.get(self.specification) == VIOLATED

    @staticmethod
    def is_violation(outcome: Outcome | None) -> bool:
        """Whether an outcome is a violation."""
        return outcome is not None and outcome.verdict == VIOLATED

    def merit(self, row: Row) -> float:
        """What a search minimises: the robustness, less than any other where a specification without one is violated.

        It is infinite if the run failed.
        """
        robustness = row.robustness.get(self.specification)
        if self.is_violated(row):
            return min(robustness or 0.0, 0.0)
        return math.inf if row.state != "done" or robustness is None else robustness
