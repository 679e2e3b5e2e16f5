"""Encodes and decodes the large messages of a log without a Python object per number.

The encoding equals that of the generated classes, byte for byte; a message with a different field layout is decoded
with the generated class. A packed `repeated double` is a tag, a length and the array's little-endian bytes, so an array
is written with one copy and read with none. Beliefs about others are in `others_message`.

Rows are indices in a group, ascending; `None` stands for every row in order.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from google.protobuf.message import Message
from numpy.typing import ArrayLike, NDArray

from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.world import record

CODE = np.dtype("u1")
FLOAT = np.dtype("<f8")
INDEX = np.dtype("<u4")
TIME = np.dtype("<i8")
VARINT = 0
BYTES = 2

#: How many tags with lengths are kept: the messages of a channel mostly have the same ones.
_KEPT = 256


def varint(number: int) -> bytes:
    """Encode an integer as a varint, seven bits per byte."""
    if number < 0x80:
        return bytes((number,))
    out = bytearray()
    while number >= 0x80:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


@lru_cache(_KEPT)
def number_field(field: int, number: int) -> bytes:
    """Encode a varint field; empty if the number is 0, as in proto3."""
    return bytes((field << 3 | VARINT,)) + varint(number) if number else b""


def text_field(field: int, text: str) -> bytes:
    """Encode a text field."""
    data = text.encode()
    return bytes((field << 3 | BYTES,)) + varint(len(data)) + data


@lru_cache(_KEPT)
def _head(field: int, length: int) -> bytes:
    """Encode what precedes the content of a field of some bytes; empty if there are none."""
    return bytes((field << 3 | BYTES,)) + varint(length) if length else b""


def packed(field: int, values: ArrayLike, dtype: np.dtype[Any]) -> bytes:
    """Encode a packed field of fixed width; empty if there are no values."""
    data = np.asarray(values, dtype).tobytes()
    return _head(field, len(data)) + data


@lru_cache(_KEPT)
def _table_head(columns: int, length: int) -> bytes:
    """Encode what precedes the bytes of the values of all rows."""
    return number_field(1, columns) + _head(3, length)


@lru_cache(_KEPT)
def _length_field(field: int, length: int) -> bytes:
    """Encode the length that all rows share."""
    return packed(field, (length,), INDEX)


@lru_cache(_KEPT)
def _series_head(columns: int, points: int) -> bytes:
    """Encode what precedes the bytes of the times that the series of all rows share."""
    return number_field(1, columns) + _length_field(3, points) + _head(4, points * TIME.itemsize)


def rows_field(field: int, rows: ArrayLike | None, count: int) -> bytes:
    """Encode the field of the rows that are present; empty for all rows."""
    if rows is None:
        return b""
    if np.shape(rows) != (count,):
        raise ValueError(f"{count} rows of values for the rows {rows}")
    return packed(field, rows, INDEX)


def fields_of(data: bytes | memoryview, first: int = VARINT, several: int = 0) -> dict[int, Any] | None:
    """Split a message into its fields, by number: an integer, or a view of the bytes of a packed field.

    Args:
        data: The message.
        first: The wire type of the first field; every other field is packed.
        several: A field that may occur several times, whose value is a list; 0 for none.

    Returns:
        The fields; None if the layout differs (a field is repeated, not packed, or of an unknown type).
    """
    fields: dict[int, Any] = {}
    view = memoryview(data)
    position, end = 0, len(data)
    try:
        while position < end:
            tag = data[position]
            number, shift, position = 0, 0, position + 1
            while True:
                byte = data[position]
                position += 1
                number |= (byte & 0x7F) << shift
                if byte < 0x80:
                    break
                shift += 7
            field, kind = tag >> 3, tag & 7
            if tag >= 0x80 or (field in fields and field != several) or kind != (first if field == 1 else BYTES):
                return None
            if kind == VARINT:
                fields[field] = number
            elif position + number > end:
                return None
            else:
                content = view[position : position + number]
                if field == several:
                    fields.setdefault(field, []).append(content)
                else:
                    fields[field] = content
                position += number
    except IndexError:
        return None
    return fields


def message_fields(
    data: bytes | memoryview, kind: type[Message], first: int = VARINT, several: int = 0
) -> dict[int, Any]:
    """As `fields_of`; a message with another layout is decoded by protobuf, and has the values of a ``kind``."""
    fields = fields_of(data, first, several)
    if fields is None:
        message = kind.FromString(bytes(data))
        fields = {field.number: getattr(message, field.name) for field in kind.DESCRIPTOR.fields}
    return fields


def array_of(fields: dict[int, Any], field: int, dtype: np.dtype[Any], columns: int | None = None) -> NDArray[Any]:
    """Return the array in a field, flat, or (rows, columns) if it has columns."""
    content = fields.get(field, b"")
    flat = np.frombuffer(content, dtype) if isinstance(content, bytes | memoryview) else np.array(content, dtype)
    if columns is None:
        return flat
    if not columns:
        return flat.reshape(0, 0)
    return flat.reshape(-1, columns)


def indices_of(fields: dict[int, Any], field: int) -> NDArray[np.uint32] | None:
    """Return the rows in a field; None for all."""
    rows = array_of(fields, field, INDEX)
    return rows if len(rows) else None


def table_of(values: ArrayLike) -> NDArray[Any]:
    """Check that values have the shape (rows, columns), and return them as an array."""
    table = np.asarray(values)
    if table.ndim != 2:
        raise ValueError(f"values must be (rows, columns); got {table.shape}")
    return table


@record
class Rows:
    """A value for each row.

    Attributes:
        rows: (m,) indices, or None for all.
        values: (m, columns).
    """

    rows: NDArray[np.uint32] | None
    values: NDArray[np.float64]


@record
class SeriesRows:
    """A time series for each row.

    Attributes:
        rows: (m,) indices, or None for all.
        lengths: (m,) number of points of each row, or (1,) for all.
        times: ns; (lengths[0],) if the rows share them, otherwise (sum of lengths,).
        values: (points, columns), one row's series after another.
    """

    rows: NDArray[np.uint32] | None
    lengths: NDArray[np.uint32]
    times: NDArray[np.int64]
    values: NDArray[np.float64]

    def __iter__(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Yield the times (k,) and values (k, columns) of each row."""
        if len(self.lengths) == 1:
            length = int(self.lengths[0])
            # An empty series does not determine how many rows share it, unless the rows are listed.
            count = len(self.values) // length if length else len(self.rows) if self.rows is not None else 0
            for row in range(count):
                yield self.times, self.values[row * length : (row + 1) * length]
            return
        ends = np.cumsum(self.lengths, dtype=np.int64).tolist()
        for start, end in zip([0, *ends], ends, strict=False):
            yield self.times[start:end], self.values[start:end]

    def at(self, place: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the times (k,) and values (k, columns) of the row at a position in the message."""
        if len(self.lengths) == 1:
            length = int(self.lengths[0])
            return self.times, self.values[place * length : (place + 1) * length]
        start, end = (int(self.lengths[:count].sum(dtype=np.int64)) for count in (place, place + 1))
        return self.times[start:end], self.values[start:end]


@record
class TableRows:
    """A table for each row.

    Attributes:
        rows: (m,) indices, or None for all.
        lengths: (m,) number of entries of each row.
        values: (entries, columns), one row's entries after another.
    """

    rows: NDArray[np.uint32] | None
    lengths: NDArray[np.uint32]
    values: NDArray[np.float64]

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield the entries (k, columns) of each row."""
        ends = np.cumsum(self.lengths, dtype=np.int64).tolist()
        for start, end in zip([0, *ends], ends, strict=False):
            yield self.values[start:end]

    def at(self, place: int) -> NDArray[np.float64]:
        """Return the entries (k, columns) of the row at a position in the message."""
        start, end = (int(self.lengths[:count].sum(dtype=np.int64)) for count in (place, place + 1))
        return self.values[start:end]


def encode_rows(values: ArrayLike, rows: ArrayLike | None = None) -> bytes:
    """Encode a `Rows` message.

    Args:
        values: (m, columns).
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes are inconsistent.
    """
    table = table_of(values)
    if rows is None:
        data = np.asarray(table, FLOAT).tobytes()
        return _table_head(table.shape[1], len(data)) + data
    return b"".join((number_field(1, table.shape[1]), rows_field(2, rows, len(table)), packed(3, table, FLOAT)))


def encode_series(
    times: ArrayLike, values: ArrayLike, lengths: ArrayLike | None = None, rows: ArrayLike | None = None
) -> bytes:
    """Encode a `SeriesRows` message.

    Args:
        times: ns; (k,) shared by all rows, or (sum of lengths,) one row's after another.
        values: (m, k, columns), or (sum of lengths, columns) if the rows have separate times.
        lengths: (m,) number of points of each row, or None if the rows share the times.
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes are inconsistent.
    """
    table = np.asarray(values)
    points = np.shape(times)
    if lengths is None:
        if table.ndim != 3 or points != (table.shape[1],):
            raise ValueError(f"values must be (rows, points, columns); got {table.shape} with times {points}")
        if rows is None:
            head, instants = _series_head(table.shape[2], points[0]), np.asarray(times, TIME).tobytes()
            return b"".join((head, instants, packed(5, table, FLOAT)))
        count = len(table)
        length_field = _length_field(3, points[0])
    else:
        count = len(np.asarray(lengths))
        if table.ndim != 2 or points != (len(table),) or np.sum(lengths) != len(table):
            raise ValueError(f"values must be (points, columns); got {table.shape} with times {points}")
        length_field = packed(3, lengths, INDEX)
    return b"".join(
        (
            number_field(1, table.shape[-1]),
            rows_field(2, rows, count),
            length_field,
            packed(4, times, TIME),
            packed(5, table, FLOAT),
        )
    )


def encode_tables(values: ArrayLike, lengths: ArrayLike, rows: ArrayLike | None = None) -> bytes:
    """Encode a `TableRows` message.

    Args:
        values: (sum of lengths, columns), one row's entries after another.
        lengths: (m,) number of entries of each row.
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes are inconsistent.
    """
    table = table_of(values)
    if np.sum(lengths) != len(table):
        raise ValueError(f"{np.sum(lengths)} entries are announced, {len(table)} given")
    return b"".join(
        (
            number_field(1, table.shape[1]),
            rows_field(2, rows, np.size(lengths)),
            packed(3, lengths, INDEX),
            packed(4, table, FLOAT),
        )
    )


def decode_rows(data: bytes) -> Rows:
    """Decode a `Rows` message; its arrays are read-only views of the data where possible."""
    fields = message_fields(data, v1.Rows)
    columns = fields.get(1, 0)
    return Rows(indices_of(fields, 2), array_of(fields, 3, FLOAT, columns))


def decode_series(data: bytes) -> SeriesRows:
    """Decode a `SeriesRows` message."""
    fields = message_fields(data, v1.SeriesRows)
    return SeriesRows(
        indices_of(fields, 2),
        array_of(fields, 3, INDEX),
        array_of(fields, 4, TIME),
        array_of(fields, 5, FLOAT, fields.get(1, 0)),
    )


def decode_tables(data: bytes) -> TableRows:
    """Decode a `TableRows` message."""
    fields = message_fields(data, v1.TableRows)
    return TableRows(indices_of(fields, 2), array_of(fields, 3, INDEX), array_of(fields, 4, FLOAT, fields.get(1, 0)))


def encode_message_columns(
    senders: ArrayLike,
    receivers: ArrayLike,
    sequences: ArrayLike,
    reason: ArrayLike | None = None,
    says: ArrayLike | None = None,
    sizes: ArrayLike | None = None,
    rows: ArrayLike | None = None,
) -> bytes:
    """Encode the long columns of a `MessageColumns` message; its other fields may precede or follow them.

    Args:
        senders: (m,) indices in the roster.
        receivers: (m,) indices in the roster.
        sequences: (m,) the number of each message among those of its sender.
        reason: (m,) indices in the message's `reasons`; None if nothing was dropped.
        says: (s,) roster indices of the senders of payloads; None if payloads are not repeated.
        sizes: (m,) bytes; None if all are the same.
        rows: (m,) indices in `says`; None if no sender has several payloads.
    """
    return b"".join(
        (
            packed(5, senders, INDEX),
            packed(6, receivers, INDEX),
            packed(7, sequences, INDEX),
            b"" if reason is None else packed(9, reason, INDEX),
            b"" if says is None else packed(10, says, INDEX),
            b"" if sizes is None else packed(12, sizes, INDEX),
            b"" if rows is None else packed(13, rows, INDEX),
        )
    )
