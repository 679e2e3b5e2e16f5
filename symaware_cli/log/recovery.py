"""Recovery scan: reads a log whose end is missing or damaged.

The writer outputs whole records in order, so everything before the break is intact: the file is scanned from the
beginning, record by record, and every chunk is unpacked and checked.
"""

from dataclasses import dataclass, field
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from symaware_cli.log.index import (
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
from symaware_cli.log.log_message import read_messages
from symaware_cli.log.log_schema import MAGIC, OUTCOME
from symaware_cli.world import counted

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
            parts.append(f"{counted(self.chunks_skipped, 'damaged chunk')} left out{self._within()}")
        if self.attachments_skipped:
            parts.append(f"{counted(self.attachments_skipped, 'damaged attachment')} left out")
        if self.unread_bytes:
            parts.append(f"{counted(self.unread_bytes, 'byte')} at the end of the file cannot be read")
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
    scanned = _Scan(file)
    _, length = FRAME.unpack(read_at(file, len(MAGIC), FRAME.size))
    position = len(MAGIC) + FRAME.size + length
    last = None
    while size - position >= FRAME.size and last != Opcode.FOOTER:
        opcode, length = FRAME.unpack(read_at(file, position, FRAME.size))
        if opcode == 0 or length > size - position - FRAME.size:
            break
        end = position + FRAME.size + length
        if opcode == Opcode.CHUNK:
            scanned.take_chunk(position, end)
        elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):
            try:
                scanned.take_records(position, end)
            except Unsound:
                break
        elif opcode == Opcode.ATTACHMENT:
            scanned.take_place(scanned.index.attachments, Attachment, opcode, position, end)
        elif opcode == Opcode.METADATA:
            scanned.take_place(scanned.index.metadata, Metadata, opcode, position, end)
        elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
            last = opcode
        position = end
    scanned.end_run()
    index, damage = scanned.index, scanned.damage
    tail = read_at(file, position, min(size - position, len(MAGIC)))
    ended = last == Opcode.FOOTER and tail == MAGIC
    damage.end_missing = last is None and all(place.name != OUTCOME for place in index.metadata)
    damage.summary_missing = not ended
    damage.unread_bytes = size - position - (len(MAGIC) if ended else 0)
    spans = index.spans
    damage.last_time = max((span.end for span in spans), default=None)
    damage.gaps = [
        (spans[count - 1].end if count else None, spans[count].start if count < len(spans) else None)
        for count in sorted(scanned.broken)
    ]
    return index, damage


class _Scan:
    """The results of a scan so far.

    Attributes:
        index: The intact records.
        damage: The damaged ones.
        broken: For each damaged chunk, the number of intact ranges before it.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.index = Index(read_header(file))
        self.damage = Damage()
        self.broken: set[int] = set()
        self._file = file
        # Consecutive records outside chunks, as other writers may leave them.
        self._offset = self._length = 0
        self._times: list[int] = []
        self._channels: set[int] = set()

    def take_chunk(self, position: int, end: int) -> None:
        """Add a chunk, or count it as damaged."""
        self.end_run()
        content = read_at(self._file, position + FRAME.size, end - position - FRAME.size)
        try:
            times, channels = _index_records(unpack(content, self.index.header), self.index)
        except Unsound:
            self.damage.chunks_skipped += 1
            self.damage.bytes_skipped += end - position
            self.broken.add(len(self.index.spans))
            return
        if times:
            span = MessageRange(position, end - position, min(times), max(times), frozenset(channels))
            self.index.spans.append(span)

    def take_records(self, position: int, end: int) -> None:
        """Add a record outside chunks.

        Raises:
            Unsound: It is damaged.
        """
        times, channels = _index_records(read_at(self._file, position, end - position), self.index)
        if not times or self._length > _RUN:
            self.end_run()
        if times:
            self._offset = self._offset or position
            self._length = end - self._offset
            self._times += times
            self._channels |= channels

    def take_place(
        self, places: list[RecordLocation], kind: type[Attachment | Metadata], opcode: int, position: int, end: int
    ) -> None:
        """Add an attachment or a metadata record to its places, or count it as damaged."""
        self.end_run()
        try:
            record = read_record(self._file, position, end - position, kind, Opcode(opcode))
        except Unsound:
            self.damage.attachments_skipped += 1
            self.damage.bytes_skipped += end - position
        else:
            places.append(RecordLocation(record.name, position, end - position))

    def end_run(self) -> None:
        """End a range of records outside chunks."""
        if self._times:
            first, last, channels = min(self._times), max(self._times), frozenset(self._channels)
            self.index.spans.append(MessageRange(self._offset, self._length, first, last, channels, chunk=False))
        self._offset, self._length, self._times, self._channels = 0, 0, [], set()


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
