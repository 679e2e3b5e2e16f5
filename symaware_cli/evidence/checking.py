"""Evaluation of specifications on a log: those of its scenario, or new ones."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from symaware_cli.core import seconds
from symaware_cli.engine import RunError, Specifications
from symaware_cli.evidence.recorded_run import RecordedSpecifications
from symaware_cli.language import Changes, open_scenario, prepared
from symaware_cli.log import LogError
from symaware_cli.specification import Outcome


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The outcomes of specifications on a log.

    Attributes:
        log: The log.
        scenario: The name of its scenario.
        seed: The seed of the run.
        sampled: Time between two recorded steps [s], if not every step was recorded; None otherwise.
        is_whole: Whether the run reached its declared end; otherwise open verdicts remain undecided.
        specifications: The outcome of each specification.
        damage: The part of the log that could not be read and is missing from the outcomes; None if undamaged.
    """

    log: Path
    scenario: str
    seed: int
    sampled: float | None
    is_whole: bool
    specifications: tuple[Outcome, ...]
    damage: str | None = None

    @property
    def violated(self) -> tuple[str, ...]:
        """The names of the violated specifications."""
        return tuple(each.name for each in self.specifications if each.verdict == "violated")

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {**asdict(self), "log": str(self.log)}


def check_log(
    path: str | os.PathLike[str],
    specifications: Mapping[str, Mapping[str, Any]] | str | os.PathLike[str] | None = None,
    again: bool = False,
) -> CheckResult:
    """Evaluate specifications on a log.

    If every step was recorded, verdicts and robustness equal those of the run itself, bit for bit.

    Args:
        path: The log.
        specifications: Specifications by name, as under `specifications` in a scenario, or a file of them; by default
            those of the log.
        again: Whether to repeat the run instead of reading its records.

    Raises:
        LogError: The log cannot be read, or lacks data that the specifications need.
        ScenarioError: A specification is invalid.
        RunError: A specification has no value, and this is not how the run itself failed.
    """
    path = Path(path)
    statements = None if specifications is None or isinstance(specifications, Mapping) else Path(specifications)
    changes = {"specifications": specifications} if isinstance(specifications, Mapping) else {}
    if again:
        return _repeated(path, changes, statements)
    recorded = RecordedSpecifications(path, changes, statements)
    log, simulation, period = recorded.log, recorded.simulation, recorded.period
    for each in recorded.specifications:
        if missing := recorded.missing(each):
            raise LogError(
                f"{log.path} lacks data for `{each.name}`: its scenario leaves {', '.join(missing)} "
                "out of the log; repeat the run with --again"
            )
    monitors = Specifications(
        simulation,
        recorded.specifications,
        recorded.options.instances,
        recorded.router,
        recorded.observer,
        period=period,
    )
    outcome = log.outcome or {}
    with np.errstate(all="ignore"):
        for now in recorded.instants():
            try:
                monitors.look(now)
            except RunError:
                if outcome.get("status") != "failed" or now != outcome.get("time"):
                    raise
                # The run itself failed because of this.
    is_whole = outcome.get("status") == "finished" or bool(outcome.get("complete"))
    if is_whole:
        monitors.finish(simulation.clock.now)
    sampled = seconds(period) if period != recorded.step else None
    damage = str(log.damage) if log.damage and log.damage.lost else None
    return CheckResult(path, simulation.name, simulation.seed, sampled, is_whole, monitors.outcomes(), damage)


def _repeated(path: Path, changes: Changes, statements: Path | None) -> CheckResult:
    """Return the outcomes of repeating the run of a log."""
    built = open_scenario(path, changes, statements=statements)
    with prepared(built, None, may_exit=False) as run:
        summary = run.execute()
    if run.failure is not None:
        raise run.failure
    is_whole = summary.status == "finished"
    return CheckResult(path, summary.name, summary.seed, None, is_whole, summary.specifications)
