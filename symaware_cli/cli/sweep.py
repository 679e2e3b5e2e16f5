"""``symaware sweep``, ``resume`` and ``plan``."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.cli import terminal
from symaware_cli.cli.result_files import Results, note
from symaware_cli.cli.streams import is_lively
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import ResultCase
    from symaware_cli.studies import SweepFolder, SweepOutcome, SweepProgress, SweepRequest

#: The width of a terminal in which progress is not shortened, and the most of a name in a narrower one [characters].
_WIDE, _NARROW_NAME = 110, 16

#: How many runs are made together, for the words that `--batch` takes; None for as many as suit.
_BATCHES = {"auto": None, "off": 1}

Target = Annotated[
    Path,
    typer.Argument(help="A scenario or a log of one, or a file of a sweep (`symaware-sweep: 1`).", metavar="SCENARIO"),
]
Runs = Annotated[int | None, typer.Option(min=1, help="Runs of each combination; 1 by default.")]
SweepSeed = Annotated[int | None, typer.Option("--seed", min=0, max=2**63 - 1, help="The seed of the sweep.")]
Entries = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        help="An entry of the plan, as in a file of a sweep; may be repeated: `keep=all`, `until=...`, `claim=...`, "
        "`design=sobol`, `timeout=60`, `variants.NAME={PATH: VALUE}`, `paired=true`.",
        metavar="KEY=VALUE",
    ),
]
On = Annotated[
    str | None,
    typer.Option(
        "--on",
        help="Where to run: ray:HOST:PORT or ray:auto on an existing Ray cluster, or the executor of a plugin. --jobs "
        "is then the number of runs at a time, by default as many as are possible.",
        metavar="EXECUTOR[:ADDRESS]",
    ),
]
Batch = Annotated[
    str,
    typer.Option(
        help="How many runs are made together as one array program, where the scenario allows it: auto, off or a "
        "number. The rows are the same.",
        metavar="auto|off|N",
    ),
]
FailFast = Annotated[bool, typer.Option("--fail-fast", help="End with the first run that fails.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Do not show progress and summary.")]


@in_help("run", 20)
def sweep(
    target: Target,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The folder for journal, table and logs; if it has this sweep, it is resumed.",
            metavar="DIR",
        ),
    ] = None,
    over: terminal.Over = None,
    overrides: terminal.Overrides = None,
    runs: Runs = None,
    seed: SweepSeed = None,
    entries: Entries = None,
    jobs: terminal.Jobs = None,
    on: On = None,
    batch: Batch = "auto",
    fail_fast: FailFast = False,
    quiet: Quiet = False,
    results: Results = None,
    as_json: terminal.Json = False,
) -> None:
    """Run a scenario many times, over parameters, variants and seeds; resumable, with one table at the end."""
    terminal.refuse([(target.is_dir(), f"{target} is a folder: `symaware resume {target}` resumes its sweep")], as_json)
    request = _request(over, overrides, runs, seed, entries)

    def folder() -> SweepFolder:
        from symaware_cli.api import opened

        return opened(target, output, request)

    _conduct(folder, jobs, on, batch, fail_fast=fail_fast, quiet=quiet, as_json=as_json)


@in_help("run", 30)
def resume(
    folder: Annotated[Path, typer.Argument(help="The folder of a sweep.", metavar="DIR")],
    add_runs: Annotated[int | None, typer.Option("--add-runs", min=1, help="Further runs of each combination.")] = None,
    retry_lost: Annotated[
        bool,
        typer.Option("--retry-lost", help="Make runs again that the machine lost or that took too long."),
    ] = False,
    jobs: terminal.Jobs = None,
    on: On = None,
    batch: Batch = "auto",
    fail_fast: FailFast = False,
    quiet: Quiet = False,
    results: Results = None,
    as_json: terminal.Json = False,
) -> None:
    """Resume a sweep: execute its remaining runs, or additional ones."""
    terminal.refuse(
        [(folder.is_file(), f"{folder} is a file: `symaware sweep {folder} -o DIR` begins a sweep")], as_json
    )

    def opened() -> SweepFolder:
        from symaware_cli.studies import SweepFolder

        found = SweepFolder.opened(folder)
        return found if add_runs is None else found.add_runs(add_runs)

    _conduct(opened, jobs, on, batch, retry_lost=retry_lost, fail_fast=fail_fast, quiet=quiet, as_json=as_json)


@in_help("check", 15)
def plan(
    target: Target,
    over: terminal.Over = None,
    overrides: terminal.Overrides = None,
    runs: Runs = None,
    seed: SweepSeed = None,
    entries: Entries = None,
    as_json: terminal.Json = False,
) -> None:
    """Check a sweep and the scenario in all combinations, and show what would be run; nothing is run."""
    request = _request(over, overrides, runs, seed, entries)
    is_given = bool(over or overrides or entries or runs or seed is not None)
    reason = f"{target} says what to run: leave out the options, or give its scenario"
    terminal.refuse([(target.is_dir() and is_given, reason)], as_json)
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        shown = _checked(target, request)
    if as_json:
        terminal.print_json(shown)
    else:
        terminal.say(_plan_text(shown))


def _request(
    over: list[str] | None,
    overrides: list[str] | None,
    runs: int | None,
    seed: int | None,
    entries: list[str] | None,
) -> SweepRequest:
    from symaware_cli.studies import SweepRequest

    numbers = [f"{key}={value}" for key, value in (("runs", runs), ("seed", seed)) if value is not None]
    return SweepRequest(over or (), overrides or (), [*numbers, *(entries or ())])


def _conduct(
    opened: Callable[[], SweepFolder],
    jobs: int | None,
    on: str | None,
    batch: str,
    *,
    retry_lost: bool = False,
    fail_fast: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Execute the remaining runs of a sweep, print the outcome, and exit."""
    reasons = (
        (batch not in _BATCHES and not _is_count(batch), f"--batch takes auto, off or a number, not `{batch}`"),
        (on is not None and jobs == 0, "--jobs 0 makes all runs in this process, --on elsewhere: leave one out"),
    )
    terminal.refuse(reasons, as_json)
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.studies import conduct, execution_at, require_pyarrow

        execution_at(on)  # before a folder is made
        require_pyarrow()
        folder = opened()
        with _shown(folder, not quiet and not as_json) as tell:
            outcome = conduct(
                folder,
                0 if on and jobs is None else terminal.job_count(jobs),
                place=on,
                batch=_BATCHES[batch] if batch in _BATCHES else int(batch),
                retry_lost=retry_lost,
                fail_fast=fail_fast,
                on_progress=tell,
            )
        note(lambda: _cases(folder, outcome))
    if as_json:
        terminal.print_json(outcome.to_json())
    elif not quiet:
        terminal.say(_text(outcome))
    elif outcome.is_interrupted:
        made = f"{outcome.counts.done:,} of {outcome.planned:,} runs"
        terminal.say(f"symaware: {terminal.interruption([folder.path])} with {made}", err=True)
    if outcome.is_interrupted:
        raise typer.Exit(terminal.INTERRUPTED)
    raise typer.Exit(terminal.FAILED if outcome.counts.done < outcome.planned else 0)


