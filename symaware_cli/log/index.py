"""Index of an MCAP file: the positions of its records, and functions to read records.

An `Index` is read from the summary at the end of a sound file, or built by `recovery.scan` if there is none.
"""

import io
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple, TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Footer,
    Header,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
)

from symaware_cli.log.log_schema import CHUNK_SIZE, LARGEST_CHUNK, LIBRARY, MAGIC, PROFILE
from symaware_cli.world import record

FRAME = struct.Struct("<BQ")
"""The head of a record: opcode and length."""

MESSAGE = struct.Struct("<BQHIQQ")
"""The head of a message record: opcode, length, channel, sequence, log time, publish time."""

MANY = 32 << 20
"""Maximum size of an unpacked chunk of another writer [bytes]; a larger one, unless it holds a single message, is
treated as damaged."""

LAST_TIME = (1 << 63) - 1
"""The greatest valid log time, ns (year 2262)."""

_CHUNK = struct.Struct("<QQQI")
_FOOTER_SIZE = FRAME.size + 20 + len(MAGIC)


class Unsound(Exception):  # noqa: N818 (never leaves this folder)
    """A record is damaged or malformed."""


@record
class ChannelInfo:
    """One channel of a log.

    Attributes:
        topic: Such as `/agents/robot/state`.
        schema: Full name of its message type, such as `symaware.v1.Rows`; empty if it has none.
        encoding: Serialisation of its messages; `protobuf` in SymAware logs.
        metadata: Such as `columns` and `units`.
        count: Number of messages in the log.
        rows: Number of rows that its messages can refer to; None if unknown.
        roster: Number of agents and entities that its messages can refer to by roster index; None if unknown.
        width: Number of columns of a row; None if unknown.
        message: The SymAware message type required on this topic, by its name in log.proto; None if unknown.
    """

    topic: str
    schema: str
    encoding: str
    metadata: dict[str, str]
    count: int
    rows: int | None = None
    roster: int | None = None
    width: int | None = None
    message: str | None = None

    def carries(self, message_name: str) -> bool:
        """Whether its messages have a SymAware type, by its name in log.proto."""
        return self.encoding == "protobuf" and self.schema == f"symaware.v1.{message_name}"


@record
class MessageRange:
    """A range of the file that holds messages: a chunk record, or consecutive records outside chunks.

    Attributes:
        offset: Position in the file.
        length: Length in bytes.
        start: The earliest log time in it, ns.
        end: The latest log time in it, ns.
        channels: The ids of its channels.
        chunk: Whether it is a chunk.
    """

    offset: int
    length: int
    start: int
    end: int
    channels: frozenset[int]
    chunk: bool = True


class RecordLocation(NamedTuple):
    """The position of an attachment or a metadata record.

    Attributes:
        name: Its name.
        offset: Position in the file.
        length: Length in bytes.
    """

    name: str
    offset: int
    length: int


@dataclass(slots=True)
class Index:
    """The positions of all records of a log file.

    Attributes:
        header: The header record, with profile and library of the writer.
        schemas: Schemas by id.
        channels: Channels by id.
        counts: Number of messages by channel id.
        spans: Ranges of messages, in file order.
        attachments: Attachments, in file order.
        metadata: Metadata records, in file order.
    """

    header: Header
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    spans: list[MessageRange] = field(default_factory=list)
    attachments: list[RecordLocation] = field(default_factory=list)
    metadata: list[RecordLocation] = field(default_factory=list)


def from_summary(file: BinaryIO, size: int) -> Index | None:
    """Read the index from the summary section.

    Args:
        file: The log.
        size: Its size in bytes.

    Returns:
        The index, or None if the summary is missing, damaged or incomplete, so that a scan is needed.

    Raises:
        Unsound: The file does not begin like an MCAP file.
    """
    index = Index(read_header(file))
    if size < len(MAGIC) + _FOOTER_SIZE:
        return None
    try:
        end = read_at(file, size - _FOOTER_SIZE, _FOOTER_SIZE)
        if end[-len(MAGIC) :] != MAGIC or FRAME.unpack_from(end) != (Opcode.FOOTER, 20):
            return None
        footer = parse(Footer, end[FRAME.size :])
        if not len(MAGIC) <= footer.summary_start < size - _FOOTER_SIZE:
            return None
        section = read_at(file, footer.summary_start, size - _FOOTER_SIZE - footer.summary_start)
        if footer.summary_crc and zlib.crc32(section + end[: FRAME.size + 16]) != footer.summary_crc:
            return None
        return index if _fill(index, section, footer.summary_start) else None
    except Unsound:
        return None


