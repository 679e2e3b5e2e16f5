"""``symaware inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.cli import terminal
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.studies.sweep_overview import SweepOverview


@in_help("look", 10)
def inspect(
    path: Annotated[Path, typer.Argument(help="A log, or the folder of a sweep.", metavar="PATH")],
    as_json: terminal.Json = False,
) -> None:
    """Show the contents of a log (agents, times, channels, scenario, missing parts), or the progress of a sweep."""
    with terminal.trouble_shown(as_json):
        if terminal.is_sweep(path):
            from symaware_cli.studies.sweep_overview import sweep_overview

            of_sweep = sweep_overview(path)
            if as_json:
                terminal.print_json(of_sweep.to_json())
            else:
                terminal.say("\n".join(_lines(of_sweep)))
            return
        from symaware_cli.log import open_log, overview_of

        log = open_log(path)
        summary = overview_of(log)
        if as_json:
            terminal.print_json(summary.to_json())
        else:
            from symaware_cli.cli.log_views import overview_text

            terminal.say(overview_text(summary))
        if log.damage and log.damage.lost:
            raise typer.Exit(terminal.DATA_LOST)


def _lines(found: SweepOverview) -> list[str]:
    """Lay out the overview of a sweep."""
    made = sum(found.counts.values())
    states = ", ".join(f"{count:,} {state}" for state, count in found.counts.items() if count) or "none"
    entries: list[tuple[str, Any]] = [
        ("scenario", found.scenario),
        ("runs", f"{made:,} of {found.planned:,}: {states}"),
        ("combinations", f"{found.combinations:,}"),
    ]
    entries += [("varies", text) for text in found.varies]
    if found.variants:
        entries.append(("variants", ", ".join(found.variants)))
    if found.claim:
        entries.append(("claim", found.claim))
    entries.append(("columns", ", ".join(found.columns)))
    hints = [f"symaware rows {found.folder}", f"symaware shares {found.folder}"]
    if made < found.planned:
        hints.append(f"symaware resume {found.folder}")
    lines = [f"{found.folder}: sweep of {found.planned:,} runs, seed {found.seed}"]
    lines += [f"  {label:<12} {terminal.printable(str(text))}" for label, text in entries]
    return [*lines, f"  {'further':<12} {'; '.join(hints)}"]
