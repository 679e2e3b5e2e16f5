"""Views of a log in the terminal: its overview, lists of events, messages and contacts, and values over time."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from itertools import chain, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.api import size_in_words
from symaware_cli.cli.terminal import WRONG_INPUT, fail, print_array, print_json, printable, say
from symaware_cli.cli.text_table import aligned
from symaware_cli.language import nearest
from symaware_cli.log import EntryFilter, Log, LogError, Overview, Series, UnknownNameError
from symaware_cli.log.logged_events import Communication, LoggedContact, LoggedEvent
from symaware_cli.world import listed

#: How many columns of a channel are named.
_MOST = 9


def overview_text(summary: Overview) -> str:
    """Lay out the overview of a log."""
    outcome = "" if summary.foreign else f", {summary.status}"
    lines = [f"{summary.path}: {size_in_words(summary.size)}{outcome}"]
    if summary.foreign:
        lines.append(_line("origin", "not written by SymAware; only its channels can be shown"))
    else:
        known = summary.name is not None
        lines.append(
            _line("scenario", f"{summary.name}, seed {summary.seed}, {summary.mode}" if known else "not known")
        )
        groups = ", ".join(f"{name} ({count})" for name, count in summary.agents.items()) or "none"
        lines.append(_line("agents", groups))
        if summary.entities:
            lines.append(_line("entities", ", ".join(summary.entities)))
    if summary.foreign and summary.span is not None:
        lines.append(_line("time", summary.span))
    elif summary.simulated_time is not None:
        steps = f", {summary.steps:,} steps" if summary.steps is not None else ""
        step = f" of {summary.time_step:g} s" if steps and summary.time_step else ""
        wall = f"; {summary.wall_time:.2f} s of wall time" if summary.wall_time is not None else ""
        lines.append(_line("time", f"0 to {summary.simulated_time:.9g} s{steps}{step}{wall}"))
    # Contacts are counted like in the summary of the run, rather than by their events.
    events = {name: count for name, count in summary.events.items() if name != "contact" or summary.contacts is None}
    if events:
        lines.append(_line("events", ", ".join(f"{name} {count}" for name, count in events.items())))
    if summary.contacts:
        lines.append(_line("contacts", f"{summary.contacts:,}"))
    lines += [_line(each.verdict, str(each)) for each in summary.specifications]
    if summary.scenario:
        lines.append(_line("attached", ", ".join(summary.scenario)))
    if summary.versions:
        own = [f"{name} {summary.versions[name]}" for name in ("symaware-cli", "numpy") if name in summary.versions]
        lines.append(_line("versions", f"{', '.join(own)} and {len(summary.versions) - len(own)} more (--json)"))
    if "Processor" in summary.versions:
        lines.append(_line("computed", _computed(summary.versions)))
    if summary.recovered:
        lines.append(_line("recovered", summary.recovered))
    if summary.damage:
        lines.append(_line("damage", summary.damage))
    gaps = [(channel.topic, gap) for channel in summary.channels for gap in channel.gaps]
    for topic, gap in gaps[:5]:
        lines.append(_line("gap", f"{topic} has nothing between {gap.after:g} s and {gap.until:g} s"))
    if len(gaps) > 5:
        lines.append(_line("gap", f"and {len(gaps) - 5} more (--json)"))
    return "\n".join([*lines, "", *_channels(summary)])


def _computed(versions: Mapping[str, str]) -> str:
    """The processor and libraries that computed the run, as far as they were recorded."""
    by = [f"NumPy {versions.get('NumPy kernels', 'unknown')}", versions.get("BLAS"), versions.get("C library")]
    pinned = versions.get("Pinned", "yes")
    return (
        f"on {versions['Processor']} by {', '.join(filter(None, by))}{'' if pinned == 'yes' else f'; pinned: {pinned}'}"
    )


def _channels(summary: Overview) -> list[str]:
    lines = [["channel", "messages", "rate", "size", "content"]]
    for channel in summary.channels:
        rate = f"{channel.rate:.4g} Hz" if channel.rate else "-"
        content = printable(f"{channel.schema.rpartition('.')[2]} {listed(channel.columns, _MOST)}".rstrip())
        lines.append([printable(channel.topic), f"{channel.messages:,}", rate, size_in_words(channel.size), content])
    return aligned(lines, "<>>><")


def _line(label: str, text: str) -> str:
    return f"  {label:<9} {printable(text)}"


#: How much of a payload is shown.
_PAYLOAD = 80


def show_entries(log: Log, view: str, wanted: EntryFilter, limit: int | None, as_json: bool) -> None:
    """Print entries while they are read, because there may be many.

    Args:
        log: The log.
        view: ``events``, ``messages`` or ``contacts``.
        wanted: A filter.
        limit: The greatest number; None for all.
        as_json: Whether to print JSON.

    Raises:
        LogError: The log has no such entries, or a name is unknown.
    """
    choose, plain, line, message_name = _VIEWS[view]
    topic = f"/{view}"
    if log.foreign and not (topic in log.channels and log.channels[topic].carries(message_name)):
        raise LogError(f"{log.path} was not written by SymAware: it has no {view}")
    found = choose(wanted, log)
    entries: Iterator[Any] = islice(found, limit)
    # Read the first one before anything is printed, because this detects wrong names.
    first = list(islice(entries, 1))
    if not first and limit != 0:
        _explain(log, view, wanted)
    entries = chain(first, entries)
    if not as_json:
        for entry in entries:
            say(line(entry))
        return
    try:
        print_array(plain(entry) for entry in entries)
    except LogError as error:
        # The array is closed; further output must not be part of it.
        fail(str(error), WRONG_INPUT)


def _explain(log: Log, view: str, wanted: EntryFilter) -> None:
    """Explain on stderr why nothing is listed, and which entries exist."""
    everything = list(dict.fromkeys(_called(entry) for entry in _VIEWS[view][0](EntryFilter(), log)))
    if not everything:
        say(f"symaware: {log.path} has no {view}", err=True)
        return
    asked = wanted.name or wanted.kind
    near = nearest(asked, everything) if asked and asked not in everything else None
    hint = f"; did you mean `{near}`?" if near else ""
    there = f"; there are {', '.join(sorted(everything))}" if "" not in everything else ""
    say(f"symaware: none of the {view} matches{there}{hint}", err=True)


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
    depth = f", {entry.depth:.3g} m deep" if entry.stage != "END" else ""
    return f"{_time(entry.time)}  {entry.stage:<5}  {entry.a} and {entry.b}{place}{depth}"


def _time(time: int) -> str:
    return f"{time / 1e9:10.4f} s"


def _plain_communication(entry: Communication) -> dict[str, Any]:
    return asdict(entry) | {"latency": entry.latency}


_VIEWS: dict[str, tuple[Callable[..., Iterator[Any]], Callable[[Any], Any], Callable[[Any], str], str]] = {
    "events": (EntryFilter.events, asdict, _event, "Event"),
    "messages": (EntryFilter.communications, _plain_communication, _communication, "Message"),
    "contacts": (EntryFilter.contacts, asdict, _contact, "Contact"),
}
"""For each view: how to read entries, convert them to plain data and to a line, and their message type."""


Array = NDArray[np.float64]


def show_series(
    log: Log, spec: str, *, start: int | None, end: int | None, every: float | None, limit: int | None, as_json: bool
) -> None:
    """Print a series: a line for each instant, then the least, mean and greatest value of each column.

    Args:
        log: The log.
        spec: ``NAME:FIELD`` or ``NAME:FIELD:COLUMN``.
        start: The first simulated time [ns].
        end: The last simulated time [ns].
        every: Print only the first line per this many seconds.
        limit: The greatest number of lines.
        as_json: Whether to print JSON.

    Raises:
        LogError: The log has no such series.
    """
    parts = spec.split(":")
    if len(parts) not in (2, 3) or not all(parts):
        raise LogError(f"a series is NAME:FIELD or NAME:FIELD:COLUMN, such as robot.0:state:x, not {spec!r}")
    name, field, *column = parts
    series = log.series(name, field)
    labels, units, values = _columns(log, name, series, column[0] if column else None)
    chosen = np.ones(len(series.times), bool)
    if start is not None:
        chosen &= series.times >= start
    if end is not None:
        chosen &= series.times <= end
    times, values = series.times[chosen], values[chosen]
    extremes = _extremes(values)
    shown = np.arange(len(times)) if every is None else _thinned(times, every)
    shown = shown[:limit]
    if as_json:
        print_json(
            {
                "name": name,
                "field": field,
                "columns": labels,
                "units": units,
                "times": times[shown].tolist(),
                "values": values[shown].tolist(),
                **{word: line.tolist() for word, line in extremes.items()},
                "instants": len(times),
            }
        )
        return
    heads = [f"{label} [{unit}]" if unit else label for label, unit in zip(labels, units, strict=True)]
    instants = [f"{times[index] / 1e9:.9g}" for index in shown.tolist()]
    numbers = [*values[shown].tolist(), *(row.tolist() for row in extremes.values())]
    lines = [["time [s]", *heads]]
    lines += [[first, *map(_number, row)] for first, row in zip([*instants, *extremes], numbers, strict=True)]
    # An empty line before the extremes.
    lines.insert(1 + len(instants), [""] * len(lines[0]))
    say("\n".join(aligned(lines, ">", indent="")))
    left_out = f", {len(shown):,} of them shown" if len(shown) < len(times) else ""
    say(f"of {len(times):,} instants{left_out}")


def _columns(log: Log, name: str, series: Series, column: str | None) -> tuple[list[str], list[str], Array]:
    """Lay out the columns side by side: their labels, their units, and the values (k, m)."""
    width = series.values.shape[-1]
    names = series.columns if len(series.columns) == width else tuple(str(number) for number in range(width))
    units = series.units if len(series.units) == width else ("",) * width
    numbers = list(range(width))
    if column is not None:
        numbers = [_column(log, names, column)]
    if series.values.ndim == 2:
        return [names[number] for number in numbers], [units[number] for number in numbers], series.values[:, numbers]
    count = series.values.shape[1]
    agents = log.agents.get(name, ())
    agents = agents if len(agents) == count else tuple(str(row) for row in range(count))
    labels = [f"{agent} {names[number]}" for agent in agents for number in numbers]
    values = series.values[:, :, numbers].reshape(len(series.times), len(labels))
    return labels, [units[number] for _ in agents for number in numbers], values


def _column(log: Log, names: tuple[str, ...], column: str) -> int:
    """The index of a column, given by its name or number."""
    if column in names:
        return names.index(column)
    if column.isdecimal() and int(column) < len(names):
        return int(column)
    there = ", ".join(names) or "none"
    raise UnknownNameError(f"{log.path} has no column {column!r} there; there are {there}", column, names)


def _thinned(times: NDArray[np.int64], every: float) -> NDArray[np.intp]:
    """The first instant of each interval."""
    _, firsts = np.unique(times // max(round(every * 1e9), 1), return_index=True)
    return firsts


def _extremes(values: Array) -> dict[str, Array]:
    """The minimum, mean and maximum of each column; NaN for an empty one."""
    lines = {word: np.full(values.shape[1], np.nan) for word in ("minimum", "mean", "maximum")}
    some = ~np.isnan(values).all(axis=0)
    if some.any():
        known = values[:, some]
        lines["minimum"][some], lines["maximum"][some] = np.nanmin(known, axis=0), np.nanmax(known, axis=0)
        with np.errstate(invalid="ignore"):  # +inf and -inf have no mean
            lines["mean"][some] = np.nanmean(known, axis=0)
    return lines


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.6g}"
