"""The elements of a message of a log, each with the agent that it is about and a name: to tell two messages apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

from google.protobuf.message import Message

from symaware_cli.log import others_message, wire
from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.reader import Log
from symaware_cli.log.shared_channel import entities_of

#: What an element is: the agent or entity that it is about ("" if there is none), its name, and its value.
Element = tuple[str, str, Any]


def elements(message: LogMessage, log: Log) -> Iterator[Element]:
    """Yield the elements of a message in the order in which it holds them.

    Args:
        message: The message.
        log: The log that it is from.

    Raises:
        LogError: The message is damaged.
    """
    content = message.decode()
    names = _names(message, log)
    columns = [name for name in message.channel.metadata.get("columns", "").split(",") if name]
    columns = columns or [message.channel.topic.rpartition("/")[2]]
    match content:
        case wire.Rows():
            for place, row in enumerate(_rows(content.rows, len(content.values))):
                for column, value in enumerate(content.values[place].tolist()):
                    yield _name(names, row), _name(columns, column), value
        case wire.SeriesRows():
            series = list(content)
            for row, (times, values) in zip(_rows(content.rows, len(series)), series, strict=False):
                yield from _points(_name(names, row), columns, times.tolist(), values.tolist())
        case wire.TableRows():
            for place, row in enumerate(_rows(content.rows, len(content.lengths))):
                for entry, values in enumerate(content.at(place).tolist()):
                    for column, value in enumerate(values):
                        yield _name(names, row), f"{_name(columns, column)}[{entry}]", value
        case others_message.Awareness():
            yield from _beliefs(content, names, columns, log)
        case Message():
            yield from _fields(content, names)


def _names(message: LogMessage, log: Log) -> Sequence[str]:
    """The agents or entities that the rows of a message are about."""
    shared = entities_of(message.channel)
    if shared:
        return shared
    parts = message.channel.topic.split("/")
    return log.agents.get(parts[2], (parts[2],)) if len(parts) > 2 and parts[1] in ("agents", "world") else ()


def _rows(rows: Any, count: int) -> Sequence[int]:
    return range(count) if rows is None else rows.tolist()


def _name(names: Sequence[str], number: int) -> str:
    return names[number] if number < len(names) else str(number)


def _points(agent: str, columns: Sequence[str], times: Sequence[int], values: Sequence[Any]) -> Iterator[Element]:
    for point, (time, each) in enumerate(zip(times, values, strict=True)):
        yield agent, f"time[{point}]", time
        for column, value in enumerate(each):
            yield agent, f"{_name(columns, column)}[{point}]", value


def _beliefs(
    content: others_message.Awareness, names: Sequence[str], columns: Sequence[str], log: Log
) -> Iterator[Element]:
    yield "", "world", content.world
    roster: Sequence[str] = log.manifest.get("roster", ())
    if content.has_states:
        others = content.others(len(names))
        for place, row in enumerate(others.rows.tolist()):
            agent, other = _name(names, row), _name(roster, int(others.entities[place]))
            for column, value in enumerate(others.values[place, : others.sizes[place]].tolist()):
                yield agent, f"{other}:{_name(columns, column)}", value
            yield agent, f"{other}:age", float(others.ages[place])
            if others.covariances is not None:
                for number, value in enumerate(others.covariances[place].ravel().tolist()):
                    yield agent, f"{other}:covariance[{number}]", value
    for part in content.series:
        rows = list(_rows(part.rows, len(part.lengths)))
        for row, length in zip(rows, part.lengths.tolist(), strict=True):
            yield _name(names, row), f"others with {part.part}", length
        for place, entity, times, values in part:
            for agent, name, value in _points(_name(names, rows[place]), (), times.tolist(), values.tolist()):
                yield agent, f"{_name(roster, entity)}:{part.part}.{name}", value


def _fields(content: Message, names: Sequence[str], prefix: str = "") -> Iterator[Element]:
    """The fields of a generated message; fields with one element per row are named by agents."""
    rows = list(getattr(content, "rows", ()))
    for field, value in content.ListFields():
        name = f"{prefix}{field.name}"
        if not field.is_repeated:
            yield from _fields(value, names, f"{name}.") if isinstance(value, Message) else [("", name, value)]
        elif names and field.name != "rows" and len(value) == (len(rows) or len(names)):
            yield from ((_name(names, rows[place] if rows else place), name, each) for place, each in enumerate(value))
        else:
            yield from chain.from_iterable(
                _fields(each, names, f"{name}[{place}].")
                if isinstance(each, Message)
                else [("", f"{name}[{place}]", each)]
                for place, each in enumerate(value)
            )
