"""``symaware export``."""

from __future__ import annotations

import enum
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.api.progress import progress
from symaware_cli.api.report import size_in_words
from symaware_cli.cli import terminal

if TYPE_CHECKING:
    from symaware_cli.recording.reader import Log

Progress = Callable[[int], None] | None


class Target(enum.StrEnum):
    """The formats that a log can be exported to."""

    parquet = "parquet"
    csv = "csv"
    foxglove = "foxglove"


def export(
    path: Annotated[Path, typer.Argument(help="A log.", metavar="LOG")],
    form: Annotated[Target, typer.Option("--format", help="A folder of tables, or an MCAP file for Foxglove.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="A new or empty folder for tables, a file for Foxglove. By default named after the log.",
        ),
    ] = None,
    fields: Annotated[
        str | None, typer.Option("--fields", help="Only these tables, separated by commas, such as `state,risk`.")
    ] = None,
    agents: Annotated[
        str | None, typer.Option("--agents", help="Only these agents, groups and entities, separated by commas.")
    ] = None,
    start: Annotated[float | None, typer.Option("--from", help="First simulated time, in seconds.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last simulated time, in seconds.")] = None,
    as_json: terminal.Json = False,
) -> None:
    """Export a log as tables (Parquet, CSV), or as an MCAP file for Foxglove."""
    filters = {"--fields": fields, "--agents": agents, "--from": start, "--to": end}
    given = [option for option, value in filters.items() if value is not None]
    if form is Target.foxglove and given:
        terminal.fail(
            f"{given[0]} goes with tables only; Foxglove is given all of the log", terminal.WRONG_INPUT, as_json
        )
    # An interruption leaves no partial files.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with terminal.trouble_shown(as_json):
        from symaware_cli.recording.reader import open_log

        log = open_log(path)
        place = output or Path(f"{path.stem}-{form}{'.mcap' if form is Target.foxglove else ''}")
        shown = terminal.is_lively(sys.stderr) and not as_json
        with progress(path.name, log.start_time or 0, log.end_time or 0, shown) as on_progress:
            if form is Target.foxglove:
                report = _foxglove(log, place, on_progress)
            else:
                window = terminal.span(start, end, as_json)
                report = _tables(log, place, form, _listed(fields), _listed(agents), window, on_progress)
    lost = bool(log.damage and log.damage.lost)
    if as_json:
        terminal.print_json(
            {"log": str(path), "output": str(place), **report, "damage": str(log.damage) if log.damage else None}
        )
    else:
        typer.echo(_text(path, place, report))
        if lost:
            typer.echo(f"symaware: {log.damage}", err=True)
    raise typer.Exit(terminal.DATA_LOST if lost else 0)


def _tables(
    log: Log,
    folder: Path,
    form: Target,
    fields: Sequence[str] | None,
    agents: Sequence[str] | None,
    window: tuple[int | None, int | None],
    on_progress: Progress,
) -> dict[str, Any]:
    from dataclasses import asdict

    from symaware_cli.exporting.conversion import export_tables
    from symaware_cli.exporting.log_selection import select
    from symaware_cli.exporting.parquet import PARQUET
    from symaware_cli.exporting.text import CSV

    start, last = window
    # Times are whole nanoseconds: the interval after the last one begins with the next.
    end = None if last is None else last + 1
    selection = select(log, fields=fields, agents=agents, start=start, end=end)
    written = export_tables(log, folder, CSV if form is Target.csv else PARQUET, selection, on_progress)
    return {"tables": [asdict(each) for each in written]}


def _foxglove(log: Log, place: Path, on_progress: Progress) -> dict[str, Any]:
    from symaware_cli.viewing.foxglove import export_foxglove

    topics = export_foxglove(log, place, on_progress)
    return {"topics": dict(sorted(topics.items())), "size": place.stat().st_size}


def _listed(text: str | None) -> list[str] | None:
    return None if text is None else terminal.names(text)


def _text(path: Path, place: Path, report: dict[str, Any]) -> str:
    if "topics" in report:
        count = sum(report["topics"].values())
        width = max([32, *map(len, report["topics"])])
        topics = [f"  {topic:<{width}} {messages:>9,}" for topic, messages in report["topics"].items()]
        head = f"{path}: {count:,} messages, {size_in_words(report['size'])} in {place}"
        return "\n".join([head, "", f"  {'topic':<{width}} {'messages':>9}", *topics])
    tables = report["tables"]
    rows, size = (sum(table[key] for table in tables) for key in ("rows", "size"))
    width = max(len(table["file"]) for table in tables)
    lines = [f"  {table['file']:<{width}} {table['rows']:>10,} {size_in_words(table['size']):>9}" for table in tables]
    head = f"{path}: {len(tables)} tables, {rows:,} rows, {size_in_words(size)} in {place}"
    return "\n".join([head, "", f"  {'table':<{width}} {'rows':>10} {'size':>9}", *lines])
