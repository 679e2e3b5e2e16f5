"""MCAP files: indexed reading of messages, attachments and metadata, tolerant of damage."""

import itertools
import os
from bisect import bisect_left
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from mcap.opcode import Opcode
from mcap.records import Attachment, McapRecord, Metadata

from symaware_cli.log.error import LogError, reason
from symaware_cli.log.index import (
    ChannelInfo,
    MessageRange,
    RecordLocation,
    Unsound,
    from_summary,
    read_record,
    read_span,
)
from symaware_cli.log.json_text import read_json
from symaware_cli.log.log_message import LogMessage, RawMessage, read_messages
from symaware_cli.log.log_schema import LIBRARY, PROFILE
from symaware_cli.log.recovery import FOREVER, Damage, scan
from symaware_cli.world import nearest_file

_Record = TypeVar("_Record", bound=McapRecord)

MOST_HELD = 384 << 20
"""Maximum size of messages held in memory because chunks overlap in time, as in logs of other writers [bytes]."""


class McapFile:
    """An MCAP file, written by SymAware or another program, sound or damaged.

    The file is opened for each access and not held open in between, so there is nothing to close.

    Attributes:
        path: The file.
        size: Its size when it was opened, bytes.
        header: `profile` and `library` of the writer.
        index: The positions of all records, without those known to be damaged.
        channels: The channels by topic, sorted.
    """

    def __init__(self, path: str | os.PathLike[str]):
        """Read the index of the file.

        Args:
            path: The file.

        Raises:
            LogError: The file cannot be read: it is missing, not permitted, or not an MCAP file.
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
                    # SymAware always writes a summary; other writers may omit it.
                    damage.summary_missing |= index.header.profile == PROFILE
            except Unsound as error:
                if self.path.suffix.lower() in (".yaml", ".yml", ".toml"):
                    said = f"{self.path} is not a log; `symaware run {self.path}` writes that of a scenario"
                    raise LogError(said) from error
                raise LogError(f"{self.path} is not a log: {error}") from error
        self.index = index
        self.header = index.header
        self._damage = damage or None
        schemas = {number: schema.name for number, schema in index.schemas.items()}
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
        """Simulated time of the first message, ns; None if there are no messages."""
        return min((span.start for span in self.index.spans), default=None)

    @property
    def end_time(self) -> int | None:
        """Simulated time of the last message, ns; None if there are no messages."""
        return max((span.end for span in self.index.spans), default=None)

    @property
    def message_count(self) -> int:
        """Number of messages in the log."""
        return sum(self.index.counts.values())

    @property
    def damage(self) -> Damage | None:
        """The damage of the file, as far as known; `verify` finds all of it."""
        if self._damage:
            self._damage.last_time = self.end_time
        return self._damage

    def verify(self) -> Damage | None:
        """Read the whole file, and return its damage."""
        for _ in itertools.chain(self.attachment_records(), self.metadata_records()):
            pass
        with self.opened() as file:
            for span in list(self.index.spans):
                self._read(file, span, frozenset(), 0, 0)
        return self.damage

    def opened(self) -> AbstractContextManager[BinaryIO]:
        """Open the file for reading.

        Raises:
            LogError: It can no longer be read.
        """
        return _opened(self.path)

    def leave_out(self, span: MessageRange) -> None:
        """Remove a damaged chunk from the index and count the damage."""
        if _removed(self.index.spans, span):
            damage = self._note_damage()
            damage.chunks_skipped += 1
            damage.bytes_skipped += span.length
            damage.gaps.append((span.start, span.end))

    def attachment_records(self, name: str | None = None) -> Iterator[Attachment]:
        """Read the attachments, or those of one name, one by one; damaged ones are skipped and counted."""
        return self._records(self.index.attachments, name, Attachment, Opcode.ATTACHMENT)

    def metadata_records(self) -> Iterator[Metadata]:
        """Read the metadata records one by one; damaged ones are skipped and counted."""
        return self._records(self.index.metadata, None, Metadata, Opcode.METADATA)

    @cached_property
    def attachments(self) -> Mapping[str, bytes]:
        """The attachments by name; of two with the same name, the later."""
        return {record.name: record.data for record in self.attachment_records()}

    @cached_property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The metadata records by name; of two with the same name, the later."""
        return {record.name: record.metadata for record in self.metadata_records()}

    def messages(
        self, topics: str | Iterable[str] | None = None, start: int | None = None, end: int | None = None
    ) -> Generator[LogMessage, None, None]:
        """Iterate over messages, ordered by time and then sequence.

        Damaged chunks are skipped and counted in `damage`. A SymAware log is read chunk by chunk; for other logs, all
        chunks that overlap in time are held in memory together.

        Args:
            topics: The topics to read; None for all.
            start: The first simulated time, ns.
            end: The simulated time at which to stop, exclusive, ns.

        Raises:
            LogError: The file can no longer be read.
        """
        names = {topics} if isinstance(topics, str) else None if topics is None else set(topics)
        wanted = {number for number, info in self._channels.items() if names is None or info.topic in names}
        start, end = 0 if start is None else start, FOREVER if end is None else end
        spans = [span for span in self.index.spans if span.start < end and span.end >= start and span.channels & wanted]
        with self.opened() as file:
            batches = (self._read(file, span, wanted, start, end) for span in spans)
            in_file_order = itertools.chain.from_iterable(batches)
            for raw in in_file_order if self._in_order else self._sorted(file, spans, wanted, start, end):
                yield LogMessage(self._channels[raw.channel_id], raw.time, raw.sequence, raw.data, self.path)

    def json_metadata(self, name: str, check: Callable[[dict[str, Any]], object]) -> dict[str, Any] | None:
        """Read a metadata record whose values are JSON.

        Args:
            name: Its name.
            check: Validates the values; raises ValueError if they are invalid.

        Returns:
            The values; None if the record is missing or damaged.
        """
        if name not in self.metadata:
            return None
        try:
            said = {key: read_json(value) for key, value in self.metadata[name].items()}
            check(said)
            return said
        except ValueError:
            # Metadata records have no checksum, so damage is only found here.
            for place in [place for place in self.index.metadata if place.name == name]:
                self._leave_out(self.index.metadata, place)
            return None

    @cached_property
    def _in_order(self) -> bool:
        """Whether times and sequences ascend in the file, as the SymAware writer guarantees."""
        spans = self.index.spans
        ours = (self.header.profile, self.header.library) == (PROFILE, LIBRARY)
        return ours and all(one.end <= other.start for one, other in itertools.pairwise(spans))

    def _sorted(
        self, file: BinaryIO, spans: list[MessageRange], wanted: set[int], start: int, end: int
    ) -> Iterator[RawMessage]:
        """Yield messages in order, holding back those that may be preceded by messages of later chunks."""
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
        """Read the messages of a range; if it is damaged, return none and count the damage."""
        try:
            return read_messages(read_span(file, span, self.header), frozenset(wanted), start, end)
        except Unsound:
            self.leave_out(span)
            return []

    def _records(
        self, places: list[RecordLocation], name: str | None, kind: type[_Record], opcode: Opcode
    ) -> Iterator[_Record]:
        """Read attachments or metadata records, or those of one name; damaged ones are skipped and counted."""
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
    """Remove an item from a list in file order, and return whether it was there."""
    number = bisect_left(places, place.offset, key=lambda each: each.offset)
    there = number < len(places) and places[number].offset == place.offset
    if there:
        del places[number]
    return bool(there)


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file for reading; errors of the operating system become LogErrors."""
    try:
        if path.exists() and not path.is_file():
            # Checked before opening: opening a pipe would block forever.
            raise LogError(f"cannot read the log {path}: it is not a file")
        with open(path, "rb") as file:
            yield file
    except FileNotFoundError as error:
        near = nearest_file(path, (".mcap",))
        raise LogError(f"there is no file {path}{f'; did you mean {near}?' if near else ''}") from error
    except OSError as error:
        raise LogError(f"cannot read the log {path}: {reason(error)}") from error


def _size(raw: RawMessage) -> int:
    """Return the approximate memory size of a message [bytes]."""
    return len(raw.data) + 200


def _order(raw: RawMessage) -> tuple[int, int]:
    return raw.time, raw.sequence
