"""``symaware sweep``."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from symaware_cli.cli import terminal

if TYPE_CHECKING:
    from symaware_cli.study.folder import SweepFolder
    from symaware_cli.study.request import SweepRequest
    from symaware_cli.study.session import SweepOutcome, SweepProgress

#: The width of a terminal in which progress is not shortened, and the most of a name in a narrower one [characters].
_WIDE, _NARROW_NAME = 110, 16

_PLAN, _MEANS = "What to run", "How to run it"


#: How many runs are made together, for the words that `--batch` takes; None for as many as suit.
_BATCHES = {"auto": None, "off": 1}


class SweepCommand(TyperCommand):
    """Reads ``--variant NAME CHANGES``: an option with two values, which may be repeated."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join the two values of each variant, for the option to take one."""
        joined: list[str] = []
        while args:
            head, *args = args
            joined.append(head)
            if head == "--variant" and len(args) > 1:
                joined.append(f"{args[0]}\0{args[1]}")
                args = args[2:]
        return super().parse_args(ctx, joined)


def sweep(
    target: Annotated[
        Path,
        typer.Argument(
            help="A scenario or a log of one, a file of a sweep (`symaware-sweep: 1`), or a folder whose sweep is "
            "resumed.",
            metavar="SCENARIO",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The folder for journal, table and logs; if it has this sweep, it is resumed.",
            metavar="DIR",
            rich_help_panel=_PLAN,
        ),
    ] = None,
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            help="Vary a value: `agents.robot.count=4,8,16` or `run.duration=1..5 by 0.5`; may be repeated: every "
            "combination is run. Or draw it in each run: `PATH={uniform: [0, 1]}`.",
            metavar="PATH=VALUES",
            rich_help_panel=_PLAN,
        ),
    ] = None,
    design: Annotated[
        str | None,
        typer.Option(
            help="How runs draw from distributions: random, latin-hypercube or sobol.",
            metavar="DESIGN",
            rich_help_panel=_PLAN,
        ),
    ] = None,
    overrides: terminal.Overrides = None,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variant",
            help="A variant with its name and what it changes: `--variant blind 'path=value; path=value'`; may be "
            "repeated.",
            metavar="NAME CHANGES",
            rich_help_panel=_PLAN,
        ),
    ] = None,
    paired: Annotated[
        bool, typer.Option("--paired", help="All variants share the seed of each run.", rich_help_panel=_PLAN)
    ] = False,
    runs: Annotated[
        int | None, typer.Option(min=1, help="Runs of each combination; 1 by default.", rich_help_panel=_PLAN)
    ] = None,
    add_runs: Annotated[
        int | None,
        typer.Option("--add-runs", min=1, help="Further runs of each combination of a folder.", rich_help_panel=_PLAN),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=2**63 - 1, help="The seed of the sweep.", rich_help_panel=_PLAN)
    ] = None,
    keep: Annotated[
        str | None,
        typer.Option(
            help="Which logs are kept: none, failed, worst:N or all. `symaware run DIR --index N` makes any of them "
            "again.",
            rich_help_panel=_PLAN,
        ),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(
            help="End the runs of each combination when enough is known, such as `halfwidth(satisfied.safe) < 0.01`; "
            "--runs says how many at most.",
            metavar="RULE",
            rich_help_panel=_PLAN,
        ),
    ] = None,
    claim: Annotated[
        str | None,
        typer.Option(
            help="What `symaware certify` is to certify: `P(safe) > 0.99 with confidence 0.99, sequential` "
            "ends the runs when it is established, `fixed` looks once after all of them.",
            metavar="CLAIM",
            rich_help_panel=_PLAN,
        ),
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(min=0.001, help="Wall time after which a run is given up, in seconds.", rich_help_panel=_PLAN),
    ] = None,
    jobs: terminal.Jobs = None,
    ray: Annotated[
        str | None,
        typer.Option(
            "--ray",
            help="Run on an existing Ray cluster: HOST:PORT of its head, or `auto`. --jobs is then the "
            "number of tasks at a time, by default one per processor of the cluster.",
            metavar="ADDRESS",
            rich_help_panel=_MEANS,
        ),
    ] = None,
    batch: Annotated[
        str,
        typer.Option(
            help="How many runs are made together as one array program, where the scenario allows it: auto, off or a "
            "number. The rows are the same.",
            metavar="auto|off|N",
            rich_help_panel=_MEANS,
        ),
    ] = "auto",
    retry: Annotated[
        str | None,
        typer.Option(
            help="`lost`: make runs again that the machine lost or that took too long.", rich_help_panel=_MEANS
        ),
    ] = None,
    fail_fast: Annotated[
        bool, typer.Option("--fail-fast", help="End with the first run that fails.", rich_help_panel=_MEANS)
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check everything and show the plan; run nothing.", rich_help_panel=_MEANS)
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Do not show progress and summary.")] = False,
    as_json: terminal.Json = False,
) -> None:
    """Run a scenario many times, over parameters, variants and seeds; resumable, with one table at the end."""
    options: dict[str, Any] = {"runs": runs, "seed": seed, "keep": keep, "timeout": timeout}
    texts = {"design": design, "until": until, "claim": claim}
    options |= {key: json.dumps(text, ensure_ascii=False) for key, text in texts.items() if text is not None}
    options["paired"] = "true" if paired else None
    given = {key: str(value) for key, value in options.items() if value is not None}
    is_given = any((over, overrides, variants, given, output))
    reasons = (
        (retry not in (None, "lost"), f"--retry takes `lost`, not `{retry}`"),
        (batch not in _BATCHES and not _is_count(batch), f"--batch takes auto, off or a number, not `{batch}`"),
        (ray is not None and jobs == 0, "--jobs 0 makes all runs in this process, --ray on a cluster: leave one out"),
        (target.is_dir() and is_given, f"{target} says what to run: only --add-runs adds to it"),
        (add_runs is not None and not target.is_dir(), "--add-runs goes with the folder of a sweep"),
    )
    terminal.refuse(reasons, as_json)
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.api.sweeps import opened
        from symaware_cli.study.request import SweepRequest
        from symaware_cli.study.session import conduct

        pairs = [each.partition("\0") for each in variants or ()]
        request = SweepRequest(over or (), overrides or (), [(name, text) for name, _, text in pairs], given)
        if dry_run:
            shown = _dry(target, request, add_runs)
        else:
            folder = opened(target, output, request)
            if add_runs is not None:
                folder = folder.add_runs(add_runs)
            with _shown(folder, not quiet and not as_json) as tell:
                outcome = conduct(
                    folder,
                    0 if ray and jobs is None else terminal.job_count(jobs),
                    ray=ray,
                    batch=_BATCHES[batch] if batch in _BATCHES else int(batch),
                    retry_lost=retry is not None,
                    fail_fast=fail_fast,
                    on_progress=tell,
                )
            shown = outcome.to_json()
    if as_json:
        terminal.print_json(shown)
    elif dry_run:
        typer.echo(_plan_text(shown))
    elif not quiet:
        typer.echo(_text(outcome))
    if dry_run:
        return
    if outcome.is_interrupted:
        raise typer.Exit(terminal.INTERRUPTED)
    raise typer.Exit(terminal.FAILED if outcome.counts.done < outcome.planned else 0)