def _cases(folder: SweepFolder, outcome: SweepOutcome) -> Iterable[ResultCase]:
    from symaware_cli.evidence import sweep_cases

    return sweep_cases(folder, outcome.rule)


def _is_count(text: str) -> bool:
    return text.isdecimal() and int(text) > 0


def _checked(target: Path, request: SweepRequest) -> dict[str, Any]:
    """Check everything, and return what would be run."""
    from symaware_cli.api import checked

    plan = checked(target, request)
    runs = plan.document.runs
    cells = [
        {"parameters": dict(cell.parameters), **({} if cell.variant is None else {"variant": cell.variant})}
        for cell in plan.cells
    ]
    return {
        "valid": True,
        "runs": runs * len(cells),
        "runs_of_each": runs,
        "combinations": cells,
        "drawn": {path: each.model_dump(exclude_unset=True) for path, each in plan.document.drawn.items()},
        "design": plan.document.design,
    }


def _plan_text(plan: dict[str, Any]) -> str:
    from symaware_cli.world import counted

    cells = plan["combinations"]
    lines = [f"sound; {counted(plan['runs'], 'run')}: {plan['runs_of_each']:,} of each of {len(cells):,}"]
    for cell in cells[:20]:
        values = [f"{path}={value}" for path, value in cell["parameters"].items()]
        lines.append("  " + ", ".join([*([cell["variant"]] if "variant" in cell else []), *values] or ["as it is"]))
    if len(cells) > 20:
        lines.append(f"  and {len(cells) - 20:,} more")
    for path, drawn in plan["drawn"].items():
        lines.append(f"  drawn by each run ({plan['design']}): {path}={json.dumps(drawn)}")
    return "\n".join(lines)


