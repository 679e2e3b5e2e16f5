"""A log as a file: any MCAP, as far as it can be read."""

import itertools
import os
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from mcap.opcode import Opcode
from mcap.records import Attachment, McapRecord, Metadata

from symaware_cli.recording.error import LogError, reason
from symaware_cli.recording.index import (
    ChannelInfo,
    MessageRange,
    RawMessage,
    RecordLocation,
    Unsound,
    from_summary,
    read_messages,
    read_record,
    read_span,
)
from symaware_cli.recording.json_text import read_json
from symaware_cli.recording.log_message import LogMessage
from symaware_cli.recording.log_schema import FORMER, LIBRARY, PROFILE
from symaware_cli.recording.recovery import FOREVER, Damage, scan

_Record = TypeVar("_Record", bound=McapRecord)

MOST_HELD = 384 << 20
"""Bytes of messages that are held because their chunks overlap in time, as they may in other people's logs."""


class McapFile:
    """An MCAP, of ours or of others, sound or not.

    The file is opened for each look at it and not held in between, so there is nothing to close.

    Attributes:
        path: The file.
        size: Its size when it was opened, bytes.
        header: `profile` and `library` of whoever wrote it.
        index: Where everything stands in the file, but for what is known to be damaged.
        channels: By topic, sorted.
    """

    def __init__(self, path: str | os.PathLike[str]):
        """Find out what stands where.

        Args:
            path: The file.

        Raises:
            LogError: There is nothing to read: no such file, no permission, or not an MCAP.
        """
        self.path = Path(path)
        with self.opened() as file:
            self.size = os.fstat(file.fileno()).st_size
            if self.size == 0:
                raise LogError(f"{self.path} is empty")
            damage: Damage | None = None
            try:
                index = from_summary(file, self.size)
                if index is None:
                    index, damage = scan(file, self.size)
                    # Ours always have a summary; others may do without.
                    damage.summary_missing |= index.header.profile == PROFILE
            except Unsound as error:
                raise LogError(f"{self.path} is not a log: {error}") from error
        self.index = index
        self.header = index.header
        self._damage = damage or None
        schemas = {number: FORMER.get(schema.name, schema.name) for number, schema in index.schemas.items()}
        self._set_channels(
            {
                number: ChannelInfo(
                    channel.topic,
                    schemas[channel.schema_id] if channel.schema_id else "",
                    channel.message_encoding,
                    channel.metadata,
                    index.counts.get(number, 0),
                )
                for number, channel in index.channels.items()
            }
        )

    def _set_channels(self, channels: dict[int, ChannelInfo]) -> None:
        self._channels = channels
        self.channels = {info.topic: info for info in sorted(channels.values(), key=lambda info: info.topic)}

    @property
    def start_time(self) -> int | None:
        """Simulated time of the first message, ns; None without messages."""
        return min((span.start for span in self.index.spans), default=None)

    @property
    def end_time(self) -> int | None:
        """Simulated time of the last message, ns; None without messages."""
        return max((span.end for span in self.index.spans), default=None)

    @property
    def message_count(self) -> int:
        """Messages in the log."""
        return sum(self.index.counts.values())

    @property
    def damage(self) -> Damage | None:
        """What is wrong with the file, as far as it is known by now; `verify` makes sure."""
        if self._damage:
            self._damage.last_time = self.end_time
        return self._damage

    def verify(self) -> Damage | None:
        """Read everything once, and return what is wrong with the file."""
        for _ in itertools.chain(self.attachment_records(), self.metadata_records()):
            pass
        with self.opened() as file:
            for span in list(self.index.spans):
                self._read(file, span, frozenset(), 0, 0)
        return self.damage

    def opened(self) -> AbstractContextManager[BinaryIO]:
        """Open the file for reading.

        Raises:
            LogError: It cannot be read any more.
        """
        return _opened(self.path)

    def leave_out(self, span: MessageRange) -> None:
        """Forget a chunk that turned out to be damaged, and note the damage."""
        if _removed(self.index.spans, span):
            damage = self._note_damage()
            damage.chunks_skipped += 1
            damage.bytes_skipped += span.length
            damage.gaps.append((span.start, span.end))

    def attachment_records(self, name: str | None = None) -> Iterator[Attachment]:
        """Read the attachments (of one name, if given) one by one; what is damaged is left out and noted."""
        return self._records(self.index.attachments, name, Attachment, Opcode.ATTACHMENT)

    def metadata_records(self) -> Iterator[Metadata]:
        """Read the metadata records one by one; what is damaged is left out and noted."""
        return self._records(self.index.metadata, None, Metadata, Opcode.METADATA)

    @cached_property
    def attachments(self) -> Mapping[str, bytes]:
        """The attachments, by name; of two with one name the later."""
        return {record.name: record.data for record in self.attachment_records()}

    @cached_property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The metadata records, by name; of two with one name the later."""
        return {record.name: record.metadata for record in self.metadata_records()}

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
        spans = [span for span in self.index.spans if span.start < end and span.end >= start and span.channels & wanted]
        with self.opened() as file:
            batches = (self._read(file, span, wanted, start, end) for span in spans)
            ordered = self._in_file_order(batches) if self._in_order else self._sorted(file, spans, wanted, start, end)
            for raw in ordered:
                yield LogMessage(self._channels[raw.channel_id], raw.time, raw.sequence, raw.data, self.path)

    def json_metadata(self, name: str, check: Callable[[dict[str, Any]], object]) -> dict[str, Any] | None:
        """Read a metadata record whose values are JSON.

        Args:
            name: Its name.
            check: Raises ValueError if it says what cannot be.

        Returns:
            What it says; None if there is none, or it is damaged.
        """
        if name not in self.metadata:
            return None
        try:
            said = {key: read_json(value) for key, value in self.metadata[name].items()}
            check(said)
            return said
        except ValueError:
            # Metadata have no checksum: that it is damaged shows only here.
            for place in [place for place in self.index.metadata if place.name == name]:
                self._leave_out(self.index.metadata, place)
            return None

    @cached_property
    def _in_order(self) -> bool:
        """Whether the order of the file is the order of time and sequence, as our writer sees to it."""
        spans = self.index.spans
        ours = (self.header.profile, self.header.library) == (PROFILE, LIBRARY)
        return ours and all(one.end <= other.start for one, other in itertools.pairwise(spans))

    @staticmethod
    def _in_file_order(batches: Iterable[list[RawMessage]]) -> Iterator[RawMessage]:
        for batch in batches:
            yield from batch

    def _sorted(
        self, file: BinaryIO, spans: list[MessageRange], wanted: set[int], start: int, end: int
    ) -> Iterator[RawMessage]:
        """Sort messages, holding those that a span not yet read might come before."""
        held: list[RawMessage] = []
        size = 0
        for span in sorted(spans, key=lambda span: (span.start, span.offset)):
            ready = [raw for raw in held if raw.time < span.start]
            if ready:
                held = [raw for raw in held if raw.time >= span.start]
                yield from sorted(ready, key=_order)
                size -= sum(map(_size, ready))
            batch = self._read(file, span, wanted, start, end)
            held += batch
            size += sum(map(_size, batch))
            if size > MOST_HELD:
                raise LogError(f"{self.path} has too many messages in chunks that overlap in time")
        yield from sorted(held, key=_order)

    def _read(
        self, file: BinaryIO, span: MessageRange, wanted: Iterable[int], start: int, end: int
    ) -> list[RawMessage]:
        """Read the messages of a span; none, and a note of the damage, if it is damaged."""
        try:
            return read_messages(read_span(file, span, self.header), frozenset(wanted), start, end)
        except Unsound:
            self.leave_out(span)
            return []

    def _records(
        self, places: list[RecordLocation], name: str | None, kind: type[_Record], opcode: Opcode
    ) -> Iterator[_Record]:
        """Read attachments or metadata records (of one name, if given); forget damaged ones, and note the damage."""
        with self.opened() as file:
            for place in [place for place in places if name in (None, place.name)]:
                try:
                    record = read_record(file, place.offset, place.length, kind, opcode)
                except Unsound:
                    self._leave_out(places, place)
                else:
                    yield record

    def _leave_out(self, places: list[RecordLocation], place: RecordLocation) -> None:
        if _removed(places, place):
            damage = self._note_damage()
            damage.attachments_skipped += 1
            damage.bytes_skipped += place.length

    def _note_damage(self) -> Damage:
        if self._damage is None:
            self._damage = Damage()
        return self._damage


def _removed(places: list[Any], place: MessageRange | RecordLocation) -> bool:
    """Take something out of a list in the order of the file, and say whether it was there."""
    number = bisect_left(places, place.offset, key=lambda each: each.offset)
    there = number < len(places) and places[number].offset == place.offset
    if there:
        del places[number]
    return bool(there)


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


def _size(raw: RawMessage) -> int:
    """Memory that a message takes, roughly [bytes]."""
    return len(raw.data) + 200


def _order(raw: RawMessage) -> tuple[int, int]:
    return raw.time, raw.sequence
