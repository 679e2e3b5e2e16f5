"""``symaware recover``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.api import size_in_words
from symaware_cli.cli.terminal import DATA_LOST, Json, print_json, say, trouble_shown
from symaware_cli.help_place import in_help
from symaware_cli.world import counted

if TYPE_CHECKING:
    from symaware_cli.log import Log, Recovery


@in_help("look", 80)
def recover(
    path: Annotated[Path, typer.Argument(help="A damaged or incomplete log.", metavar="LOG")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The new log; replaced if it exists. By default LOG.recovered.mcap beside it, unless LOG is sound.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Repair a damaged log: write everything readable to a new log, and report the losses."""
    with trouble_shown(as_json):
        from symaware_cli.log import open_log
        from symaware_cli.log import recover as write

        log = open_log(path)
        if log.verify() and output is None:
            from symaware_cli.language import unused_path

            output = unused_path(f"{path.stem}.recovered", path.parent)
        recovery = None if output is None else write(log, output)
    damage = log.damage
    if as_json:
        print_json(_plain(log, recovery))
    else:
        say(_text(log, recovery))
    raise typer.Exit(DATA_LOST if damage and damage.lost else 0)


def _plain(log: Log, recovery: Recovery | None) -> dict[str, Any]:
    """Return the damage of a log and its recovery as plain data for JSON; times in seconds."""
    damage = log.damage
    content: dict[str, Any] = {"log": str(log.path), "lost": bool(damage and damage.lost), "damage": None}
    if damage:
        content["damage"] = {
            "text": str(damage),
            "end_missing": damage.end_missing,
            "summary_missing": damage.summary_missing,
            "chunks": damage.chunks_skipped,
            "attachments": damage.attachments_skipped,
            "bytes": damage.bytes_skipped + damage.unread_bytes,
            "gaps": [[_seconds(time) for time in gap] for gap in damage.gaps],
            "missing_from": _seconds(damage.missing_from),
        }
    content["recovered"] = recovery and {
        "log": str(recovery.path),
        "size": recovery.size,
        "messages": recovery.messages,
        "chunks": recovery.chunks,
        "attachments": recovery.attachments,
        "start": _seconds(recovery.start_time),
        "end": _seconds(recovery.end_time),
    }
    return content


def _text(log: Log, recovery: Recovery | None) -> str:
    if recovery is None:
        return f"{log.path} is sound: there is nothing to recover"
    start, end = _seconds(recovery.start_time), _seconds(recovery.end_time)
    span = f", {start:.9g} to {end:.9g} s" if start is not None else ""
    lines = [
        f"{recovery.path}: {size_in_words(recovery.size)}",
        f"  kept  {counted(recovery.messages, 'message')}{span}; {counted(recovery.attachments, 'attachment')}",
    ]
    damage = log.damage
    if damage and damage.lost:
        lines.append(f"  lost  {damage}")
    else:
        lines.append(f"  lost  nothing{f': {damage}' if damage else ''}")
    return "\n".join(lines)


def _seconds(time: int | None) -> float | None:
    return None if time is None else time / 1e9