def _text(outcome: SweepOutcome) -> str:
    """Return the report of a sweep."""
    from symaware_cli.studies import TABLE

    counts = outcome.counts
    left = outcome.planned - counts.all
    status = "interrupted" if outcome.is_interrupted else "stopped" if outcome.stopped else "finished"
    lines = [f"{outcome.folder}: {status}; {counts.done:,} of {outcome.planned:,} runs done"]
    if outcome.stopped:
        lines.append(f"  {'stopped':<14} {outcome.stopped}")
    if counts.failed:
        show = f"symaware rows {outcome.folder} --where 'state == \"failed\"'"
        lines.append(f"  {'failed':<14} {counts.failed:,}: {show}")
    if counts.lost:
        lines.append(f"  {'lost':<14} {counts.lost:,}: symaware resume {outcome.folder} --retry-lost")
    if left:
        lines.append(f"  {'left':<14} {left:,}: symaware resume {outcome.folder}")
    rate = f", {outcome.made / outcome.wall_time:,.1f} runs/s" if outcome.made else ""
    if outcome.rule:
        lines.append(f"  {'enough':<14} {outcome.rule}")
    lines.append(f"  {'wall time':<14} {outcome.wall_time:.2f} s{rate}")
    if outcome.one_by_one:
        lines.append(f"  {'one by one':<14} {outcome.one_by_one}")
    lines.append(f"  {'table':<14} {outcome.folder / TABLE}")
    return "\n".join(lines)


@contextmanager
def _shown(folder: SweepFolder, shown: bool) -> Iterator[Callable[[SweepProgress], None] | None]:
    """Show the progress of a sweep on a terminal."""
    if not shown or not is_lively(sys.stderr):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    console = Console(stderr=True)
    # On a narrow terminal, the bar is short, and the end of the line is cut off.
    is_narrow = console.width < _WIDE
    name = folder.path.resolve().name
    name = f"{name[: _NARROW_NAME - 1]}…" if is_narrow and len(name) > _NARROW_NAME else name
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=10 if is_narrow else 30),
        TextColumn("{task.fields[told]}", markup=False),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(name, total=folder.plan.count, told=f"0 of {folder.plan.count:,} runs")

        def tell(progress: SweepProgress) -> None:
            bar.update(task, total=progress.planned, completed=progress.made, told=_told(progress))

        yield tell


def _told(progress: SweepProgress) -> str:
    """Describe the progress of a sweep, the most important figures first."""
    left = math.ceil(progress.time_left) if math.isfinite(progress.time_left) else 0
    parts = [f"{progress.made:,} of {progress.planned:,} runs", f"{progress.rate:,.1f}/s"]
    parts.append(f"{timedelta(seconds=left)} left")
    parts += [f"{count:,} {what}" for count, what in ((progress.failed, "failed"), (progress.lost, "lost")) if count]
    parts += [
        f"{name} {each.lower:.2g} to {each.upper:.2g}" for name, each in progress.estimates().items() if each.count
    ]
    return ", ".join(parts)
