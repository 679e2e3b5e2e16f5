"""Degradation that a claim withstands: levels from mild to severe, certified in this order until one is not.

Reasons: docs/decisions/0091-awareness-contracts.md
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from symaware_cli.evidence.certificate_page import decided
from symaware_cli.evidence.certification import certify
from symaware_cli.evidence.severity_grid import SeverityGrid, severity_grid
from symaware_cli.language import Changes, FilePath
from symaware_cli.language.build import build
from symaware_cli.log import whole_file
from symaware_cli.studies import (
    Claim,
    SweepError,
    SweepFolder,
    SweepProgress,
    SweepRequest,
    conduct,
    is_sweep,
    read_sweep,
    require_pyarrow,
)

#: The summary in the folder of a budget.
BUDGET = "budget.json"

_Level = TypeVar("_Level")


def fixed_sequence(levels: Iterable[_Level], is_certified: Callable[[_Level], bool]) -> int:
    """Test levels in their order, and return the number of levels certified before the first that is not.

    Each level is tested with the whole error probability alpha, and later levels are not tested. All certified levels
    hold jointly with an error probability of at most alpha, because the first false level, in the order that was
    declared beforehand, has to be certified for any error to be made. It assumes neither that the levels are monotone
    nor that their tests are independent.

    Args:
        levels: The levels in the declared order.
        is_certified: Tests a level.

    Source: W. Maurer, L. A. Hothorn, W. Lehmacher, "Multiple Comparisons in Drug Clinical Trials and Preclinical
    Assays: A-Priori Ordered Hypotheses", in J. Vollmar (ed.), Biometrie in der chemisch-pharmazeutischen Industrie 6,
    Fischer, 1995.
    """
    count = 0
    for level in levels:
        if not is_certified(level):
            break
        count += 1
    return count


@dataclass(frozen=True, slots=True)
class BudgetLevel:
    """A level that was tested.

    Attributes:
        value: The value of the degradation.
        folder: The folder of its sweep, with a certificate if it is certified.
        is_certified: Whether the claim is established at this level.
        combinations: The figures of its certificate; see `certify`.
    """

    value: Any
    folder: Path
    is_certified: bool
    combinations: Sequence[Mapping[str, Any]]

    @property
    def figures(self) -> str:
        """The number of runs counted for each term of the claim, and of those against it, as text."""
        return "; ".join(
            (f"{text}: " if text else "") + f"{each['runs']:,} runs, {each['runs'] - each['satisfied']:,} against"
            for cell in self.combinations
            for text, each in decided(cell)
        )


@dataclass(frozen=True, slots=True)
class Budget:
    """The degradation that a claim withstands.

    Attributes:
        claim: The claim.
        grid: The levels in the order of their tests.
        tested: The levels that were tested; at most the last is not certified.
    """

    claim: Claim
    grid: SeverityGrid
    tested: Sequence[BudgetLevel]

    @property
    def certified(self) -> int:
        """The number of certified levels."""
        return sum(each.is_certified for each in self.tested)

    @property
    def certified_up_to(self) -> Any:
        """The last value that is certified, with all before it; None if the first is not."""
        return self.grid.values[self.certified - 1] if self.certified else None

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "claim": str(self.claim),
            "over": self.grid.name,
            "paths": [*self.grid.paths],
            "grid": [*self.grid.values],
            "certified": self.certified,
            "certified_up_to": self.certified_up_to,
            "levels": [
                {
                    "value": each.value,
                    "folder": each.folder.name,
                    "certified": each.is_certified,
                    "combinations": [dict(cell) for cell in each.combinations],
                }
                for each in self.tested
            ],
        }


def budget(
    scenario: FilePath,
    output: FilePath,
    *,
    claim: str,
    over: str,
    runs: int | None = None,
    changes: Changes | None = None,
    seed: int = 0,
    jobs: int = 0,
    on_level: Callable[[BudgetLevel], object] | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> Budget:
    """Certify a claim at levels of a degradation, from mild to severe, until it is not established at one.

    All certified levels hold jointly with the confidence of the claim; see `fixed_sequence`. If the folder exists, its
    missing runs are made.

    Args:
        scenario: A scenario, or a log of one.
        output: The folder for a sweep of each level, its certificate, and ``budget.json``.
        claim: The claim, such as ``P(safe) > 0.99 with confidence 0.99``.
        over: The degraded quantity: ``noise``, ``delay``, ``loss`` or ``range``, or a path; with ``=`` and the levels,
            in their order.
        runs: The number of runs at each level; for a sequential claim, the greatest number. By default as many as
            establish the claim with two failures.
        changes: Changes to the scenario that all levels share.
        seed: The seed of the sweeps. All levels share it.
        jobs: The number of worker processes; 0 to execute runs in this process. It does not affect the result.
        on_level: Called after each level.
        on_progress: Called after each run with the number of runs of the level so far, and planned.

    Raises:
        ValueError: The claim is invalid.
        ScenarioError: The scenario or the grid is invalid; nothing was run.
        SweepError: The folder has other contents.
        KeyboardInterrupt: A signal ended the runs; the call can be repeated.
    """
    require_pyarrow()
    path, place, stated = Path(scenario), Path(output), Claim.parse(claim)
    if runs is None:
        runs = max(stated.runs_needed(term, 2, 1) for term in stated.terms)
    entries = {"claim": str(stated), "runs": runs, "seed": seed}
    shared = dict(changes) if isinstance(changes, Mapping) else changes
    source = read_sweep(path, SweepRequest((), shared or (), entries))
    built = build(source.scenario, source.assignments(source.plan.changes(0)), name=source.name)
    built.simulation.environment.close()
    grid = severity_grid(over, built)
    # All levels are planned, and their scenarios checked, before the first run.
    folders = [
        _planned(path, place / f"level-{level:03}", grid.changes(level), shared, entries)
        for level in range(len(grid.values))
    ]
    tested: list[BudgetLevel] = []

    def is_certified(level: int) -> bool:
        outcome = conduct(folders[level], jobs, on_progress=None if on_progress is None else _shown(on_progress))
        if outcome.is_interrupted:
            raise KeyboardInterrupt
        made = certify(folders[level].path)
        cells = made.statement["predicate"]["combinations"]
        found = BudgetLevel(grid.values[level], folders[level].path, made.is_established, cells)
        tested.append(found)
        if on_level is not None:
            on_level(found)
        return found.is_certified

    fixed_sequence(range(len(grid.values)), is_certified)
    result = Budget(stated, grid, tested)
    with whole_file(place / BUDGET) as partial:
        partial.write_text(json.dumps(result.to_json(), indent=1) + "\n", encoding="utf-8")
    return result


def _planned(
    path: Path, place: Path, level: Mapping[str, Any], shared: Changes | None, entries: Mapping[str, Any]
) -> SweepFolder:
    """Create the folder of a level, or open it if it is the same sweep."""
    if isinstance(shared, Mapping) or shared is None:
        changes: Changes = {**(shared or {}), **level}
    else:
        changes = [*shared, *(f"{name}={json.dumps(value)}" for name, value in level.items())]
    source = read_sweep(path, SweepRequest((), changes, entries))
    if not is_sweep(place):
        above, is_new = place.parent, not place.parent.exists()
        try:
            above.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SweepError(f"cannot create {above}: {error.strerror}") from None
        try:
            return SweepFolder.created(place, source)
        finally:
            if is_new and not place.exists():
                above.rmdir()
    folder = SweepFolder.opened(place)
    folder.compare(source)
    return folder


def _shown(on_progress: Callable[[int, int], object]) -> Callable[[SweepProgress], object]:
    return lambda progress: on_progress(progress.made, progress.planned)
