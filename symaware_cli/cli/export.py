"""``symaware export``."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.api import size_in_words
from symaware_cli.api.progress import progress
from symaware_cli.cli import terminal
from symaware_cli.cli.streams import is_lively
from symaware_cli.cli.text_table import aligned
from symaware_cli.help_place import in_help
from symaware_cli.world import counted

if TYPE_CHECKING:
    from symaware_cli.views import Exported


def _completed(incomplete: str) -> list[str]:
    """The names of all formats with this prefix."""
    from symaware_cli.views import EXPORT
    from symaware_cli.world import InstalledPlugins

    known = {listing.name for listing in InstalledPlugins([EXPORT]).listings(EXPORT.name)}
    return sorted(name for name in known if name.startswith(incomplete))


@in_help("look", 70)
def export(
    path: Annotated[Path, typer.Argument(help="A log.", metavar="LOG")],
    form: Annotated[
        str,
        typer.Option(
            "--format",
            help="One that `symaware list exports` shows: csv and parquet are folders of tables, foxglove is an MCAP "
            "file, rosbag2 is a bag of ROS 2, fmu is an FMU; plugins add others.",
            autocompletion=_completed,
            metavar="FORMAT",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="A new or empty folder for tables, or a file, which is replaced. By default named after the log.",
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
    """Export a log as tables (Parquet, CSV), as an MCAP file for Foxglove, or in a format of a plugin."""
    filters = {"--fields": fields, "--agents": agents, "--from": start, "--to": end}
    given = [option for option, value in filters.items() if value is not None]
    # An interruption leaves no partial files.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with terminal.trouble_shown(as_json):
        from symaware_cli.log import open_log
        from symaware_cli.views import Selection, installed_format, select

        chosen = installed_format(form)
        if given and not chosen.selects:
            terminal.fail(f"{given[0]} does not go with {form}, which has all of a log", terminal.WRONG_INPUT, as_json)
        first, last = terminal.span(start, end, as_json)
        log = open_log(path)
        place = output or Path(f"{path.stem}-{form}{chosen.suffix}")
        shown = is_lively(sys.stderr) and not as_json
        selection = Selection()
        if given:
            # Times are whole nanoseconds: the interval after the last one begins with the next.
            stop = None if last is None else last + 1
            selection = select(log, fields=_listed(fields), agents=_listed(agents), start=first, end=stop)
        with progress(path.name, log.start_time or 0, log.end_time or 0, shown) as on_progress:
            exported = chosen.export(log, place, selection, on_progress)
    lost = bool(log.damage and log.damage.lost)
    if as_json:
        damage = str(log.damage) if log.damage else None
        terminal.print_json({"log": str(path), "output": str(place), **exported.facts, "damage": damage})
    else:
        terminal.say(_text(path, place, exported))
        if lost:
            terminal.say(f"symaware: {log.damage}", err=True)
    raise typer.Exit(terminal.DATA_LOST if lost else 0)


def _listed(text: str | None) -> list[str] | None:
    return None if text is None else terminal.names(text)


def _text(path: Path, place: Path, exported: Exported) -> str:
    part, entry = exported.nouns
    count = sum(entries for _, entries, _ in exported.parts)
    sizes = any(size is not None for _, _, size in exported.parts)
    lines = [[part, entry, "size" if sizes else ""]]
    lines += [
        [name, f"{entries:,}", "" if size is None else size_in_words(size)] for name, entries, size in exported.parts
    ]
    total = f"{counted(len(exported.parts), part)}, {count:,} {entry}, {size_in_words(exported.size)}"
    return "\n".join([f"{path}: {total} in {place}", "", *aligned(lines, "<>")])
