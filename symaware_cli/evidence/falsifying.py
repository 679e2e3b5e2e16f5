"""Falsification of a specification: a violation is searched for and written as a scenario with its log."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from symaware_cli.evidence.falsification import SearchResult, search
from symaware_cli.evidence.search_method import method_named
from symaware_cli.evidence.search_space import SearchSpace
from symaware_cli.language import Changes, FilePath, open_scenario, write_log
from symaware_cli.log import require_writable_folder, whole_folder
from symaware_cli.specification import Outcome
from symaware_cli.studies import Over, SweepRequest, read_sweep, varied

#: The names of the files in the folder of a violation.
COUNTEREXAMPLE, LOG, RESULT = "counterexample.yaml", "counterexample.mcap", "falsification.json"


@dataclass(frozen=True, slots=True)
class Falsification:
    """The result of a search for a violation.

    Attributes:
        scenario: The scenario.
        specification: The name of the specification.
        method: The name of the search method.
        seed: The seed of the search.
        over: The varied parameters, as requested.
        result: The result of the search.
        folder: The folder with the counterexample and its log; None if none was written.
        digest: The SHA-256 of the scenario's file, in hexadecimal.
    """

    scenario: Path
    specification: str
    method: str
    seed: int
    over: Sequence[str]
    result: SearchResult
    folder: Path | None = None
    digest: str = ""

    @property
    def is_found(self) -> bool:
        """Whether a violation was found."""
        return self.result.found is not None

    @property
    def outcome(self) -> Outcome | None:
        """The outcome of the specification in the violation, or in the least robust run."""
        return self.result.outcome

    @property
    def bound(self) -> float | None:
        """Upper bound of the violation probability, with confidence 0.95, if independent draws found none; else None.

        The probability refers to the distributions of the draws. The bound is the upper end of the Clopper-Pearson
        interval without successes.
        """
        runs = self.result.runs - self.result.failed
        if self.is_found or not runs or not method_named(self.method).is_independent:
            return None
        return -math.expm1(math.log(0.05) / runs)

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        result = self.result
        return {
            "found": self.is_found,
            "scenario": str(self.scenario),
            "specification": self.specification,
            "method": self.method,
            "seed": self.seed,
            "over": list(self.over),
            "runs": result.runs,
            "failed": result.failed,
            "failure": result.failure,
            "runs_to_shrink": result.shrinking,
            "one_by_one": result.one_by_one,
            "values": dict(result.values),
            "values_found": None if result.found is None else dict(result.found),
            "outcome": None if result.outcome is None else asdict(result.outcome),
            "probability_at_most": self.bound,
            "folder": None if self.folder is None else str(self.folder),
            "scenario_sha256": self.digest,
        }


def falsify(
    scenario: FilePath,
    specification: str,
    output: FilePath | None = None,
    *,
    over: Over = (),
    seeds: int = 0,
    changes: Changes | None = None,
    method: str = "differential-evolution",
    runs: int = 200,
    seed: int = 0,
    jobs: int = 0,
    batch: int | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> Falsification:
    """Search for values with which a scenario violates a specification, and simplify the violation.

    Args:
        scenario: A scenario, or a log of one.
        specification: The name of the specification.
        output: A new or empty folder for the counterexample, its log and the result; nothing is written without a
            violation. By default nothing is kept.
        over: The varied parameters, as for `sweep`.
        seeds: The number of seeds of the scenario that are searched as well; 0 to use only its own.
        changes: Changes to the scenario that all runs share.
        method: ``random``, ``differential-evolution``, ``tpe``, ``cma-es``, or the name of a plugin.
        runs: The maximum number of runs, apart from those for simplification.
        seed: The seed of the search.
        jobs: The number of worker processes; 0 to execute runs in this process. It does not affect the result.
        batch: The maximum number of runs batched as arrays; 1 for none. It does not affect the result.
        on_progress: Called after each run with the number of completed runs and the maximum.

    Raises:
        ScenarioError: The scenario or a varied parameter is invalid.
        SweepError: Nothing varies, there is no such specification or method, the method needs a module that is not
            installed, or a worker process died.
        OutputError: The folder cannot be written.
        KeyboardInterrupt: A signal ended a run.
    """
    path = Path(scenario)
    asked = varied(over)
    said = tuple(map(str, asked))
    source = read_sweep(path, SweepRequest(asked, changes or ()))
    if output is not None:
        require_writable_folder(output)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    space = SearchSpace(source, specification, seeds)
    result = search(space, method, runs, seed, jobs, batch, on_progress)
    found = Falsification(path, specification, method, seed, said, result, digest=digest)
    if not found.is_found or output is None:
        return found
    folder = Path(output)
    found = Falsification(path, specification, method, seed, said, result, folder, digest)
    built = space.built(result.values)
    with whole_folder(folder) as partial:
        for name, content in built.files.items():
            partial.joinpath(name).parent.mkdir(parents=True, exist_ok=True)
            partial.joinpath(name).write_bytes(content)
        (partial / COUNTEREXAMPLE).write_bytes(_commented(found) + built.resolved)
        write_log(open_scenario(partial / COUNTEREXAMPLE), partial / LOG)
        (partial / RESULT).write_text(json.dumps(found.to_json(), indent=1) + "\n")
    return found


def _commented(found: Falsification) -> bytes:
    """Return the comment at the top of the counterexample."""
    lines = [f"{found.scenario.name} with these values violates `{found.specification}`:"]
    lines += [f"  {path}={json.dumps(value)}" for path, value in found.result.values.items()] or ["  (as it is)"]
    if found.outcome is not None:
        lines.append(str(found.outcome))
    return "".join(f"# {' '.join(line.splitlines())}\n" for line in lines).encode()
