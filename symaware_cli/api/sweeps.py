"""Sweeps from Python: many runs of a scenario, and their table."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.language import Changes, FilePath

if TYPE_CHECKING:
    from symaware_cli.api.scenario import Scenario
    from symaware_cli.api.sweep_result import SweepResult
    from symaware_cli.evidence import Level, SweepVerification
    from symaware_cli.studies import Over, SweepFolder, SweepPlan, SweepRequest


def sweep(
    scenario: FilePath,
    output: FilePath | None = None,
    *,
    over: Over | None = None,
    design: str | None = None,
    changes: Changes | None = None,
    variants: Mapping[str, Mapping[str, Any]] | None = None,
    runs: int | None = None,
    seed: int | None = None,
    paired: bool = False,
    until: str | None = None,
    claim: str | None = None,
    keep: str | None = None,
    timeout: float | None = None,
    jobs: int = 0,
    on: str | None = None,
    batch: int | None = None,
    fail_fast: bool = False,
) -> SweepResult:
    """Make many runs of a scenario, and return their table.

    Args:
        scenario: A scenario or a log of one, the file of a sweep, or the folder of a sweep to resume.
        output: The folder for the journal and the table; if it contains the same sweep, it is resumed. By default
            nothing is kept.
        over: Values of the scenario that vary, by their paths: lists, ranges such as ``"0..1 by 0.1"``, or
            distributions such as ``{"uniform": [0, 1]}``, from which each run draws.
        design: The sampling of the distributions: ``random``, ``latin-hypercube`` or ``sobol``.
        changes: Values of the scenario that all runs share, by their paths.
        variants: Variants of the scenario by name, each with its values by their paths.
        runs: Runs of each combination.
        seed: The seed of the sweep.
        paired: Whether all variants share the seed of each run.
        until: A rule that ends the runs of each combination early, such as ``"halfwidth(satisfied.safe) < 0.01"``.
        claim: The claim to certify, such as ``"P(safe) > 0.99 with confidence 0.99, sequential"``; ``"none"`` removes
            the claim of the file.
        keep: Which logs are kept: ``none``, ``failed``, ``worst:N`` or ``all``.
        timeout: Wall time after which a run is given up [s].
        jobs: The number of worker processes; 0 to execute all runs in this process.
        on: The executor of the runs, as ``EXECUTOR`` or ``EXECUTOR:ADDRESS``, such as ``"ray:10.0.0.1:6379"`` or
            ``"ray:auto"`` for a Ray cluster; `jobs` is then the number of concurrent runs, 0 for as many as
            possible. By default this machine.
        batch: The maximum number of runs batched as arrays; 1 for none. The rows are the same.
        fail_fast: Whether to stop at the first failed run.

    Returns:
        One row for each run, in the order of their indices; docs/sweeps.md describes the columns. The result is used
        like a table of Arrow, and `SweepResult.frame` converts it.

    Raises:
        ScenarioError: The sweep or the scenario has problems; nothing was run.
        SweepError: The folder has other contents, there is no such cluster, or its nodes have other code.
        KeyboardInterrupt: Ctrl-C ended the sweep; the rows are in the folder.
    """
    from symaware_cli.studies import TABLE, SweepRequest, conduct, execution_at

    entries: dict[str, Any] = {
        "runs": runs,
        "seed": seed,
        "paired": paired or None,
        "keep": keep,
        "timeout": timeout,
        "design": design,
        "until": until,
        "claim": claim,
        **{f"variants.{name}": each for name, each in (variants or {}).items()},
    }
    given = {key: value for key, value in entries.items() if value is not None}
    request = SweepRequest(over or (), changes or (), given)
    execution_at(on)  # before a folder is made
    with tempfile.TemporaryDirectory() as temporary:
        folder = opened(Path(scenario), Path(temporary, "sweep") if output is None else Path(output), request)
        outcome = conduct(folder, jobs, place=on, batch=batch, fail_fast=fail_fast)
        if outcome.is_interrupted:
            raise KeyboardInterrupt
        from pyarrow import parquet

        from symaware_cli.api.sweep_result import SweepResult

        kept = None if folder.path.is_relative_to(temporary) else folder.path
        return SweepResult(parquet.read_table(folder.path / TABLE), folder.plan.count, kept)


def open_sweep(
    folder: FilePath,
    *,
    where: str | None = None,
    sort: str | None = None,
    limit: int | None = None,
    columns: Iterable[str] = (),
) -> SweepResult:
    """Read the rows of a sweep, which may be unfinished or running.

    Args:
        folder: The folder of the sweep.
        where: A condition on the columns, such as ``closest < 0.6 and verdict.safe == "violated"``.
        sort: The column to sort by, in descending order if prefixed with a minus.
        limit: The maximum number of rows.
        columns: The columns; by default all.

    Raises:
        SweepError: There is no sweep, or the condition is invalid.
        LogError: There is no such column, or pyarrow is not installed.
    """
    from symaware_cli.api.sweep_result import SweepResult
    from symaware_cli.studies import read_rows

    table, planned = read_rows(folder, where, sort, limit, columns)
    return SweepResult(table, planned, Path(folder))


def opened(target: Path, output: Path | None, request: SweepRequest) -> SweepFolder:
    """Open the folder of a sweep, or create it.

    Args:
        target: A scenario, the file of a sweep, or the folder of one.
        output: The folder to create or to resume, unless the target is one.
        request: The requested values, changes and entries of the sweep; ignored if the target is a folder.

    Raises:
        ScenarioError: The sweep or the scenario has problems; nothing was created.
        SweepError: The folder has other contents, or pyarrow is not installed.
    """
    from symaware_cli.studies import require_pyarrow

    require_pyarrow()
    from symaware_cli.studies import SweepError, SweepFolder, is_sweep, read_sweep

    if target.is_dir():
        return SweepFolder.opened(target)
    source = read_sweep(target, request)
    if output is None:
        raise SweepError("say where the journal and the table are to be: -o DIR")
    if not is_sweep(output):
        return SweepFolder.created(output, source)
    folder = SweepFolder.opened(output)
    folder.compare(source)
    return folder


def checked(target: Path, request: SweepRequest) -> SweepPlan:
    """Check a sweep and the scenario in every combination, without creating anything.

    Raises:
        ScenarioError: They have problems.
    """
    from symaware_cli.studies import SweepFolder, identity_of, read_sweep

    source = SweepFolder.opened(target).source if target.is_dir() else read_sweep(target, request)
    identity_of(source, {})
    return source.plan


def scenario_of(folder: Path, index: int) -> Scenario:
    """Return the scenario of one run of a sweep, with its parameters and seed.

    Raises:
        SweepError: There is no sweep, or no such run.
    """
    from symaware_cli.api.scenario import Scenario
    from symaware_cli.studies import SweepFolder

    sweep = SweepFolder.opened(folder)
    return Scenario(sweep.source.scenario, sweep.changes(index), seed=sweep.plan.seed(index))


def verify_sweep(
    folder: FilePath,
    level: Level = "sample",
    *,
    rows: int = 20,
    seed: int | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> SweepVerification:
    """Verify the folder of a sweep: its table, its logs, and rows by repetition.

    Args:
        folder: The folder.
        level: The extent, each level including those before it: ``arithmetic`` compares the table with the journal
            and the plan, ``monitor`` evaluates the kept logs, ``sample`` repeats some rows, ``all`` every row.
        rows: The number of rows repeated at the level ``sample``.
        seed: The seed of their random choice; by default one that cannot be predicted.
        on_progress: Called with the number of repeated runs and the total to repeat.

    Raises:
        SweepError: There is no sweep.
        KeyboardInterrupt: A signal ended a run.
    """
    from symaware_cli.studies import require_pyarrow

    require_pyarrow()
    from symaware_cli.evidence import verify_folder
    from symaware_cli.studies import SweepFolder

    chosen = secrets.randbits(32) if seed is None else seed
    return verify_folder(SweepFolder.opened(folder), level, rows, chosen, on_progress)
