"""Sweeps from Python: many runs of a scenario, and their table."""

from __future__ import annotations

import json
import os
import secrets
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.api.changes import Changes, texts

if TYPE_CHECKING:
    import pyarrow

    from symaware_cli.api.scenario import Scenario
    from symaware_cli.api.sweep_verification import Level, SweepVerification
    from symaware_cli.study.findings import VariantDifference, VerdictShare
    from symaware_cli.study.folder import SweepFolder
    from symaware_cli.study.request import SweepRequest
    from symaware_cli.study.sweep_plan import SweepPlan

FilePath = str | os.PathLike[str]


def sweep(
    scenario: FilePath,
    output: FilePath | None = None,
    *,
    over: Mapping[str, Iterable[Any] | Mapping[str, Any] | str] | None = None,
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
    ray: str | None = None,
    batch: int | None = None,
    fail_fast: bool = False,
) -> pyarrow.Table:
    """Make many runs of a scenario, and return their table.

    Args:
        scenario: A scenario or a log of one, or the file of a sweep, or the folder of one that is to be resumed.
        output: The folder for its journal and table; if it has the same sweep, that is resumed. By default nothing is
            kept.
        over: Values of the scenario that vary, by their paths: lists, ranges such as ``"0..1 by 0.1"``, or
            distributions such as ``{"uniform": [0, 1]}``, from which each run draws.
        design: How they draw: ``random``, ``latin-hypercube`` or ``sobol``.
        changes: Values of the scenario that all runs share, by their paths.
        variants: Variants of the scenario by name, each with its values by their paths.
        runs: Runs of each combination.
        seed: The seed of the sweep.
        paired: Whether all variants share the seed of each run.
        until: A rule that ends the runs of each combination early, such as ``"halfwidth(satisfied.safe) < 0.01"``.
        claim: What is to be certified, such as ``"P(safe) > 0.99 with confidence 0.99, sequential"``.
        keep: Which logs are kept: ``none``, ``failed``, ``worst:N`` or ``all``.
        timeout: Wall time after which a run is given up [s].
        jobs: How many worker processes; 0 to make all runs in this process.
        ray: The address of a Ray cluster that makes the runs instead, such as ``"10.0.0.1:6379"`` or ``"auto"``; `jobs`
            is then how many tasks there are at a time, 0 for as many as it has processors.
        batch: How many runs are made together at most, where that is possible; 1 for none. The rows are the same.
        fail_fast: Whether to end with the first run that fails.

    Returns:
        One row a run in order of its index; docs/sweeps.md describes the columns.

    Raises:
        ScenarioError: The sweep or the scenario has problems; nothing was run.
        SweepError: The folder has something else, or there is no such cluster, or it has other code.
        KeyboardInterrupt: Ctrl-C ended it; the rows are in the folder.
    """
    from pyarrow import parquet

    from symaware_cli.study.request import SweepRequest
    from symaware_cli.study.session import conduct
    from symaware_cli.study.sweep_files import TABLE

    options: dict[str, Any] = {
        "runs": runs,
        "seed": seed,
        "paired": "true" if paired else None,
        "keep": keep,
        "timeout": timeout,
    }
    options["design"] = None if design is None else json.dumps(design, ensure_ascii=False)
    options["until"] = None if until is None else json.dumps(until, ensure_ascii=False)
    options["claim"] = None if claim is None else json.dumps(claim, ensure_ascii=False)
    request = SweepRequest(
        over=[text for path, values in (over or {}).items() for text in varied(path, values)],
        set=texts(changes),
        variants=[(name, "; ".join(texts(each))) for name, each in (variants or {}).items()],
        options={key: str(value) for key, value in options.items() if value is not None},
    )
    with tempfile.TemporaryDirectory() as temporary:
        folder = opened(Path(scenario), Path(temporary, "sweep") if output is None else Path(output), request)
        outcome = conduct(folder, jobs, ray=ray, batch=batch, fail_fast=fail_fast)
        if outcome.is_interrupted:
            raise KeyboardInterrupt
        return parquet.read_table(folder.path / TABLE)


def opened(target: Path, output: Path | None, request: SweepRequest) -> SweepFolder:
    """Return the folder of a sweep, made if there is none.

    Args:
        target: A scenario, the file of a sweep, or the folder of one.
        output: Where the folder is to be, unless the target is one.
        request: What is asked for.

    Raises:
        ScenarioError: The sweep or the scenario has problems; nothing was created.
        SweepError: The folder has something else, or pyarrow is not installed.
    """
    require_pyarrow()
    from symaware_cli.study.folder import SweepFolder
    from symaware_cli.study.sweep_error import SweepError
    from symaware_cli.study.sweep_files import is_sweep
    from symaware_cli.study.sweep_source import read_sweep

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
    from symaware_cli.study.folder import SweepFolder, identity_of
    from symaware_cli.study.sweep_source import read_sweep

    source = SweepFolder.opened(target).source if target.is_dir() else read_sweep(target, request)
    identity_of(source, {})
    return source.plan


