"""Recovery scan: reads a log whose end is missing or damaged.

The writer outputs whole records in order, so everything before the break is intact: the file is scanned from the
beginning, record by record, and every chunk is unpacked and checked.
"""

from dataclasses import dataclass, field
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from symaware_cli.recording.index import (
    FRAME,
    Index,
    MessageRange,
    RecordLocation,
    Unsound,
    frames,
    parse,
    read_at,
    read_header,
    read_record,
    unpack,
)
from symaware_cli.recording.log_message import read_messages
from symaware_cli.recording.log_schema import MAGIC, OUTCOME

FOREVER = 1 << 64
"""Later than any log time, ns."""

_RUN = 256 * 1024
"""Size at which a range of records outside chunks is split [bytes]."""


@dataclass(slots=True)
class Damage:
    """The damage of a log file; `str()` describes it in a sentence.

    Attributes:
        end_missing: The file ends before the end of its data: an unknown amount was lost.
        summary_missing: The summary at the end is missing or damaged. By itself this loses no data.
        unread_bytes: Number of bytes at the end of the file that form no intact record.
        chunks_skipped: Number of damaged chunks found so far; in a file with an intact summary, a chunk is checked only
            when it is read.
        attachments_skipped: Number of damaged attachments and metadata records.
        bytes_skipped: Total size of the skipped records, bytes.
        gaps: Intervals of simulated time whose messages are missing because of a damaged chunk, ns; None where nothing
            intact precedes or follows.
        last_time: The last simulated time that could be read, ns; None if there is no message.
    """

    end_missing: bool = False
    summary_missing: bool = False
    unread_bytes: int = 0
    chunks_skipped: int = 0
    attachments_skipped: int = 0
    bytes_skipped: int = 0
    gaps: list[tuple[int | None, int | None]] = field(default_factory=list)
    last_time: int | None = None

    @property
    def lost(self) -> bool:
        """Whether anything that was recorded cannot be read."""
        return self.end_missing or self.chunks_skipped > 0 or self.attachments_skipped > 0

    @property
    def missing_from(self) -> int | None:
        """The simulated time from which on messages are missing, ns; None if none are missing."""
        starts = [start for start, _ in self.gaps] + ([self.last_time] if self.end_missing else [])
        return min((start or 0 for start in starts), default=None)

    def __bool__(self) -> bool:
        return self.lost or self.summary_missing or self.unread_bytes > 0

    def __str__(self) -> str:
        parts = []
        if self.end_missing:
            after = f"after {_seconds(self.last_time)} of simulated time" if self.last_time is not None else ""
            parts.append(f"the log breaks off {after or 'before its first message'} and the end of the run is missing")
        elif self.summary_missing:
            parts.append("the summary at the end of the file is damaged, which loses nothing")
        if self.chunks_skipped:
            parts.append(f"{_count(self.chunks_skipped, 'damaged chunk')} left out{self._within()}")
        if self.attachments_skipped:
            parts.append(f"{_count(self.attachments_skipped, 'damaged attachment')} left out")
        if self.unread_bytes:
            parts.append(f"{_count(self.unread_bytes, 'byte')} at the end of the file cannot be read")
        return "; ".join(parts)

    def _within(self) -> str:
        """Return the interval of simulated time that contains all gaps, as text."""
        known = [time for gap in self.gaps for time in gap if time is not None]
        if not known:
            return ""
        start, end = _seconds(min(known)), _seconds(max(known))
        from_start = any(gap[0] is None for gap in self.gaps)
        to_end = any(gap[1] is None for gap in self.gaps)
        if from_start and to_end:
            return ""
        return f", before {end}" if from_start else f", after {start}" if to_end else f", between {start} and {end}"


def _seconds(time: int) -> str:
    return f"{time / 1e9:.9g} s"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


@dataclass(slots=True)
class _Run:
    """Consecutive records outside chunks, as other writers may leave them."""

    offset: int = 0
    length: int = 0
    times: list[int] = field(default_factory=list)
    channels: set[int] = field(default_factory=set)