def _fill(index: Index, section: bytes, limit: int) -> bool:
    """Fill the index from the summary section, which begins at `limit`; return False if it is incomplete."""
    statistics = None
    chunks: list[ChunkIndex] = []
    for opcode, start, end in frames(section):
        content = section[start:end]
        match opcode:
            case Opcode.SCHEMA:
                schema = parse(Schema, content)
                index.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = parse(Channel, content)
                index.channels[channel.id] = channel
            case Opcode.STATISTICS:
                statistics = parse(Statistics, content)
            case Opcode.CHUNK_INDEX:
                chunks.append(parse(ChunkIndex, content))
            case Opcode.ATTACHMENT_INDEX:
                attachment = parse(AttachmentIndex, content)
                index.attachments.append(RecordLocation(attachment.name, attachment.offset, attachment.length))
            case Opcode.METADATA_INDEX:
                metadata = parse(MetadataIndex, content)
                index.metadata.append(RecordLocation(metadata.name, metadata.offset, metadata.length))
    if statistics is None:
        return False
    # A writer may omit the message index; the chunk may then contain any channel.
    anything = frozenset(index.channels)
    index.spans = [
        MessageRange(
            chunk.chunk_start_offset,
            chunk.chunk_length,
            chunk.message_start_time,
            chunk.message_end_time,
            frozenset(chunk.message_index_offsets) or anything,
        )
        for chunk in sorted(chunks, key=lambda chunk: chunk.chunk_start_offset)
    ]
    index.counts = statistics.channel_message_counts
    index.attachments.sort(key=lambda place: place.offset)
    index.metadata.sort(key=lambda place: place.offset)
    return (
        # Overlapping ranges would allow a small file to be read many times over.
        _apart([*index.spans, *index.attachments, *index.metadata], limit)
        and all(span.start <= span.end <= LAST_TIME for span in index.spans)
        and index.counts.keys() <= index.channels.keys()
        and {channel.schema_id for channel in index.channels.values()} <= index.schemas.keys() | {0}
        and statistics.chunk_count == len(index.spans)
        and statistics.attachment_count == len(index.attachments)
        and statistics.metadata_count == len(index.metadata)
        and bool(index.spans or not statistics.message_count)  # without chunks, only a scan finds the messages
    )


def _apart(places: Iterable[MessageRange | RecordLocation], end: int) -> bool:
    """Whether the given ranges do not overlap and all end before an offset."""
    position = len(MAGIC)
    for place in sorted(places, key=lambda place: place.offset):
        if place.offset < position or place.length < FRAME.size:
            return False
        position = place.offset + place.length
    return position <= end


def read_header(file: BinaryIO) -> Header:
    """Read the magic and the header record.

    Raises:
        Unsound: They are missing.
    """
    file.seek(0)
    beginning = file.read(len(MAGIC) + FRAME.size)
    if not beginning.startswith(MAGIC[: len(beginning)]):
        raise Unsound("it does not begin like an MCAP")
    if len(beginning) < len(MAGIC) + FRAME.size:
        raise Unsound("it breaks off in its first record")
    opcode, length = FRAME.unpack_from(beginning, len(MAGIC))
    if opcode != Opcode.HEADER or length > 1 << 20:
        raise Unsound("the header is not one")
    return parse(Header, read_at(file, len(beginning), length))


def read_at(file: BinaryIO, offset: int, length: int) -> bytes:
    """Read exactly `length` bytes.

    Raises:
        Unsound: The file is shorter.
    """
    file.seek(offset)
    data = file.read(length)
    if len(data) != length:
        raise Unsound("the file ends in the middle of a record")
    return data


