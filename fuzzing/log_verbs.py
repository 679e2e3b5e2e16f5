"""All commands that read a log; each is run with every bad log. A new command needs an entry here."""

import io
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from typer.main import get_command

from symaware_cli.cli.application import application

VERBS: dict[str, Callable[[Path, Path], list[object]]] = {
    "inspect": lambda log, folder: ["inspect", log],
    "inspect --json": lambda log, folder: ["inspect", log, "--json"],
    "log events": lambda log, folder: ["log", "events", log],
    "log messages": lambda log, folder: ["log", "messages", log, "--json"],
    "log contacts": lambda log, folder: ["log", "contacts", log],
    "log series": lambda log, folder: ["log", "series", log, "robot:world:x"],
    "log digest": lambda log, folder: ["log", "digest", log],
    "recover": lambda log, folder: ["recover", log, "--output", folder / "recovered.mcap"],
    "merge": lambda log, folder: ["merge", log, "--output", folder / "merged.mcap"],
    "replay": lambda log, folder: ["replay", log, "--save", folder / "replay.rrd"],
    "plot": lambda log, folder: ["plot", log, "--output", folder / "plot.png", "--dpi", 20],
    "export csv": lambda log, folder: ["export", log, "--format", "csv", "--output", folder / "tables"],
    "export parquet": lambda log, folder: ["export", log, "--format", "parquet", "--output", folder / "tables"],
    "export foxglove": lambda log, folder: [
        "export",
        log,
        "--format",
        "foxglove",
        "--output",
        folder / "foxglove.mcap",
    ],
}
"""The arguments of each command, given the log and an empty folder for output."""

QUICK = ("inspect", "recover", "merge")
"""Commands that take milliseconds."""

DRAWING = ("replay", "plot")
"""Commands that take a second."""

_COMMAND = get_command(application)


def called(arguments: Sequence[object]) -> tuple[int, str, str]:
    """Run the command in this process."""
    output, trouble = io.StringIO(), io.StringIO()
    with redirect_stdout(output), redirect_stderr(trouble):
        try:
            _COMMAND.main([str(each) for each in arguments])
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
    return status, output.getvalue(), trouble.getvalue()
