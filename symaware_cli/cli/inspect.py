"""``symaware inspect``."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.cli import terminal
from symaware_cli.study.sweep_files import is_sweep

if TYPE_CHECKING:
    from symaware_cli.recording.reader import Log

VIEW, FILTER, ROWS = "What to show instead of the overview", "Which of it", "Of the table of a sweep"

#: What each filter can be combined with.
FILTERS = {
    "--agents": ("--events", "--messages", "--contacts"),
    "--name": ("--events",),
    "--source": ("--events",),
    "--level": ("--events",),
    "--kind": ("--messages",),
    "--stage": ("--messages", "--contacts"),
    "--from": ("--events", "--messages", "--contacts", "--series"),
    "--to": ("--events", "--messages", "--contacts", "--series"),
    "--limit": ("--events", "--messages", "--contacts", "--series"),
    "--where": ("the folder of a sweep",),
    "--sort": ("the folder of a sweep",),
    "--columns": ("the folder of a sweep",),
    "--csv": ("the folder of a sweep",),
    "--shares": ("the folder of a sweep",),
    "--compare": ("the folder of a sweep",),
    "--every": ("--series",),
}


#: The stages that each view knows.
STAGES = {"--messages": ("sent", "delivered", "dropped"), "--contacts": ("begin", "end")}


class MinimumLevel(enum.StrEnum):
    """The severity of an event, in ascending order."""

    debug = "debug"
    info = "info"
    warning = "warning"
    error = "error"


class StageOption(enum.StrEnum):
    """The stages of messages and of contacts."""

    sent = "sent"
    delivered = "delivered"
    dropped = "dropped"
    begin = "begin"
    end = "end"


def inspect(
    path: Annotated[Path, typer.Argument(help="A log, or the folder of a sweep.", metavar="LOG")],
    events: Annotated[
        bool, typer.Option("--events", help="Show events, with tracebacks of failures.", rich_help_panel=VIEW)
    ] = False,
    messages: Annotated[
        bool, typer.Option("--messages", help="Show messages between agents.", rich_help_panel=VIEW)
    ] = False,
    contacts: Annotated[
        bool, typer.Option("--contacts", help="Show contacts between bodies.", rich_help_panel=VIEW)
    ] = False,
    series: Annotated[
        str | None,
        typer.Option(
            help="Show values over time, such as `robot.0:state` or `robot:world:x`. NAME: an agent, "
            "a group, an entity. FIELD: state, world, applied_control, requested_control, intent, uncertainty, "
            "risk, another part of awareness, or a sensor's name.",
            metavar="NAME:FIELD[:COLUMN]",
            rich_help_panel=VIEW,
        ),
    ] = None,
    digest: Annotated[
        bool,
        typer.Option(
            "--digest",
            help="Show the SHA-256 digest of each channel; equal runs have equal digests.",
            rich_help_panel=VIEW,
        ),
    ] = False,
    agents: Annotated[
        str | None,
        typer.Option(
            help="Only entries about these agents, groups or entities, separated by commas; `*` matches anything.",
            rich_help_panel=FILTER,
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the events, such as `failed`.", rich_help_panel=FILTER)
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(help="Source of the events, such as `agents.robot.*.steer`.", rich_help_panel=FILTER),
    ] = None,
    level: Annotated[
        MinimumLevel | None,
        typer.Option(help="Lowest level of the events.", rich_help_panel=FILTER, case_sensitive=False),
    ] = None,
    kind: Annotated[str | None, typer.Option(help="Kind of the messages.", rich_help_panel=FILTER)] = None,
    stage: Annotated[
        StageOption | None,
        typer.Option(help="Stage of the messages or contacts.", rich_help_panel=FILTER, case_sensitive=False),
    ] = None,
    start: Annotated[
        float | None, typer.Option("--from", help="The first simulated time, in seconds.", rich_help_panel=FILTER)
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", help="The last simulated time, in seconds.", rich_help_panel=FILTER)
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(help="Show one line per this many seconds of simulated time.", rich_help_panel=FILTER),
    ] = None,
    limit: Annotated[int | None, typer.Option(min=0, help="Greatest number of lines.", rich_help_panel=FILTER)] = None,
    where: Annotated[
        str | None,
        typer.Option(help="A condition on its columns, such as `closest < 0.6`.", rich_help_panel=ROWS),
    ] = None,
    sort: Annotated[
        str | None,
        typer.Option(help="The column to sort by; with a minus before it, in descending order.", rich_help_panel=ROWS),
    ] = None,
    columns: Annotated[str | None, typer.Option(help="The columns, separated by commas.", rich_help_panel=ROWS)] = None,
    shares: Annotated[
        bool,
        typer.Option(
            "--shares", help="The share of runs that satisfy each specification, with intervals.", rich_help_panel=ROWS
        ),
    ] = False,
    compare: Annotated[
        str | None,
        typer.Option(help="Compare paired variants in this column, run by run.", rich_help_panel=ROWS),
    ] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print CSV.", rich_help_panel=ROWS)] = False,
    as_json: terminal.Json = False,
) -> None:
    """Show what a log contains: agents, times, channels, the scenario, what is missing; or the table of a sweep."""
    views = {
        "--events": events,
        "--messages": messages,
        "--contacts": contacts,
        "--series": series is not None,
        "--digest": digest,
    }
    given = {
        "--agents": agents,
        "--name": name,
        "--source": source,
        "--level": level,
        "--kind": kind,
        "--stage": stage,
        "--from": start,
        "--to": end,
        "--limit": limit,
        "--every": every,
    }
    of_rows = {
        "--where": where,
        "--sort": sort,
        "--columns": columns,
        "--csv": as_csv or None,
        "--shares": shares or None,
        "--compare": compare,
    }
    if is_sweep(path):
        for option, value in {**{view: wanted or None for view, wanted in views.items()}, **given}.items():
            if value is not None and option != "--limit":
                terminal.fail(
                    f"{option} goes with a log, not with the folder of a sweep", terminal.WRONG_INPUT, as_json
                )
        is_selected = any(each is not None for each in (where, sort, columns, limit)) or as_csv
        if (shares or compare is not None) and (is_selected or (shares and compare)):
            terminal.fail("--shares and --compare are about all rows, each by itself", terminal.WRONG_INPUT, as_json)
        with terminal.trouble_shown(as_json):
            from symaware_cli.cli.sweep_rows import show_differences, show_rows, show_shares

            if compare is not None:
                show_differences(path, compare, as_json)
            elif shares:
                show_shares(path, as_json)
            else:
                show_rows(path, where, sort, limit, terminal.names(columns), as_json=as_json, as_csv=as_csv)
        return
    given |= of_rows
    view = _view([view for view, wanted in views.items() if wanted], given, as_json=as_json)
    with terminal.trouble_shown(as_json):
        from symaware_cli.recording.reader import open_log

        log = open_log(path)
        first, last = terminal.span(start, end, as_json)
        if series is not None:
            from symaware_cli.cli.log_views import show_series

            if every is not None and not 0 < every < float("inf"):
                terminal.fail(f"--every takes a time above 0, not {every:g}", terminal.WRONG_INPUT, as_json)
            show_series(log, series, start=first, end=last, every=every, limit=limit, as_json=as_json)
        elif view in ("--events", "--messages", "--contacts"):
            from symaware_cli.cli.log_views import show_entries
            from symaware_cli.recording.entry_filter import EntryFilter

            wanted = EntryFilter(
                agents=tuple(terminal.names(agents)),
                name=name,
                source=source,
                level=level.upper() if level else None,
                kind=kind,
                stage=stage.upper() if stage else None,
                start=first,
                end=last,
            )
            show_entries(log, view, wanted, limit, as_json)
        elif digest:
            _show_digest(log, as_json=as_json)
        else:
            _show_overview(log, as_json=as_json)
        lost = bool(log.damage and log.damage.lost)
    if lost and view:
        typer.echo(f"symaware: {log.damage}", err=True)
    raise typer.Exit(terminal.DATA_LOST if lost else 0)


def _view(chosen: list[str], filters: dict[str, Any], *, as_json: bool) -> str:
    """Return the requested view, after a check that the filters apply to it; None for the overview."""
    if len(chosen) > 1:
        terminal.fail(f"choose one of {' and '.join(chosen)}", terminal.WRONG_INPUT, as_json)
    view = chosen[0] if chosen else ""
    for option, value in filters.items():
        if value is not None and view not in FILTERS[option]:
            terminal.fail(f"{option} goes with {' or '.join(FILTERS[option])}", terminal.WRONG_INPUT, as_json)
    stage = filters["--stage"]
    stages = STAGES.get(view, ())
    if stage is not None and stage not in stages:
        terminal.fail(
            f"--stage {stage} does not go with {view}; there are {', '.join(stages)}", terminal.WRONG_INPUT, as_json
        )
    return view


def _show_digest(log: Log, *, as_json: bool) -> None:
    from dataclasses import asdict

    from symaware_cli.recording.digest import digest

    result = digest(log)
    if as_json:
        terminal.print_json(asdict(result))
        return
    for name, value in [*result.channels.items(), *result.attachments.items(), ("combined", result.combined)]:
        typer.echo(f"{value}  {terminal.printable(name)}")


def _show_overview(log: Log, *, as_json: bool) -> None:
    from symaware_cli.recording.overview import overview

    summary = overview(log)
    if as_json:
        terminal.print_json(summary.to_json())
        return
    from symaware_cli.cli.log_views import overview_text

    typer.echo(overview_text(summary))
