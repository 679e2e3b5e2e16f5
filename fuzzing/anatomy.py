"""Splits a log into its records, and assembles them again with new checksums, lengths and indices."""

from __future__ import annotations

import copy
import io
import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Metadata, MetadataIndex, Schema

from symaware_cli.log.log_schema import MAGIC
from symaware_cli.log.log_summary import LogSummary, indexed

_MESSAGE = struct.Struct("<BQHIQQ")


class Told(NamedTuple):
    """A message in a log."""

    channel: int
    sequence: int
    time: int
    data: bytes


@dataclass
class Packing:
    """Falsified fields of one chunk; None for correct ones.

    Attributes:
        compression: The declared compression.
        data: The compressed records.
        size: The declared uncompressed size [bytes].
        crc: The declared checksum.
        start: The declared least time.
        end: The declared greatest time.
    """

    compression: str | None = None
    data: bytes | None = None
    size: int | None = None
    crc: int | None = None
    start: int | None = None
    end: int | None = None


@dataclass
class Anatomy:
    """The parts of a log.

    Attributes:
        header: The header.
        schemas: The schemas, in the order of the file.
        channels: The channels, in the order of the file.
        attachments: The attachments, in the order of the file.
        chunks: The messages of each chunk.
        metadata: The metadata, in the order of the file.
        packing: The falsified fields of chunks, by the number of the chunk.
        summary: Whether there is a summary.
    """

    header: Header
    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    chunks: list[list[Told]] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    packing: dict[int, Packing] = field(default_factory=dict)
    summary: bool = True

    def copy(self) -> Anatomy:
        """A deep copy."""
        return copy.deepcopy(self)

    def topic(self, channel: int) -> str:
        """The topic of a channel by its number; empty if there is none."""
        return next((each.topic for each in self.channels if each.id == channel), "")


def take_apart(log: bytes, per_chunk: int = 60) -> Anatomy:
    """Split a valid log, without /timing, which differs between runs, and with new chunks.

    Args:
        log: The log.
        per_chunk: The number of messages in each new chunk.
    """
    reader = make_reader(io.BytesIO(log))
    summary = reader.get_summary()
    assert summary is not None
    anatomy = Anatomy(
        reader.get_header(),
        schemas=list(summary.schemas.values()),
        channels=list(summary.channels.values()),
        attachments=list(reader.iter_attachments()),
        metadata=list(reader.iter_metadata()),
    )
    told = [
        Told(message.channel_id, message.sequence, message.log_time, message.data)
        for _, channel, message in reader.iter_messages()
        if channel.topic != "/timing"
    ]
    told.sort(key=lambda each: (each.time, each.sequence))
    anatomy.chunks = [told[place : place + per_chunk] for place in range(0, len(told), per_chunk)]
    for attachment in anatomy.attachments:
        attachment.create_time = attachment.log_time = 0
    # Wall times differ between runs as well.
    for record in anatomy.metadata:
        record.metadata = {key: value for key, value in record.metadata.items() if "time" not in key}
    return anatomy


def put_together(anatomy: Anatomy) -> bytes:
    """Write a log with correct checksums, lengths and index, except for the fields in `packing`."""
    out = bytearray(MAGIC + _serialised([anatomy.header, *anatomy.schemas, *anatomy.channels]))
    summary = LogSummary(
        schemas={str(number): schema for number, schema in enumerate(anatomy.schemas)},
        channels=list(anatomy.channels),
    )
    for attachment in anatomy.attachments:
        record = _serialised([attachment])
        summary.add_attachment(attachment, len(out), len(record))
        out += record
    for number, messages in enumerate(anatomy.chunks):
        packed = anatomy.packing.get(number, Packing())
        records = bytearray()
        positions: dict[int, list[int]] = {}
        for each in messages:
            positions.setdefault(each.channel, []).extend((each.time, len(records)))
            length = _MESSAGE.size - 9 + len(each.data)
            records += _MESSAGE.pack(5, length, each.channel, each.sequence, each.time, each.time) + each.data
        times = [each.time for each in messages]
        compression = packed.compression if packed.compression is not None else "zstd"
        chunk = Chunk(
            compression=compression,
            data=packed.data if packed.data is not None else _packed(bytes(records), compression),
            message_start_time=min(times, default=0) if packed.start is None else packed.start,
            message_end_time=max(times, default=0) if packed.end is None else packed.end,
            uncompressed_crc=zlib.crc32(records) if packed.crc is None else packed.crc,
            uncompressed_size=len(records) if packed.size is None else packed.size,
        )
        content, index = indexed(chunk, len(out), positions)
        out += content
        summary.add_chunk(index, {channel: len(entries) // 2 for channel, entries in positions.items()})
    for metadata in anatomy.metadata:
        record = _serialised([metadata])
        summary.metadata.append(MetadataIndex(len(out), len(record), metadata.name))
        out += record
    out += _serialised([DataEnd(data_section_crc=0)])
    return bytes(out + summary.serialise(len(out))) if anatomy.summary else bytes(out)


def _packed(records: bytes, compression: str) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=1).compress(records)
    if compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.compress(records))
    return records


def _serialised(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
