"""Builds the summary section at the end of a log while the log is written."""

import struct
import zlib
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from symaware_cli.log.log_schema import MAGIC

_MESSAGE_INDEX = struct.Struct("<BQHI")


@dataclass(slots=True)
class LogSummary:
    """The content of a log and the positions of its records.

    Attributes:
        schemas: In file order, by message name.
        channels: In file order.
        counts: Number of messages by channel id.
        attachments: In file order.
        metadata: In file order.
        start_time: The earliest log time, ns; None before the first chunk.
        end_time: The latest log time, ns.
        chunk_count: Number of chunks so far.
    """

    schemas: dict[str, Schema] = field(default_factory=dict)
    channels: list[Channel] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    start_time: int | None = None
    end_time: int = 0
    chunk_count: int = 0
    _chunks: bytearray = field(default_factory=bytearray)  # serialised, as there may be many

    def copied(self) -> "LogSummary":
        """Return an independent copy."""
        return LogSummary(**{each.name: copy(getattr(self, each.name)) for each in fields(self)})

    def add_attachment(self, attachment: Attachment, offset: int, length: int) -> None:
        """Add an attachment.

        Args:
            attachment: The attachment.
            offset: Position of its record.
            length: Length of its record, bytes.
        """
        self.attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )

    def add_chunk(self, chunk: ChunkIndex, counts: dict[int, int]) -> None:
        """Add a chunk.

        Args:
            chunk: Its index record.
            counts: Number of its messages by channel id.
        """
        self._chunks += serialise(chunk)
        self.chunk_count += 1
        start, end = chunk.message_start_time, chunk.message_end_time
        self.start_time = start if self.start_time is None else min(self.start_time, start)
        self.end_time = max(self.end_time, end)
        for channel_id, count in counts.items():
            self.counts[channel_id] = self.counts.get(channel_id, 0) + count

    def serialise(self, start: int) -> bytes:
        """Serialise the summary section, the footer and the closing magic.

        Args:
            start: Position of the summary section in the file.
        """
        section = bytearray()
        groups: list[SummaryOffset] = []
        statistics = Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(sorted(self.counts.items())),
            chunk_count=self.chunk_count,
            message_count=sum(self.counts.values()),
            message_start_time=self.start_time or 0,
            message_end_time=self.end_time,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )
        for opcode, records in (
            (Opcode.SCHEMA, serialise(*self.schemas.values())),
            (Opcode.CHANNEL, serialise(*self.channels)),
            (Opcode.STATISTICS, serialise(statistics)),
            (Opcode.CHUNK_INDEX, bytes(self._chunks)),
            (Opcode.ATTACHMENT_INDEX, serialise(*self.attachments)),
            (Opcode.METADATA_INDEX, serialise(*self.metadata)),
        ):
            if records:
                groups.append(SummaryOffset(opcode, start + len(section), len(records)))
                section += records
        offsets = start + len(section)
        section += serialise(*groups)
        # The checksum covers the footer up to the checksum itself, which is its last field.
        section += serialise(Footer(summary_start=start, summary_offset_start=offsets, summary_crc=0))[:-4]
        section += struct.pack("<I", zlib.crc32(section))
        return bytes(section + MAGIC)


def indexed(chunk: Chunk, offset: int, positions: Mapping[int, Sequence[int]]) -> tuple[bytearray, ChunkIndex]:
    """Serialise a chunk with its message index.

    Args:
        chunk: The chunk.
        offset: Its position in the file.
        positions: For each channel id a flat list with time and offset in the chunk of each message.

    Returns:
        The serialised records, and the index record of the chunk.
    """
    records = bytearray(serialise(chunk))
    length = len(records)
    offsets = {}
    for channel_id, entries in positions.items():
        if entries:
            offsets[channel_id] = offset + len(records)
            size = 8 * len(entries)
            records += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel_id, size)
            records += struct.pack(f"<{len(entries)}Q", *entries)
    return records, ChunkIndex(
        chunk_length=length,
        chunk_start_offset=offset,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=len(records) - length,
        message_index_offsets=offsets,
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )


def serialise(*records: McapRecord) -> bytes:
    """Serialise records, concatenated."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call] # mcap leaves out the return type
