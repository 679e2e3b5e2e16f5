"""The search space of a falsification, with coordinates between 0 and 1, and the work of running its candidates."""

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

#: The path of the seed, which is passed to the run instead of being changed in the scenario.
SEED = "seed"


class CandidatePlan:
    """A `RunPlan` of candidates.

    Attributes:
        document: The document with the settings and changes that all candidates share.
        values: The changed values of each candidate, by number.
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
    """`Work` that produces the rows of candidates."""

    def __init__(self, scenario: str, shared: Mapping[str, Any], batch: int | None = None) -> None:
        """Prepare.

        Args:
            scenario: The scenario file.
            shared: The changes that all candidates share, by path.
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
        """Return why candidates are executed one by one; None if they are batched."""
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
        """See `Work`; a search without this outcome would take another course, so it cannot be replaced."""
        raise LostResultError(f"run {index} of the search was lost: {why}")


#: The verdict that a search looks for.
VIOLATED = VERDICTS[-1]


class SearchSpace:
    """The coordinates of a search, and the runs at its points.

    Attributes:
        distributions: The distribution of each value, by path in the scenario.
        specification: The name of the specification that is to be violated.
    """

    def __init__(self, source: SweepSource, specification: str, seeds: int = 0) -> None:
        """Create the search space from the lists and distributions of a sweep.

        Args:
            source: The sweep.
            specification: The name of the specification.
            seeds: The number of seeds to search, from 0 on; 0 to use only the scenario's own.

        Raises:
            SweepError: Nothing varies, or there is no such specification.
            ScenarioError: The scenario is invalid.
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
        # The scenario may reject values at other points, whose runs then fail; a nonexistent path is reported at once.
        self.built(self.values(np.full(len(distributions), 0.5)))

    def values(self, point: Array) -> dict[str, Any]:
        """Return the values at a point (d,), by path."""
        inside = np.clip(point, 2.0**-53, 1.0 - 2.0**-53)
        pairs = zip(self.distributions.items(), inside, strict=True)
        return {path: each.values(np.array([coordinate]))[0] for (path, each), coordinate in pairs}

    def simpler(self, path: str, value: Any) -> Sequence[float]:
        """Return nearby numbers with fewer significant digits in the range of the distribution, the simplest first."""
        distribution = self.distributions[path]
        if distribution.choice is not None or not isinstance(value, float):
            return ()
        low, high = distribution.values(np.array([2.0**-53, 1.0 - 2.0**-53]))
        found = [float(round(value)) + 0.0, *(float(f"{value:.{digits}g}") for digits in range(1, 7))]
        return [each for each in dict.fromkeys(found) if each != value and low <= each <= high]

    def built(self, values: Mapping[str, Any]) -> Built:
        """Build the scenario with the given values.

        Raises:
            ScenarioError: The values are invalid.
        """
        changes = [*self._shared, *(ParameterChange(path, value, ("over", path)) for path, value in values.items())]
        composition = compose(self._scenario, [each.assignment() for each in changes])
        return build_composition(composition, self._scenario.parent, None, self._catalogue)

    def outcome(self, values: Mapping[str, Any]) -> Outcome | None:
        """Run the scenario with the given values, and return the outcome of the specification; None if the run failed.

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
        """Return the work of running candidates.

        Args:
            batch: See `Runner`.
        """
        shared = {change.target: change.value for change in self._shared}
        return CandidateWork(str(self._scenario), shared, batch)

    def is_violated(self, row: Row) -> bool:
        """Return whether a run violates the specification."""
        return row.verdicts.get(self.specification) == VIOLATED

    @staticmethod
    def is_violation(outcome: Outcome | None) -> bool:
        """Return whether an outcome is a violation."""
        return outcome is not None and outcome.verdict == VIOLATED

    def merit(self, row: Row) -> float:
        """Return the objective of a search: the robustness, capped at 0 if the specification is violated.

        It is 0 for a violated specification without robustness, and infinite for failed runs and unknown robustness.
        """
        robustness = row.robustness.get(self.specification)
        if self.is_violated(row):
            return min(robustness or 0.0, 0.0)
        return math.inf if row.state != "done" or robustness is None else robustness
