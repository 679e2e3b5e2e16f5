"""Fuzzes the composition of features: whole scenarios, of which every promise of the documentation must hold."""

from __future__ import annotations

import json
import tempfile
import warnings
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

from fuzzing.composer import BuildFailure, Composer, is_valid
from fuzzing.invariants import check
from fuzzing.shrinking import shrunk
from fuzzing.side_files import write_side_files
from fuzzing.subject import Subject
from fuzzing.target import Finding, Target

#: The greatest number of steps of a run.
_STEPS = 60


class Compositions(Target):
    """Each case is a scenario, the seed of what is drawn to check it, and the invariants to check, or null for all."""

    time_limit = 600.0
    cases_per_worker = 100

    def prepare(self, folder: Path) -> None:
        """Read the schema with the parameters of all plugins."""
        from symaware_cli.language import scenario_schema

        self._draft = folder / "draft.yaml"
        write_side_files(folder)
        self._composer = Composer(scenario_schema()[0], lambda tree: is_valid(tree, self._draft, _STEPS))

    def make(self, chance: Random) -> bytes:
        """Compose a scenario."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                scenario = self._composer.scenario(chance)
            except BuildFailure as failure:
                scenario = failure.tree  # which `attempt` builds again, and reports
        return written_case(scenario, chance.randrange(2**32), None)

    def attempt(self, case: bytes, folder: Path) -> Counter[str]:
        """Check the invariants."""
        content = json.loads(case)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            counts, findings = check(Subject(content["scenario"], folder, content["seed"]), content["invariants"])
        if findings:
            others = "".join(f"\nalso {each.kind}: {each.where}" for each in findings[1:])
            raise Finding(findings[0].kind, f"{findings[0]}{others}", findings[0].where)
        return counts

    def shrunk(self, case: bytes, folder: Path) -> bytes:
        """Leave out what can be left out, and keep the one invariant that does not hold."""
        content = json.loads(case)
        wanted = self._found(content["scenario"], content, content["invariants"], folder)
        if wanted is None:
            return case
        kind, where = wanted

        def breaks(scenario: dict[str, Any]) -> bool:
            return self._found(scenario, content, [kind], folder) == (kind, where)

        return written_case(shrunk(content["scenario"], breaks), content["seed"], [kind])

    def _found(
        self, scenario: dict[str, Any], content: dict[str, Any], names: list[str] | None, folder: Path
    ) -> tuple[str, str] | None:
        """The first invariant of a scenario that does not hold, and what identifies the cause."""
        if not is_valid(scenario, self._draft, _STEPS):
            return None
        with tempfile.TemporaryDirectory(dir=folder) as here, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _, findings = check(Subject(scenario, Path(here), content["seed"]), names)
        return (findings[0].kind, findings[0].where) if findings else None


def written_case(scenario: dict[str, Any], seed: int, invariants: list[str] | None) -> bytes:
    """Write a case."""
    return json.dumps({"invariants": invariants, "seed": seed, "scenario": scenario}, indent=1).encode()


TARGET = Compositions()
