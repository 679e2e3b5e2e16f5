"""``symaware branch``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.cli.text_table import aligned
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import BranchResult, Cell


@in_help("run", 40)
def branch(
    log: Annotated[Path, typer.Argument(help="The log.", metavar="LOG")],
    at: Annotated[
        str, typer.Option(help="When the branch begins: a time in seconds, or an event as in `violated(safe) - 2.0`.")
    ],
    overrides: terminal.Overrides = None,
    over: terminal.Over = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The log of the branch; with --over, the folder for the logs and their table, branches.csv.",
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
    trust: terminal.Trust = False,
    as_json: terminal.Json = False,
) -> None:
    """Repeat a run up to an instant, and continue with something changed; with --over, with each of several values."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import branch as branched
        from symaware_cli.evidence import branch_rows, branches, write_branch_table
        from symaware_cli.language import unused_path
        from symaware_cli.studies import alternatives, varied

        points = [list(each) for each in product(*map(alternatives, varied(over or ())))]
        path = output or unused_path(f"{log.stem}-branch", suffix="" if over else ".mcap")
        with terminal.progress_shown("branches", not (quiet or as_json)) as shown:
            if over:
                results = branches(log, at, [[*(overrides or ()), *each] for each in points], path, None, shown)
            else:
                results = [branched(log, at, overrides, path, shown)]
        rows = branch_rows(results, points)
        table = write_branch_table(rows, path) if over else None
    if as_json:
        terminal.print_json([each.to_json() for each in results] if over else results[0].to_json())
    elif not quiet:
        if table:
            _print_table(log, results, rows, table)
        else:
            _print(log, results[0])
    sys.stdout.flush()
    failed = any(each.summary.status == "failed" for each in results)
    raise typer.Exit(
        terminal.FAILED if failed else terminal.VIOLATED if any(each.summary.falls_short for each in results) else 0
    )


def _print(log: Path, result: BranchResult) -> None:
    _print_head(log, result)
    for change in result.changes:
        terminal.say(f"  {'changed':<12} {terminal.printable(change)}")
    summary = result.summary
    terminal.say(f"  {'status':<12} {summary.status}, {summary.log}")
    for each in summary.specifications:
        robustness = "" if each.robustness is None else f", robustness {each.robustness:.4g}"
        terminal.say(f"  {'':<12} `{each.name}` is {each.verdict}{robustness}")


def _print_table(log: Path, results: Sequence[BranchResult], rows: Sequence[dict[str, Cell]], table: Path) -> None:
    from symaware_cli.evidence import branch_cells

    _print_head(log, results[0])
    shared = sum(each.way == "capture" for each in results)
    if shared:
        terminal.say(f"  {'captured':<12} {shared} of {len(results)} continue from the state of one run to the instant")
    for why in dict.fromkeys(each.reason for each in results if each.reason and len(results) > 1):
        terminal.say(f"  {'repeated':<12} {sum(each.reason == why for each in results)}: {terminal.printable(why)}")
    for line in aligned(branch_cells(rows), ">"):
        terminal.say(terminal.printable(line))
    terminal.say(f"  {'table':<12} {table}")


def _print_head(log: Path, first: BranchResult) -> None:
    terminal.say(f"{log}: {'the same run' if not first.changes else f'another run from {first.at:g} s on'}")
    terminal.say(f"  {'equal':<12} {first.equal:,} messages before")
