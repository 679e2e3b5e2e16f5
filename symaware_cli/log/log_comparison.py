"""Compares two logs: the first difference, and for each channel the first and the greatest difference and the agents.

/timing is left out, because equal runs may differ in it.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, zip_longest
from typing import Any, TypeAlias

from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.log_schema import OUTCOME, TIMING
from symaware_cli.log.message_elements import Element, elements
from symaware_cli.log.reader import Log

#: Attachments and entries of the outcome in which equal runs may differ.
_VERSIONS, _WALL = "versions.json", ("wall_time", "cpu_time", "log")


@dataclass(frozen=True, slots=True)
class LogDifference:
    """A difference between two logs.

    Attributes:
        time: Simulated time [ns]; None for an attachment or the outcome.
        topic: The channel, the attachment, or ``outcome``.
        agent: The agent or entity that it is about; "" if there is none.
        element: The name of the value that differs; "" if a message is in one log only.
        values: The value in each log; None where it has none.
    """

    time: int | None
    topic: str
    agent: str
    element: str
    values: tuple[Any, Any]

    @property
    def distance(self) -> float | None:
        """The difference of two numbers; None if they are not numbers."""
        first, second = self.values
        if isinstance(first, int | float) and isinstance(second, int | float):
            return abs(float(second) - float(first))
        return None

    def __str__(self) -> str:
        when = "" if self.time is None else f"at {self.time / 1e9:.9g} s "
        what = f", {' '.join(filter(None, (self.agent, self.element)))}" if self.agent or self.element else ""
        first, second = ("nothing" if value is None else value for value in self.values)
        return f"{when}on {self.topic}{what}: {first} and {second}"


Allowed: TypeAlias = Callable[["LogDifference"], bool] | None
"""Tells whether a difference is within a tolerance; None if none is."""


@dataclass(frozen=True, slots=True)
class ChannelDifference:
    """The differences of two logs in a channel.

    Attributes:
        topic: The channel.
        first: The first difference.
        messages: The number of messages that differ, or are in one log only.
        agents: The agents or entities that differ, sorted.
        greatest: The greatest difference of two numbers; None if there is none.
    """

    topic: str
    first: LogDifference
    messages: int
    agents: tuple[str, ...]
    greatest: LogDifference | None


def first_difference(one: Log, other: Log, allowed: Allowed = None) -> LogDifference | None:
    """Return the first difference of two logs in the order of their messages; None if no message differs.

    Args:
        one: A log.
        other: Another log.
        allowed: Tells which differences between elements of messages do not count.

    Raises:
        LogError: A log can no longer be read.
    """
    for mine, theirs in zip_longest(_instants(one), _instants(other)):
        if mine is None or theirs is None or mine[0] != theirs[0]:
            earlier = min((each for each in (mine, theirs) if each is not None), key=lambda each: each[0])
            return _only_in(earlier[1][0], one if earlier is mine else other, is_first=earlier is mine)
        found = _in_instant(mine[1], theirs[1], one, other, allowed)
        if found is not None:
            return found
    return None


def compared_channels(one: Log, other: Log) -> Sequence[str]:
    """Return the channels in which two logs are compared, sorted: all channels of either, except /timing."""
    return sorted({*one.channels, *other.channels} - {TIMING})


def channel_differences(one: Log, other: Log, allowed: Allowed = None) -> Sequence[ChannelDifference]:
    """Return the differences of each channel that differs, the earliest first.

    Args:
        one: A log.
        other: Another log.
        allowed: Tells which differences between elements of messages do not count.

    Raises:
        LogError: A log can no longer be read.
    """
    topics = compared_channels(one, other)
    found = [each for topic in topics if (each := _in_channel(topic, one, other, allowed)) is not None]
    return sorted(found, key=lambda each: -1 if each.first.time is None else each.first.time)


def attachment_differences(one: Log, other: Log, allowed: Allowed = None) -> Sequence[LogDifference]:
    """Return the differences of attachments (except versions), outcomes, and metadata of channels about columns.

    Args:
        one: A log.
        other: Another log.
        allowed: Tells which differences do not count.
    """
    mine, theirs = one.attachments, other.attachments
    found = [
        LogDifference(None, name, "", "", (_size(mine.get(name)), _size(theirs.get(name))))
        for name in sorted({*mine, *theirs} - {_VERSIONS})
        if mine.get(name) != theirs.get(name)
    ]
    ends = [log.outcome or {} for log in (one, other)]
    found += [
        LogDifference(None, OUTCOME, "", key, (ends[0].get(key), ends[1].get(key)))
        for key in sorted({*ends[0], *ends[1]} - {*_WALL})
        if ends[0].get(key) != ends[1].get(key)
    ]
    for topic in sorted({*one.channels} & {*other.channels}):
        columns = [(log.channels[topic].schema, log.channels[topic].metadata) for log in (one, other)]
        if columns[0] != columns[1]:
            found.append(LogDifference(None, topic, "", "metadata", (str(columns[0]), str(columns[1]))))
    return found if allowed is None else [each for each in found if not allowed(each)]


def _size(content: bytes | None) -> str | None:
    return None if content is None else f"{len(content):,} bytes, SHA-256 {hashlib.sha256(content).hexdigest()[:16]}"


def _instants(log: Log) -> Iterator[tuple[int, list[LogMessage]]]:
    """Yield the messages of each instant, except those of /timing."""
    messages = log.messages(topic for topic in log.channels if topic != TIMING)
    yield from ((time, list(own)) for time, own in groupby(messages, key=lambda message: message.time))


def _is_same(mine: LogMessage, theirs: LogMessage) -> bool:
    return (
        mine.channel.topic == theirs.channel.topic
        and mine.channel.schema == theirs.channel.schema
        and mine.channel.metadata == theirs.channel.metadata
        and mine.data == theirs.data
    )


def _in_instant(
    mine: list[LogMessage], theirs: list[LogMessage], one: Log, other: Log, allowed: Allowed
) -> LogDifference | None:
    """The first difference of an instant."""
    for first, second in zip_longest(mine, theirs):
        if first is not None and second is not None and _is_same(first, second):
            continue
        topics = [Counter(message.channel.topic for message in each) for each in (mine, theirs)]
        if first is not None and topics[0][first.channel.topic] > topics[1][first.channel.topic]:
            return _only_in(first, one, is_first=True)
        if second is not None and topics[1][second.channel.topic] > topics[0][second.channel.topic]:
            return _only_in(second, other, is_first=False)
        if first is None or second is None or first.channel.topic != second.channel.topic:
            present = first or second
            assert present is not None
            topic = [each.channel.topic if each else None for each in (first, second)]
            return LogDifference(present.time, present.channel.topic, "", "order", (topic[0], topic[1]))
        found = (each for each in message_differences(first, second, one, other) if not (allowed and allowed(each)))
        if (difference := next(found, None)) is not None:
            return difference
    return None


def _only_in(message: LogMessage, log: Log, *, is_first: bool) -> LogDifference:
    found = {name: value for _, name, value in elements(message, log)}
    said = found.get("text") or found.get("name") or f"a message with {len(found)} values"
    return LogDifference(message.time, message.channel.topic, "", "", (said, None) if is_first else (None, said))


def message_differences(first: LogMessage, second: LogMessage, one: Log, other: Log) -> Iterator[LogDifference]:
    """Yield the elements that differ between two messages on one channel.

    Args:
        first: A message.
        second: Another message of the same time and channel, with other bytes.
        one: The log of the first message.
        other: The log of the second message.

    Raises:
        LogError: A message is damaged.
    """
    mine, theirs = _by_name(elements(first, one)), _by_name(elements(second, other))
    differs = False
    for agent, name in dict.fromkeys([*mine, *theirs]):
        values = mine.get((agent, name)), theirs.get((agent, name))
        if not _equal(*values):
            differs = True
            yield LogDifference(first.time, first.channel.topic, agent, name, values)
    if not differs:
        yield LogDifference(first.time, first.channel.topic, "", "encoding", (len(first.data), len(second.data)))


def _by_name(content: Iterator[Element]) -> dict[tuple[str, str], Any]:
    return {(agent, name): value for agent, name, value in content}


def _equal(first: Any, second: Any) -> bool:
    """Whether two values are the same, to the bit."""
    if isinstance(first, float) and isinstance(second, float):
        return struct.pack("<d", first) == struct.pack("<d", second)
    return bool(first == second)


def _in_channel(topic: str, one: Log, other: Log, allowed: Allowed) -> ChannelDifference | None:
    messages = [
        {time: list(own) for time, own in groupby(log.messages(topic), key=lambda message: message.time)}
        if topic in log.channels
        else {}
        for log in (one, other)
    ]
    first: LogDifference | None = None
    greatest: LogDifference | None = None
    count, agents = 0, set[str]()
    for time in sorted({*messages[0], *messages[1]}):
        for mine, theirs in zip_longest(messages[0].get(time, ()), messages[1].get(time, ())):
            if mine is not None and theirs is not None and _is_same(mine, theirs):
                continue
            if theirs is None:
                assert mine is not None
                found = [_only_in(mine, one, is_first=True)]
            elif mine is None:
                found = [_only_in(theirs, other, is_first=False)]
            else:
                found = list(message_differences(mine, theirs, one, other))
            if allowed is not None:
                found = [each for each in found if not allowed(each)]
                if not found:
                    continue
            count += 1
            first = first or found[0]
            agents.update(each.agent for each in found if each.agent)
            greatest = max([each for each in (greatest, *found) if each is not None], key=_weight)
    if first is None or greatest is None:
        return None
    has_numbers = greatest.distance is not None
    return ChannelDifference(topic, first, count, tuple(sorted(agents)), greatest if has_numbers else None)


def _weight(difference: LogDifference) -> float:
    distance = difference.distance
    return -1.0 if distance is None or math.isnan(distance) else distance