def _is_count(text: str) -> bool:
    return text.isdecimal() and int(text) > 0


def _dry(target: Path, request: SweepRequest, add_runs: int | None) -> dict[str, Any]:
    """Check everything, and return what would be run."""
    from symaware_cli.api.sweeps import checked

    plan = checked(target, request)
    runs = plan.document.runs + (add_runs or 0)
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
    from symaware_cli.api.report import number

    cells = plan["combinations"]
    lines = [f"sound; {number(plan['runs'], 'run')}: {plan['runs_of_each']:,} of each of {len(cells):,}"]
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
    from symaware_cli.study.sweep_files import TABLE

    counts = outcome.counts
    left = outcome.planned - counts.all
    status = "interrupted" if outcome.is_interrupted else "stopped" if outcome.stopped else "finished"
    lines = [f"{outcome.folder}: {status}; {counts.done:,} of {outcome.planned:,} runs done"]
    if outcome.stopped:
        lines.append(f"  {'stopped':<14} {outcome.stopped}")
    if counts.failed:
        show = f"symaware inspect {outcome.folder} --where 'state == \"failed\"'"
        lines.append(f"  {'failed':<14} {counts.failed:,}: {show}")
    if counts.lost:
        lines.append(f"  {'lost':<14} {counts.lost:,}: symaware sweep {outcome.folder} --retry lost")
    if left:
        lines.append(f"  {'left':<14} {left:,}: symaware sweep {outcome.folder}")
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
    """Show how far a sweep is, on a terminal."""
    if not shown or not terminal.is_lively(sys.stderr):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    console = Console(stderr=True)
    # Where there is little room, the bar is short, and what is cut off is what comes last.
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
    """Say how far a sweep is, the most important first."""
    left = math.ceil(progress.time_left) if math.isfinite(progress.time_left) else 0
    parts = [f"{progress.made:,} of {progress.planned:,} runs", f"{progress.rate:,.1f}/s"]
    parts.append(f"{timedelta(seconds=left)} left")
    parts += [f"{count:,} {what}" for count, what in ((progress.failed, "failed"), (progress.lost, "lost")) if count]
    parts += [
        f"{name} {each.lower:.2g} to {each.upper:.2g}" for name, each in progress.estimates().items() if each.count
    ]
    return ", ".join(parts)
