"""``symaware merge``."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.api import size_in_words
from symaware_cli.api.progress import progress
from symaware_cli.cli.streams import is_lively
from symaware_cli.cli.terminal import DATA_LOST, Json, print_json, say, trouble_shown
from symaware_cli.cli.text_table import aligned
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.processes import Merged, ProcessLog


@in_help("run", 50)
def merge(
    paths: Annotated[
        list[Path], typer.Argument(help="The logs of the host and of the members, in any order.", metavar="LOG")
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="The log of the whole run; replaced if it exists."),
    ],
    as_json: Json = False,
) -> None:
    """Merge the logs of the processes of one run into one log."""
    # An interruption leaves no partial file.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with trouble_shown(as_json):
        from symaware_cli.processes import merge as write
        from symaware_cli.processes import missing_in_words, open_process_logs

        parts = open_process_logs(paths)
        start = min((part.log.start_time or 0 for part in parts), default=0)
        end = max((part.log.end_time or 0 for part in parts), default=0)
        shown = is_lively(sys.stderr) and not as_json
        with progress(output.name, start, end, shown) as on_progress:
            merged = write(parts, output, on_progress)
    lost = [part for part in parts if part.log.damage and part.log.damage.lost]
    if as_json:
        print_json(_plain(parts, merged, lost))
    else:
        say(_text(parts, merged))
        for part in lost:
            say(f"symaware: {part.log.path}: {part.log.damage}", err=True)
        if merged.missing:
            say(f"symaware: {missing_in_words(merged.missing)}", err=True)
    raise typer.Exit(DATA_LOST if lost or merged.missing else 0)


def _plain(parts: Sequence[ProcessLog], merged: Merged, lost: Sequence[ProcessLog]) -> dict[str, Any]:
    """Return the result as plain data for JSON; times in seconds."""
    return {
        "log": str(merged.path),
        "size": merged.size,
        "messages": merged.messages,
        "repeated": merged.repeated,
        "start": _seconds(merged.start_time),
        "end": _seconds(merged.end_time),
        "lost": bool(lost or merged.missing),
        "missing": list(merged.missing),
        "parts": [
            {
                "log": str(part.log.path),
                "name": part.name,
                "host": part.host,
                "agents": list(part.agents),
                "start": _seconds(part.start),
                "end": _seconds(part.log.end_time),
                "damage": str(part.log.damage) if part.log.damage else None,
            }
            for part in parts
        ],
    }


def _text(parts: Sequence[ProcessLog], merged: Merged) -> str:
    once = f"; {merged.repeated:,} that stand in several parts are written once" if merged.repeated else ""
    names = ["(whole)" if part.whole else part.name for part in parts]
    lines = [["part", "agents", "from [s]", "until [s]", "log"]]
    for name, part in zip(names, parts, strict=True):
        instants = (_number(time) for time in (part.start, part.log.end_time))
        lines.append([name, f"{len(part.agents):,}", *instants, str(part.log.path)])
    title = f"{merged.path}: {merged.messages:,} messages, {size_in_words(merged.size)}{once}"
    return "\n".join([title, "", *aligned(lines, "<>>><")])


def _seconds(time: int | None) -> float | None:
    return None if time is None else time / 1e9


def _number(time: int | None) -> str:
    return "-" if time is None else f"{time / 1e9:.9g}"
