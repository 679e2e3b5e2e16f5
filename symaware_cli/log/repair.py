"""Repair: writes a sound log from the readable part of a damaged one.

Chunks are copied unchanged, and unpacked only to check them and to index their messages; a chunk is copied as a whole
or not at all. The beginning of a truncated chunk could be unpacked, too, but its checksum covers the whole chunk, so
the integrity of those messages could not be verified.
"""

import os
import zlib
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.records import Attachment, Chunk, DataEnd, Header, Metadata, MetadataIndex

from symaware_cli.log.index import FRAME, MessageRange, Unsound, parse, read_at, read_span
from symaware_cli.log.log_message import message_positions
from symaware_cli.log.log_schema import MAGIC, RECOVERY, json_values
from symaware_cli.log.log_summary import LogSummary, indexed, serialise
from symaware_cli.log.output import whole_file
from symaware_cli.log.reader import Log
from symaware_cli.log.recovery import Damage


@dataclass(frozen=True, slots=True)
class Recovery:
    """The result of a recovery.

    Attributes:
        path: The new log.
        size: Its size, bytes.
        messages: Number of its messages.
        chunks: Number of its chunks.
        attachments: Number of its attachments.
        start_time: Simulated time of the first message, ns; None if there are no messages.
        end_time: Simulated time of the last message, ns; None if there are no messages.
        damage: The damage of the old log; None if there was none.
    """

    path: Path
    size: int
    messages: int
    chunks: int
    attachments: int
    start_time: int | None
    end_time: int | None
    damage: Damage | None


def recover(log: Log, path: str | os.PathLike[str]) -> Recovery:
    """Write the readable part of a log to a new, sound log.

    Messages keep their order, channels their ids, chunks their compression. Messages outside chunks, as other writers
    leave them, are put into chunks. If the log was damaged, the metadata record `symaware.recovery` of the new one
    states the loss. Memory use is one chunk or attachment, and about 200 bytes per chunk.

    Args:
        log: The log, which is not changed.
        path: The new log; an existing file is replaced once the new one is complete.

    Raises:
        LogError: The log can no longer be read, or the new one cannot be written; then nothing is left behind.
    """
    path = Path(path)
    with whole_file(path, log.path) as partial, open(partial, "wb") as file:
        copy = _Copy(file, log)
        for attachment in log.attachment_records():
            copy.attach(attachment)
        for chunk, positions in _chunks(log):
            copy.add(chunk, positions)
        # Read these first: parsing their JSON may reveal further damage.
        earlier, _ = log.recovery, log.outcome
        for record in log.metadata_records():
            if record.name != RECOVERY or not log.damage:
                copy.metadata(record)
        if log.damage:
            copy.metadata(Metadata(RECOVERY, _recovery_record(log, log.damage, earlier)))
        copy.close()
    summary = copy.summary
    return Recovery(
        path=path,
        size=copy.size,
        messages=sum(summary.counts.values()),
        chunks=summary.chunk_count,
        attachments=len(summary.attachments),
        start_time=summary.start_time,
        end_time=None if summary.start_time is None else summary.end_time,
        damage=log.damage,
    )


def _recovery_record(log: Log, damage: Damage, earlier: dict[str, Any] | None) -> dict[str, str]:
    """Return the recovery record of the new log, each value as JSON."""
    content = asdict(damage) | {"log": log.path.name, "lost": damage.lost, "text": str(damage), "earlier": earlier}
    return json_values(content)


def _chunks(log: Log) -> Iterator[tuple[Chunk, dict[int, list[int]]]]:
    """Read the intact chunks, each with the positions of its messages."""
    with log.opened() as source:
        for span in list(log.index.spans):
            try:
                chunk, positions = _chunk(source, span, log.index.channels.keys(), log.header)
            except Unsound:
                log.leave_out(span)
            else:
                yield chunk, positions


def _chunk(
    source: BinaryIO, span: MessageRange, channels: Set[int], header: Header
) -> tuple[Chunk, dict[int, list[int]]]:
    """Read a range of messages as a chunk.

    Returns:
        The chunk, and for each channel id a flat list with time and offset of each message in it.

    Raises:
        Unsound: It is damaged.
    """
    records = read_span(source, span, header)
    if span.chunk:
        chunk = parse(Chunk, read_at(source, span.offset + FRAME.size, span.length - FRAME.size))
    else:
        chunk = Chunk("zstd", zstandard.ZstdCompressor(level=1).compress(records), 0, 0, 0, len(records))
    positions = message_positions(records)
    if not positions.keys() <= channels:
        raise Unsound("a message is of a channel that is missing")
    times = [time for entries in positions.values() for time in entries[::2]]
    # No checksum covers the times in the head of a chunk, so they are computed from the messages.
    chunk.message_start_time, chunk.message_end_time = min(times, default=0), max(times, default=0)
    chunk.uncompressed_crc = zlib.crc32(records)
    return chunk, positions


class _Copy:
    """Writes the new log."""

    def __init__(self, file: BinaryIO, log: Log) -> None:
        index = log.index
        self.size = 0
        self.summary = LogSummary(
            schemas={str(number): schema for number, schema in index.schemas.items()},
            channels=list(index.channels.values()),
        )
        self._file = file
        self._write(MAGIC + serialise(index.header, *index.schemas.values(), *index.channels.values()))

    def attach(self, attachment: Attachment) -> None:
        """Add an attachment."""
        self.summary.add_attachment(attachment, self.size, self._write(serialise(attachment)))

    def metadata(self, record: Metadata) -> None:
        """Add a metadata record."""
        self.summary.metadata.append(MetadataIndex(self.size, self._write(serialise(record)), record.name))

    def add(self, chunk: Chunk, positions: Mapping[int, Sequence[int]]) -> None:
        """Add a chunk, unless it has no messages."""
        if positions:
            records, index = indexed(chunk, self.size, positions)
            self._write(records)
            self.summary.add_chunk(index, {number: len(entries) // 2 for number, entries in positions.items()})

    def close(self) -> None:
        """Write the records that follow the messages."""
        self._write(serialise(DataEnd(data_section_crc=0)))
        self._write(self.summary.serialise(self.size))

    def _write(self, data: bytes | bytearray) -> int:
        self._file.write(data)
        self.size += len(data)
        return len(data)