def frames(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the content of each of several consecutive records.

    Raises:
        Unsound: A record exceeds the data.
    """
    position, end = 0, len(data)
    while position < end:
        if position + FRAME.size > end:
            raise Unsound("a record is cut off")
        opcode, length = FRAME.unpack_from(data, position)
        start = position + FRAME.size
        position = start + length
        if position > end:
            raise Unsound("a record is cut off")
        yield opcode, start, position


_Record = TypeVar("_Record", bound=McapRecord)


def parse(kind: type[_Record], content: bytes) -> _Record:
    """Parse the content of a record.

    Raises:
        Unsound: The content is malformed.
    """
    try:
        record: _Record = kind.read(ReadDataStream(io.BytesIO(content)))  # type: ignore[attr-defined]
    except (McapError, struct.error, ValueError, OverflowError) as error:
        raise Unsound(f"a broken {kind.__name__} record") from error
    return record


def read_record(file: BinaryIO, offset: int, length: int, kind: type[_Record], opcode: Opcode) -> _Record:
    """Read a record of a known kind.

    Args:
        file: The log.
        offset: Position of the record.
        length: Length of the whole record, bytes.
        kind: Its class.
        opcode: Its opcode.

    Raises:
        Unsound: There is a different record, or its checksum is wrong.
    """
    if FRAME.unpack(read_at(file, offset, FRAME.size)) != (opcode, length - FRAME.size):
        raise Unsound(f"no {kind.__name__} record at {offset}")
    content = read_at(file, offset + FRAME.size, length - FRAME.size)
    if kind is Attachment:
        (checksum,) = struct.unpack("<I", content[-4:].rjust(4))
        if checksum and zlib.crc32(content[:-4]) != checksum:
            raise Unsound("the checksum of an attachment is wrong")
    return parse(kind, content)


def read_span(file: BinaryIO, span: MessageRange, header: Header) -> bytes:
    """Read the records of a range of messages, unpacked and checked.

    Args:
        file: The log.
        span: The range.
        header: The header of the file.

    Raises:
        Unsound: The records are damaged.
    """
    data = read_at(file, span.offset, span.length)
    if not span.chunk:
        return data
    if len(data) < FRAME.size or FRAME.unpack_from(data) != (Opcode.CHUNK, len(data) - FRAME.size):
        raise Unsound(f"no chunk at {span.offset}")
    return unpack(data[FRAME.size :], header)


def unpack(content: bytes, header: Header) -> bytes:
    """Unpack and check the content of a chunk record.

    Args:
        content: The content.
        header: The header of the file; chunks of SymAware logs are small, unless they hold a single large message.

    Raises:
        Unsound: The chunk is damaged, or its compression is unknown.
    """
    try:
        _, _, size, checksum = _CHUNK.unpack_from(content)
        start = _CHUNK.size + 4
        (length,) = struct.unpack_from("<I", content, _CHUNK.size)
        compression = content[start : start + length]
        start += length
        (length,) = struct.unpack_from("<Q", content, start)
        packed = content[start + 8 : start + 8 + length]
        if len(packed) != length or size > LARGEST_CHUNK:
            raise Unsound("a chunk has an impossible size")
        if compression == b"zstd":
            # Bounded by the size that the chunk declares, whatever the frame inside declares.
            claimed = zstandard.get_frame_parameters(packed).content_size if packed else 0
            if claimed not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise Unsound("a chunk has an impossible size")
            data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size) if packed else b""
        elif compression == b"lz4":
            import lz4.frame  # only needed for logs of other writers

            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        elif compression == b"":
            data = packed
        else:
            raise Unsound(f"a chunk is compressed by {compression.decode(errors='replace')}, which is unknown here")
    except (struct.error, zstandard.ZstdError, RuntimeError, MemoryError, EOFError) as error:
        raise Unsound("a chunk cannot be unpacked") from error
    if len(data) != size or (checksum and zlib.crc32(data) != checksum):
        raise Unsound("the checksum of a chunk is wrong")
    ours = (header.profile, header.library) == (PROFILE, LIBRARY)
    if size > (CHUNK_SIZE if ours else MANY) and FRAME.unpack_from(data) != (Opcode.MESSAGE, size - FRAME.size):
        raise Unsound("a chunk has an impossible size")
    return data
