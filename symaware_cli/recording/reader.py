"""The reader of a log."""

import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from google.protobuf.message import DecodeError
from mcap.opcode import Opcode
from mcap.records import Attachment, McapRecord, Metadata

from symaware_cli.recording import journal, wire
from symaware_cli.recording.error import LogError, reason
from symaware_cli.recording.index import (
    ChannelInfo,
    Index,
    RawMessage,
    Span,
    Unsound,
    from_summary,
    read_messages,
    read_record,
    read_span,
)
from symaware_cli.recording.journal import Communication, LoggedContact, LoggedEvent
from symaware_cli.recording.recovery import FOREVER, Damage, scan
from symaware_cli.recording.schema import FORMAT, LIBRARY, MANIFEST, MESSAGES, OUTCOME, PROFILE
from symaware_cli.recording.series import Series, group_series, present_values, row_series

_DECODERS: dict[str, Callable[[bytes], Any]] = {
    message.DESCRIPTOR.full_name: message.FromString for message in MESSAGES.values()
} | {
    "symaware.v1.Rows": wire.decode_rows,
    "symaware.v1.Control": wire.decode_control,
    "symaware.v1.SeriesRows": wire.decode_series,
    "symaware.v1.Awareness": wire.decode_awareness,
}

_SERIES = {
    "world": "/world/{}/state",
    "control_requested": "/agents/{}/control",
} | {name: f"/agents/{{}}/{name}" for name in ("state", "control", "intent", "uncertainty", "risk")}
"""The topic of each field of `Log.series`."""


_Record = TypeVar("_Record", bound=McapRecord)


@dataclass(frozen=True, slots=True)
class LogMessage:
    """A message of a log.

    Attributes:
        channel: Where it was found.
        time: Simulated time, ns.
        sequence: Its place among the messages of that time; /timing has a count of its own.
        data: As serialised.
    """

    channel: ChannelInfo
    time: int
    sequence: int
    data: bytes

    def decode(self) -> Any:
        """Decode it.

        Returns:
            A `wire.Rows`, `wire.Control`, `wire.SeriesRows` or `wire.Awareness`; for other messages of ours the
            generated class.

        Raises:
            LogError: It is not one of our messages, or it is damaged.
        """
        decode = _DECODERS.get(self.channel.schema)
        if decode is None or self.channel.encoding != "protobuf":
            raise LogError(f"the messages on {self.channel.topic} ({self.channel.schema or 'no schema'}) are not ours")
        try:
            return decode(self.data)
        except (ValueError, DecodeError) as error:
            raise LogError(
                f"the message on {self.channel.topic} at {self.time} ns is no {self.channel.schema}"
            ) from error


