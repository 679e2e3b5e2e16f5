"""The summary at the end of a log, gathered while the log is written."""

import struct
import zlib
from dataclasses import dataclass, field

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from symaware_cli.recording.schema import MAGIC


@dataclass(slots=True)
class Summary:
    """What a log holds and where.

    Attributes:
        schemas: By the name of the message.
        channels: In the order of their numbers, which start at 1.
        counts: Messages by number of the channel.
        attachments: In the order of the file.
        metadata: In the order of the file.
        start_time: The least log time, ns; None before the first chunk.
        end_time: The greatest log time, ns.
    """

    schemas: dict[str, Schema] = field(default_factory=dict)
    channels: list[Channel] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    start_time: int | None = None
    end_time: int = 0
    _chunks: bytearray = field(default_factory=bytearray)  # serialised, as there may be many
    _chunk_count: int = 0

    def add_chunk(self, chunk: ChunkIndex, counts: dict[int, int]) -> None:
        """Enter a chunk.

        Args:
            chunk: Where it stands.
            counts: Its messages by number of the channel.
        """
        self._chunks += serialise(chunk)
        self._chunk_count += 1
        if self.start_time is None:
            self.start_time = chunk.message_start_time
        self.end_time = chunk.message_end_time
        for channel_id, count in counts.items():
            self.counts[channel_id] = self.counts.get(channel_id, 0) + count

    def serialise(self, start: int) -> bytes:
        """Serialise the summary section, the footer and the closing magic.

        Args:
            start: Where in the file it will stand.
        """
        section = bytearray()
        groups: list[SummaryOffset] = []
        statistics = Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(sorted(self.counts.items())),
            chunk_count=self._chunk_count,
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


def serialise(*records: McapRecord) -> bytes:
    """Serialise records, one behind the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call] # mcap leaves out the return type