def scan(file: BinaryIO, size: int) -> tuple[Index, Damage]:
    """Scan a log file from its beginning.

    Memory use is about 200 bytes per chunk.

    Args:
        file: The log.
        size: Its size in bytes.

    Returns:
        The index of all intact records, and the damage. A file that is complete except for its summary, which other
        writers may omit, is not damaged.

    Raises:
        Unsound: The file does not begin like an MCAP file.
    """
    index, damage, run = Index(read_header(file)), Damage(), _Run()
    _, length = FRAME.unpack(read_at(file, len(MAGIC), FRAME.size))
    position = len(MAGIC) + FRAME.size + length
    last = None
    # For each damaged chunk, the number of intact ranges before it.
    broken: set[int] = set()
    while size - position >= FRAME.size:
        opcode, length = FRAME.unpack(read_at(file, position, FRAME.size))
        if opcode == 0 or length > size - position - FRAME.size:
            break
        end = position + FRAME.size + length
        if opcode == Opcode.CHUNK:
            _close(run, index)
            content = read_at(file, position + FRAME.size, length)
            try:
                times, channels = _index_records(unpack(content, index.header), index)
            except Unsound:
                damage.chunks_skipped += 1
                damage.bytes_skipped += end - position
                broken.add(len(index.spans))
            else:
                if times:
                    index.spans.append(
                        MessageRange(position, end - position, min(times), max(times), frozenset(channels))
                    )
        elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):
            try:
                times, channels = _index_records(read_at(file, position, end - position), index)
            except Unsound:
                break
            if not times or run.length > _RUN:
                _close(run, index)
            if times:
                run.offset = run.offset or position
                run.length = end - run.offset
                run.times += times
                run.channels |= channels
        elif opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
            _close(run, index)
            kind: type[Attachment | Metadata] = Attachment if opcode == Opcode.ATTACHMENT else Metadata
            places = index.attachments if kind is Attachment else index.metadata
            try:
                record = read_record(file, position, end - position, kind, Opcode(opcode))
            except Unsound:
                damage.attachments_skipped += 1
                damage.bytes_skipped += end - position
            else:
                places.append(RecordLocation(record.name, position, end - position))
        elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
            last = opcode
        position = end
        if last == Opcode.FOOTER:
            break
    _close(run, index)
    tail = read_at(file, position, min(size - position, len(MAGIC)))
    ended = last == Opcode.FOOTER and tail == MAGIC
    damage.end_missing = last is None and all(place.name != OUTCOME for place in index.metadata)
    damage.summary_missing = not ended
    damage.unread_bytes = size - position - (len(MAGIC) if ended else 0)
    spans = index.spans
    damage.last_time = max((span.end for span in spans), default=None)
    damage.gaps = [
        (spans[count - 1].end if count else None, spans[count].start if count < len(spans) else None)
        for count in sorted(broken)
    ]
    return index, damage


def _index_records(records: bytes, index: Index) -> tuple[list[int], set[int]]:
    """Add the schemas, channels and counts of consecutive records to the index: all of them, or none on an error.

    Returns:
        The log times, ns, and the channels of the messages.

    Raises:
        Unsound: The records are damaged.
    """
    schemas, channels = [], []
    for opcode, start, end in frames(records):
        if opcode == Opcode.SCHEMA:
            schemas.append(parse(Schema, records[start:end]))
        elif opcode == Opcode.CHANNEL:
            channels.append(parse(Channel, records[start:end]))
    # Only new records are processed, as there may be as many ranges of records as channels.
    known_schemas = {0, *(schema.id for schema in schemas)}
    known = {channel.id for channel in channels}
    messages = read_messages(records, range(1 << 16), 0, FOREVER)
    used = {message.channel_id for message in messages}
    if any(number not in index.channels for number in used - known) or any(
        channel.schema_id not in index.schemas for channel in channels if channel.schema_id not in known_schemas
    ):
        raise Unsound("a record refers to one that is missing")
    index.schemas.update({schema.id: schema for schema in schemas})
    index.channels.update({channel.id: channel for channel in channels})
    for message in messages:
        index.counts[message.channel_id] = index.counts.get(message.channel_id, 0) + 1
    return [message.time for message in messages], used


def _close(run: _Run, index: Index) -> None:
    """End a range of records outside chunks."""
    if run.times:
        channels = frozenset(run.channels)
        index.spans.append(MessageRange(run.offset, run.length, min(run.times), max(run.times), channels, chunk=False))
    run.offset, run.length, run.times, run.channels = 0, 0, [], set()