class Log:
    """A log, opened by `open_log`.

    The file is opened for each look at it and not held in between, so there is nothing to close.

    Attributes:
        path: The file.
        size: Its size when it was opened, bytes.
        header: `profile` and `library` of whoever wrote it.
        channels: By topic, sorted.
        foreign: Whether somebody else's software wrote it: it has no manifest, and its messages are not ours.
        manifest: Who took part; empty if the log is foreign or broke off before it.
    """

    def __init__(self, path: Path, size: int, index: Index, damage: Damage | None):
        self.path = path
        self.size = size
        self._index = index
        self._damage = damage
        self._broken_spans: set[int] = set()
        self.header = index.header
        self._channels = {
            number: ChannelInfo(
                channel.topic,
                index.schemas[channel.schema_id].name if channel.schema_id else "",
                channel.message_encoding,
                channel.metadata,
                index.counts.get(number, 0),
            )
            for number, channel in index.channels.items()
        }
        self.channels = {info.topic: info for info in sorted(self._channels.values(), key=lambda info: info.topic)}
        self.manifest = self._read_manifest()
        self.foreign = not self.manifest and index.header.profile != PROFILE

    @property
    def start_time(self) -> int | None:
        """Simulated time of the first message, ns; None without messages."""
        return min((span.start for span in self._index.spans), default=None)

    @property
    def end_time(self) -> int | None:
        """Simulated time of the last message, ns; None without messages."""
        return max((span.end for span in self._index.spans), default=None)

    @property
    def message_count(self) -> int:
        """Messages in the log."""
        return sum(self._index.counts.values())

    @property
    def damage(self) -> Damage | None:
        """What is wrong with the file, as far as it is known by now; `verify` makes sure."""
        return self._damage

    def verify(self) -> Damage | None:
        """Read everything once, and return what is wrong with the file."""
        _ = self.attachments
        _ = self.metadata
        with _opened(self.path) as file:
            for span in self._index.spans:
                self._read(file, span, frozenset(), 0, 0)
        return self._damage

    @cached_property
    def attachments(self) -> Mapping[str, bytes]:
        """The attachments, by name; of two with one name the later."""
        records = self._records(self._index.attachments, Attachment, Opcode.ATTACHMENT)
        return {name: record.data for name, record in records.items()}

    @cached_property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The metadata records, by name; of two with one name the later."""
        records = self._records(self._index.metadata, Metadata, Opcode.METADATA)
        return {name: record.metadata for name, record in records.items()}

    @cached_property
    def outcome(self) -> dict[str, Any] | None:
        """How the run ended; None if it did not come to its end, or the log broke off."""
        if OUTCOME not in self.metadata:
            return None
        try:
            return {key: json.loads(value) for key, value in self.metadata[OUTCOME].items()}
        except ValueError as error:
            raise LogError(f"the outcome in {self.path} is damaged") from error

    def messages(
        self, topics: str | Iterable[str] | None = None, start: int | None = None, end: int | None = None
    ) -> Iterator[LogMessage]:
        """Iterate over messages, in the order of time and then sequence.

        Chunks that are damaged are left out and counted in `damage`. A log of ours is read chunk by chunk; of others,
        as many chunks are held in memory as overlap in time.

        Args:
            topics: Which; None for all.
            start: The first simulated time, ns.
            end: The first simulated time not wanted any more, ns.

        Raises:
            LogError: The file cannot be read any more.
        """
        names = {topics} if isinstance(topics, str) else None if topics is None else set(topics)
        wanted = {number for number, info in self._channels.items() if names is None or info.topic in names}
        start, end = 0 if start is None else start, FOREVER if end is None else end
        spans = [
            span for span in self._index.spans if span.start < end and span.end >= start and span.channels & wanted
        ]
        with _opened(self.path) as file:
            batches = (self._read(file, span, wanted, start, end) for span in spans)
            ordered = self._in_file_order(batches) if self._in_order else self._sorted(file, spans, wanted, start, end)
            for raw in ordered:
                yield LogMessage(self._channels[raw.channel_id], raw.time, raw.sequence, raw.data)

    def series(self, name: str, field: str) -> Series:
        """Put a series together.

        Args:
            name: A group, an agent, or an entity of the environment. The name of a group of one is its agent's.
            field: `state` (what they believe), `world` (what is true), `control` (as applied), `control_requested`, or
                `intent`, `uncertainty` and `risk`, of which the first point of each time series is taken.

        Returns:
            For a group every instant at which any of its agents was recorded, (k, n, columns), where the others keep
            their value (NaN before the first); for an agent or an entity the instants at which it was recorded,
            (k, columns). Of entities only those that move were recorded.

        Raises:
            LogError: There is no such name or field.
        """
        if field not in _SERIES:
            raise LogError(f"there is no field {field!r}; there are {', '.join(sorted(_SERIES))}")
        group, row, count = self._place(name)
        topic = _SERIES[field].format(group)
        info = self.channels.get(topic)
        if info is None:
            raise LogError(f"{self.path} has no {field} of {name!r} (no channel {topic})")
        entries = (
            (message.time, *present_values(message.decode(), requested=field == "control_requested"))
            for message in self.messages(topic)
        )
        try:
            times, values = group_series(entries, count) if row is None else row_series(entries, row)
        except ValueError as error:
            raise LogError(f"the messages on {topic} in {self.path} do not fit together: {error}") from error
        columns, units = (_split(info.metadata.get(key, "")) for key in ("columns", "units"))
        return Series(times, values, columns, units)

    def events(self) -> Iterator[LoggedEvent]:
        """Iterate over the events."""
        return self._journal("/events", "symaware.v1.Event", journal.event)

    def communications(self) -> Iterator[Communication]:
        """Iterate over the stages of messages between agents."""
        return self._journal("/messages", "symaware.v1.Message", journal.communication)

    def contacts(self) -> Iterator[LoggedContact]:
        """Iterate over the beginnings and ends of contacts."""
        return self._journal("/contacts", "symaware.v1.Contact", journal.contact)

    def _journal(self, topic: str, schema: str, entry: Callable[[int, Any], Any]) -> Iterator[Any]:
        for message in self.messages(topic):
            if message.channel.schema == schema:
                try:
                    yield entry(message.time, message.decode())
                except ValueError as error:
                    raise LogError(f"the entry on {topic} at {message.time} ns is damaged: {error}") from error

    def _place(self, name: str) -> tuple[str, int | None, int]:
        """The group, the row in it (None for the whole group) and the size of it that a name stands for."""
        groups = self.manifest.get("groups", {})
        for group, content in groups.items():
            agents = content.get("agents", [])
            if name in agents:
                return group, agents.index(name), len(agents)
        if name in groups:
            return name, None, len(groups[name].get("agents", []))
        if name in self.manifest.get("entities", {}):
            return name, 0, 1
        if any(template.format(name) in self.channels for template in _SERIES.values()):
            return name, None, 0
        known = [*groups, *self.manifest.get("entities", {})]
        raise LogError(f"{self.path} knows no {name!r}; there are {', '.join(known) or 'none'}")

    @cached_property
    def _in_order(self) -> bool:
        """Whether the order of the file is the order of time and sequence, as our writer sees to it."""
        spans = self._index.spans
        ours = (self.header.profile, self.header.library) == (PROFILE, LIBRARY)
        return ours and all(one.end <= other.start for one, other in itertools.pairwise(spans))

    @staticmethod
    def _in_file_order(batches: Iterable[list[RawMessage]]) -> Iterator[RawMessage]:
        for batch in batches:
            yield from batch

    def _sorted(
        self, file: BinaryIO, spans: list[Span], wanted: set[int], start: int, end: int
    ) -> Iterator[RawMessage]:
        """Sort messages, holding those that a span not yet read might come before."""
        held: list[RawMessage] = []
        for span in sorted(spans, key=lambda span: (span.start, span.offset)):
            ready = [raw for raw in held if raw.time < span.start]
            held = [raw for raw in held if raw.time >= span.start]
            yield from sorted(ready, key=_order)
            held += self._read(file, span, wanted, start, end)
        yield from sorted(held, key=_order)

    def _read(self, file: BinaryIO, span: Span, wanted: Iterable[int], start: int, end: int) -> list[RawMessage]:
        """Read the messages of a span; none, and a note of the damage, if it is damaged."""
        try:
            return read_messages(read_span(file, span), frozenset(wanted), start, end)
        except Unsound:
            if span.offset not in self._broken_spans:
                self._broken_spans.add(span.offset)
                self._note_damage().chunks_skipped += 1
            return []

    def _records(self, places: list[tuple[str, int]], kind: type[_Record], opcode: Opcode) -> dict[str, _Record]:
        """Read attachments or metadata records, leaving out damaged ones and noting the damage."""
        records = {}
        with _opened(self.path) as file:
            for name, offset in places:
                try:
                    records[name] = read_record(file, offset, kind, opcode, self.size)
                except Unsound:
                    self._note_damage().attachments_skipped += 1
        return records

    def _read_manifest(self) -> dict[str, Any]:
        places = [place for place in self._index.attachments if place[0] == MANIFEST]
        record = self._records(places, Attachment, Opcode.ATTACHMENT).get(MANIFEST)
        if record is None:
            return {}
        cause: Exception | None = None
        try:
            manifest = json.loads(record.data)
            version = manifest["format"]
            groups = manifest.get("groups", {}).values()
            sound = type(version) is int and all(isinstance(group.get("agents", []), list) for group in groups)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            sound, cause = False, error
        if sound and version > FORMAT:
            raise LogError(
                f"{self.path} was written by a newer SymAware: its format is {version}, this one reads up to {FORMAT}"
            )
        if not sound and self.header.profile == PROFILE:
            raise LogError(f"the manifest in {self.path} is damaged") from cause
        return manifest if sound else {}

    def _note_damage(self) -> Damage:
        if self._damage is None:
            self._damage = Damage(last_time=self.end_time)
        return self._damage


def open_log(path: str | os.PathLike[str]) -> Log:
    """Open a log.

    A log that was cut off or damaged is read as far as that is possible; `Log.damage` tells what is missing. The MCAP
    of other software opens, too, with `Log.foreign` set: its channels and messages can be listed.

    Args:
        path: The file.

    Returns:
        The log.

    Raises:
        LogError: There is nothing to read: no such file, no permission, not an MCAP, or of a newer format.
    """
    path = Path(path)
    with _opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size == 0:
            raise LogError(f"{path} is empty")
        damage: Damage | None = None
        try:
            index = from_summary(file, size)
            if index is None:
                index, damage = scan(file, size)
                # Ours always have a summary; others may do without.
                damage.summary_missing |= index.header.profile == PROFILE
        except Unsound as error:
            raise LogError(f"{path} is not a log: {error}") from error
    return Log(path, size, index, damage or None)


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file for reading; whatever the operating system refuses becomes a LogError."""
    try:
        if path.exists() and not path.is_file():
            # Before opening it: a pipe would wait for ever.
            raise LogError(f"cannot read the log {path}: it is not a file")
        with open(path, "rb") as file:
            yield file
    except FileNotFoundError as error:
        raise LogError(f"there is no file {path}") from error
    except OSError as error:
        raise LogError(f"cannot read the log {path}: {reason(error)}") from error


def _order(raw: RawMessage) -> tuple[int, int]:
    return raw.time, raw.sequence


def _split(names: str) -> tuple[str, ...]:
    return tuple(names.split(",")) if names else ()