def require_pyarrow() -> None:
    """Make sure that tables can be written.

    Raises:
        LogError: They cannot.
    """
    from importlib.util import find_spec

    from symaware_cli.recording.error import LogError

    if find_spec("pyarrow") is None:
        raise LogError("a sweep needs the module `pyarrow`, which is not installed: pip install 'symaware-cli[sweep]'")


def varied(path: str, values: Iterable[Any] | Mapping[str, Any] | str) -> Sequence[str]:
    """Return what varies as ``--over`` takes it."""
    if isinstance(values, str):
        return (f"{path}={values}",)
    if isinstance(values, Mapping):
        return texts({path: values})
    return tuple(f"{path}={text.partition('=')[2][1:-1]}" for text in texts({path: list(values)}))


def read_rows(
    folder: Path,
    where: str | None = None,
    sort: str | None = None,
    limit: int | None = None,
    columns: Iterable[str] = (),
) -> tuple[pyarrow.Table, int]:
    """Read rows of a sweep, also of one that is not finished or is running.

    Args:
        folder: The folder of the sweep.
        where: See `symaware_cli.study.sweep_query.query`, as for the next two.
        sort: See there.
        limit: See there.
        columns: The columns; by default all.

    Returns:
        The rows, and how many runs are planned.

    Raises:
        SweepError: There is no sweep, or the condition is not valid.
        UnknownNameError: There is no such column.
    """
    require_pyarrow()
    from symaware_cli.study import table_file
    from symaware_cli.study.sweep_query import column, query

    found = table_file.read(Path(folder))
    if found is None:
        from symaware_cli.study.folder import SweepFolder
        from symaware_cli.study.session import rows_so_far

        sweep = SweepFolder.opened(folder)
        found = rows_so_far(sweep), sweep.plan.count
    table, planned = found
    table = query(table, where, sort, limit)
    names = [column(table, name) for name in columns]
    return (table.select(names) if names else table), planned


def scenario_of(folder: Path, index: int) -> Scenario:
    """Return the scenario of one run of a sweep, with its parameters and seed.

    Raises:
        SweepError: There is no sweep, or no such run.
    """
    from symaware_cli.api.scenario import Scenario
    from symaware_cli.study.folder import SweepFolder
    from symaware_cli.study.sweep_error import SweepError
    from symaware_cli.study.sweep_source import texts_of

    sweep = SweepFolder.opened(folder)
    if not 0 <= index < sweep.plan.count:
        raise SweepError(f"{folder} has no run {index}: they are numbered from 0 to {sweep.plan.count - 1}")
    changes = texts_of(sweep.plan.changes(index))
    return Scenario(sweep.source.scenario, changes, seed=sweep.plan.seed(index))


def read_shares(folder: Path) -> Sequence[VerdictShare]:
    """Return the share of the runs that satisfy each specification, for each combination and variant.

    Raises:
        SweepError: There is no sweep.
    """
    require_pyarrow()
    from symaware_cli.study.findings import shares
    from symaware_cli.study.folder import SweepFolder
    from symaware_cli.study.session import rows_so_far

    sweep = SweepFolder.opened(folder)
    return list(shares(rows_so_far(sweep), sweep.plan))


def read_differences(folder: Path, name: str) -> Sequence[VariantDifference]:
    """Return what paired variants differ by from the first one in a column, run by run.

    Raises:
        SweepError: There is no sweep, or its variants cannot be compared.
        UnknownNameError: There is no such column.
    """
    require_pyarrow()
    from symaware_cli.study.findings import differences
    from symaware_cli.study.folder import SweepFolder
    from symaware_cli.study.session import rows_so_far

    sweep = SweepFolder.opened(folder)
    return list(differences(rows_so_far(sweep), sweep.plan, name))


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
        level: How much, each level with those before it: ``arithmetic`` is what the table says of itself, ``monitor``
            the logs that were kept, ``sample`` some rows that are made again, ``all`` all of them.
        rows: How many rows the level ``sample`` makes again.
        seed: The seed by which these are chosen; by default one that cannot be predicted.
        on_progress: Called with how many runs were made again, and of how many.

    Raises:
        SweepError: There is no sweep.
        KeyboardInterrupt: A signal ended a run.
    """
    require_pyarrow()
    from symaware_cli.api.sweep_verification import verify_folder
    from symaware_cli.study.folder import SweepFolder

    chosen = secrets.randbits(32) if seed is None else seed
    return verify_folder(SweepFolder.opened(folder), level, rows, chosen, on_progress)
