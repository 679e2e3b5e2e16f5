"""``symaware log``: the entries of a log, one command for each kind."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.log import Log

log = typer.Typer(help="Show events, messages, contacts, values over time or digests of a log.", no_args_is_help=True)
in_help("look", 20)(log)

LogPath = Annotated[Path, typer.Argument(help="A log.", metavar="LOG")]
Agents = Annotated[
    str | None,
    typer.Option(
        help="Only entries about these agents, groups or entities, separated by commas; `*` matches anything."
    ),
]
Start = Annotated[float | None, typer.Option("--from", help="The first simulated time, in seconds.")]
End = Annotated[float | None, typer.Option("--to", help="The last simulated time, in seconds.")]
Limit = Annotated[int | None, typer.Option(min=0, help="Greatest number of lines.")]


class MinimumLevel(enum.StrEnum):
    """The severity of an event, in ascending order."""

    debug = "debug"
    info = "info"
    warning = "warning"
    error = "error"


class MessageStage(enum.StrEnum):
    """The stages of a message."""

    sent = "sent"
    delivered = "delivered"
    dropped = "dropped"


class ContactStage(enum.StrEnum):
    """The stages of a contact."""

    begin = "begin"
    resume = "resume"
    end = "end"


@log.command()
def events(
    path: LogPath,
    agents: Agents = None,
    name: Annotated[str | None, typer.Option(help="Name of the events, such as `failed`.")] = None,
    source: Annotated[str | None, typer.Option(help="Source of the events, such as `agents.robot.*.steer`.")] = None,
    level: Annotated[
        MinimumLevel | None, typer.Option(help="Lowest level of the events.", case_sensitive=False)
    ] = None,
    start: Start = None,
    end: End = None,
    limit: Limit = None,
    as_json: terminal.Json = False,
) -> None:
    """Show events, with tracebacks of failures."""
    criteria = {"name": name, "source": source, "level": level and level.upper()}
    _show_entries(path, "events", agents, start, end, limit, as_json, **criteria)


@log.command()
def messages(
    path: LogPath,
    agents: Agents = None,
    kind: Annotated[str | None, typer.Option(help="Kind of the messages.")] = None,
    stage: Annotated[MessageStage | None, typer.Option(help="Stage of the messages.", case_sensitive=False)] = None,
    start: Start = None,
    end: End = None,
    limit: Limit = None,
    as_json: terminal.Json = False,
) -> None:
    """Show messages between agents: sent, delivered and dropped."""
    _show_entries(path, "messages", agents, start, end, limit, as_json, kind=kind, stage=stage and stage.upper())


@log.command()
def contacts(
    path: LogPath,
    agents: Agents = None,
    stage: Annotated[ContactStage | None, typer.Option(help="Stage of the contacts.", case_sensitive=False)] = None,
    start: Start = None,
    end: End = None,
    limit: Limit = None,
    as_json: terminal.Json = False,
) -> None:
    """Show contacts between bodies."""
    _show_entries(path, "contacts", agents, start, end, limit, as_json, stage=stage and stage.upper())


@log.command()
def series(
    path: LogPath,
    spec: Annotated[
        str,
        typer.Argument(
            help="A series, such as `robot.0:state` or `robot:world:x`. NAME: an agent, a group, an entity. FIELD: "
            "state, world, applied_control, requested_control, intent, uncertainty, risk, another part of awareness, "
            "or a sensor's name.",
            metavar="NAME:FIELD[:COLUMN]",
        ),
    ],
    start: Start = None,
    end: End = None,
    every: Annotated[float | None, typer.Option(help="Show one line per this many seconds of simulated time.")] = None,
    limit: Limit = None,
    as_json: terminal.Json = False,
) -> None:
    """Show values over time, with the least, mean and greatest of each column."""
    with _opened(path, as_json) as opened:
        from symaware_cli.cli.log_views import show_series

        first, last = terminal.span(start, end, as_json)
        if every is not None and not 0 < every < float("inf"):
            terminal.fail(f"--every takes a time above 0, not {every:g}", terminal.WRONG_INPUT, as_json)
        show_series(opened, spec, start=first, end=last, every=every, limit=limit, as_json=as_json)


@log.command()
def digest(path: LogPath, as_json: terminal.Json = False) -> None:
    """Show the SHA-256 digest of each channel; equal runs have equal digests."""
    with _opened(path, as_json) as opened:
        from dataclasses import asdict

        from symaware_cli.log.digest import digest

        result = digest(opened)
        if as_json:
            terminal.print_json(asdict(result))
        else:
            for name, value in [*result.channels.items(), *result.attachments.items(), ("combined", result.combined)]:
                typer.echo(f"{value}  {terminal.printable(name)}")


def _show_entries(
    path: Path,
    what: str,
    agents: str | None,
    start: float | None,
    end: float | None,
    limit: int | None,
    as_json: bool,
    **criteria: str | None,
) -> None:
    """Show the entries of one kind that meet further criteria of an `EntryFilter`."""
    with _opened(path, as_json) as opened:
        from symaware_cli.cli.log_views import show_entries
        from symaware_cli.log import EntryFilter

        first, last = terminal.span(start, end, as_json)
        wanted = EntryFilter(agents=tuple(terminal.names(agents)), start=first, end=last, **criteria)
        show_entries(opened, what, wanted, limit, as_json)


@contextmanager
def _opened(path: Path, as_json: bool) -> Iterator[Log]:
    """Open a log to show a part of it; exit with the status of lost data if it is damaged."""
    said = f"{path} is a folder, not a log: `symaware rows` shows the table of a sweep"
    terminal.refuse([(path.is_dir(), said)], as_json)
    with terminal.trouble_shown(as_json):
        from symaware_cli.log import open_log

        opened = open_log(path)
        yield opened
        if opened.damage and opened.damage.lost:
            terminal.say(f"symaware: {opened.damage}", err=True)
            raise typer.Exit(terminal.DATA_LOST)
