"""``symaware inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli.terminal import DATA_LOST, Json, print_json, size_in_words, trouble_shown

if TYPE_CHECKING:
    from symaware_cli.recording.journal import LoggedEvent
    from symaware_cli.recording.overview import Overview
    from symaware_cli.recording.reader import Log


def inspect(
    path: Annotated[Path, typer.Argument(help="A log.", metavar="LOG")],
    events: Annotated[
        bool, typer.Option("--events", help="List the events instead, with tracebacks of failures.")
    ] = False,
    digest: Annotated[
        bool, typer.Option("--digest", help="Print the SHA-256 of each channel instead; equal runs have equal ones.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Tell what is in a log: who, how long, how often, which scenario, and what is missing."""
    with trouble_shown(as_json):
        from symaware_cli.recording.reader import open_log

        log = open_log(path)
        if events:
            _show_events(log, as_json)
        elif digest:
            _show_digest(log, as_json)
        else:
            _show_overview(log, as_json)
        lost = bool(log.damage and log.damage.lost)
    if lost and (events or digest):
        typer.echo(f"symaware: {log.damage}", err=True)
    raise typer.Exit(DATA_LOST if lost else 0)


def _show_events(log: Log, as_json: bool) -> None:
    from dataclasses import asdict

    if as_json:
        print_json([asdict(event) for event in log.events()])
        return
    for event in log.events():
        typer.echo(_event(event))


def _event(event: LoggedEvent) -> str:
    line = f"{event.time / 1e9:10.4f} s  {event.level:<7}  {event.name:<14}  {event.source}  {event.text}".rstrip()
    trace = str(event.data.get("traceback", "")).rstrip()
    return f"{line}\n{trace}" if trace else line


def _show_digest(log: Log, as_json: bool) -> None:
    from dataclasses import asdict

    from symaware_cli.recording.digest import digest

    result = digest(log)
    if as_json:
        print_json(asdict(result))
        return
    for name, value in [*result.channels.items(), *result.attachments.items(), ("combined", result.combined)]:
        typer.echo(f"{value}  {name}")


def _show_overview(log: Log, as_json: bool) -> None:
    from symaware_cli.recording.overview import overview

    summary = overview(log)
    if as_json:
        print_json(summary.to_json())
        return
    typer.echo(_text(summary))


def _text(summary: Overview) -> str:
    lines = [f"{summary.path}: {size_in_words(summary.size)}, {summary.status}"]
    if summary.foreign:
        lines.append(_line("origin", "not written by SymAware; only its channels can be shown"))
    else:
        lines.append(_line("scenario", f"{summary.name}, seed {summary.seed}, {summary.mode}"))
        groups = ", ".join(f"{name} ({count})" for name, count in summary.agents.items())
        lines.append(_line("agents", groups))
        if summary.entities:
            lines.append(_line("entities", ", ".join(summary.entities)))
    if summary.simulated_time is not None:
        steps = f", {summary.steps:,} steps" if summary.steps is not None else ""
        step = f" of {summary.time_step:g} s" if steps and summary.time_step else ""
        wall = f"; {summary.wall_time:.2f} s of wall time" if summary.wall_time is not None else ""
        lines.append(_line("time", f"0 to {summary.simulated_time:.9g} s{steps}{step}{wall}"))
    if summary.events:
        lines.append(_line("events", ", ".join(f"{name} {count}" for name, count in summary.events.items())))
    if summary.scenario:
        lines.append(_line("attached", ", ".join(summary.scenario)))
    if summary.versions:
        own = [f"{name} {summary.versions[name]}" for name in ("symaware-cli", "numpy") if name in summary.versions]
        lines.append(_line("versions", f"{', '.join(own)} and {len(summary.versions) - len(own)} more (--json)"))
    if summary.damage:
        lines.append(_line("damage", summary.damage))
    gaps = [(channel.topic, gap) for channel in summary.channels for gap in channel.gaps]
    for topic, gap in gaps[:5]:
        lines.append(_line("gap", f"{topic} has nothing between {gap.after:g} s and {gap.until:g} s"))
    if len(gaps) > 5:
        lines.append(_line("gap", f"and {len(gaps) - 5} more (--json)"))
    return "\n".join([*lines, "", *_channels(summary)])


def _channels(summary: Overview) -> list[str]:
    width = max((len(channel.topic) for channel in summary.channels), default=0)
    lines = [f"  {'channel':<{width}}  {'messages':>9}  {'rate':>9}  {'size':>8}  content"]
    for channel in summary.channels:
        rate = f"{channel.rate:.4g} Hz" if channel.rate else "-"
        content = f"{channel.schema.rpartition('.')[2]} {', '.join(channel.columns)}".rstrip()
        size = size_in_words(channel.size)
        lines.append(f"  {channel.topic:<{width}}  {channel.messages:>9,}  {rate:>9}  {size:>8}  {content}")
    return lines


def _line(label: str, text: str) -> str:
    return f"  {label:<9} {text}"
