"""Candidates of a search as work: runs of one scenario with values that the search chose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from symaware_cli.study.row import Row
from symaware_cli.study.runner import Runner
from symaware_cli.study.sweep_document import FORMAT, SweepDocument
from symaware_cli.study.sweep_error import SweepError
from symaware_cli.study.sweep_plan import ParameterChange
from symaware_cli.study.work import Block

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
        return {"kind": "candidates", **self._content}

    def received(self, content: dict[str, Any]) -> Row:
        """See `Work`."""
        return Row(**content)

    def lost(self, index: int, why: str) -> Row:
        """See `Work`; without its outcome a search would go elsewhere."""
        raise SweepError(f"run {index} of the search was lost: {why}")
