"""Lists of what happened: events, messages, contacts."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from itertools import chain, islice
from typing import Any

import typer

from symaware_cli.cli.terminal import WRONG_INPUT, fail, print_array
from symaware_cli.recording.entry_filter import EntryFilter
from symaware_cli.recording.error import LogError
from symaware_cli.recording.logged_events import Communication, LoggedContact, LoggedEvent
from symaware_cli.recording.reader import Log
from symaware_cli.scenario.problem import nearest

#: How much of a payload is shown.
_PAYLOAD = 80


def show_entries(log: Log, view: str, wanted: EntryFilter, limit: int | None, as_json: bool) -> None:
    """Print entries while they are read, because there may be many.

    Args:
        log: The log.
        view: ``--events``, ``--messages`` or ``--contacts``.
        wanted: A filter.
        limit: The greatest number; None for all.
        as_json: Whether to print JSON.

    Raises:
        LogError: The log has no such entries, or a name is unknown.
    """
    choose, plain, line, message_name = _VIEWS[view]
    topic = view.replace("--", "/")
    if log.foreign and not (topic in log.channels and log.channels[topic].carries(message_name)):
        raise LogError(f"{log.path} was not written by SymAware: it has no {view.removeprefix('--')}")
    found = choose(wanted, log)
    entries: Iterator[Any] = islice(found, limit)
    # Read the first one before anything is printed, because this detects wrong names.
    first = list(islice(entries, 1))
    if not first and limit != 0:
        _explain(log, view, wanted)
    entries = chain(first, entries)
    if not as_json:
        for entry in entries:
            typer.echo(line(entry))
        return
    try:
        print_array(plain(entry) for entry in entries)
    except LogError as error:
        # The array is closed; further output must not be part of it.
        fail(str(error), WRONG_INPUT)


def _explain(log: Log, view: str, wanted: EntryFilter) -> None:
    """Explain on stderr why nothing is listed, and which entries exist."""
    everything = list(dict.fromkeys(_called(entry) for entry in _VIEWS[view][0](EntryFilter(), log)))
    noun = view.removeprefix("--")
    if not everything:
        typer.echo(f"symaware: {log.path} has no {noun}", err=True)
        return
    asked = wanted.name or wanted.kind
    near = nearest(asked, everything) if asked and asked not in everything else None
    hint = f"; did you mean `{near}`?" if near else ""
    there = f"; there are {', '.join(sorted(everything))}" if "" not in everything else ""
    typer.echo(f"symaware: none of the {noun} matches{there}{hint}", err=True)


def _called(entry: Any) -> str:
    return str(getattr(entry, "name", getattr(entry, "kind", "")))


def _event(event: LoggedEvent) -> str:
    line = f"{_time(event.time)}  {event.level:<7}  {event.name:<14}  {event.source}  {event.text}".rstrip()
    trace = str(event.data.get("traceback", "")).rstrip()
    return f"{line}\n{trace}" if trace else line


def _communication(entry: Communication) -> str:
    parts = [f"{_time(entry.time)}  {entry.stage:<9}  {entry.sender} to {entry.receiver}  {entry.kind}"]
    if entry.stage != "SENT":
        parts.append(f"after {entry.latency / 1e9:.9g} s")
    if entry.reason:
        parts.append(entry.reason)
    if entry.payload is not None:
        payload = json.dumps(entry.payload)
        parts.append(payload if len(payload) <= _PAYLOAD else f"{payload[: _PAYLOAD - 3]}...")
    return "  ".join(parts)


def _contact(entry: LoggedContact) -> str:
    place = f"  at ({', '.join(f'{each:.4g}' for each in entry.point)}) m" if entry.point else ""
    depth = f", {entry.depth:.3g} m deep" if entry.stage == "BEGIN" else ""
    return f"{_time(entry.time)}  {entry.stage:<5}  {entry.a} and {entry.b}{place}{depth}"


def _time(time: int) -> str:
    return f"{time / 1e9:10.4f} s"


def _plain_communication(entry: Communication) -> dict[str, Any]:
    return asdict(entry) | {"latency": entry.latency}


_VIEWS: dict[str, tuple[Callable[..., Iterator[Any]], Callable[[Any], Any], Callable[[Any], str], str]] = {
    "--events": (EntryFilter.events, asdict, _event, "Event"),
    "--messages": (EntryFilter.communications, _plain_communication, _communication, "Message"),
    "--contacts": (EntryFilter.contacts, asdict, _contact, "Contact"),
}
"""For each view: how to read entries, convert them to plain data and to a line, and their message type."""
