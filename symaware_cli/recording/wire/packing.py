"""Protobuf fields as bytes: packed arrays of fixed width.

A packed `repeated double` is a tag, a length and the array's little-endian bytes, so an array is written with one copy
and read with none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FLOAT = np.dtype("<f8")
INDEX = np.dtype("<u4")
TIME = np.dtype("<i8")
VARINT = 0
BYTES = 2


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


def number_field(field: int, number: int) -> bytes:
    """Encode a varint field; empty if the number is 0, as in proto3."""
    return bytes((field << 3 | VARINT,)) + varint(number) if number else b""


def text_field(field: int, text: str) -> bytes:
    """Encode a text field."""
    data = text.encode()
    return bytes((field << 3 | BYTES,)) + varint(len(data)) + data


def packed(field: int, values: ArrayLike, dtype: np.dtype[Any]) -> bytes:
    """Encode a packed field of fixed width; empty if there are no values."""
    data = np.asarray(values, dtype).tobytes()
    return bytes((field << 3 | BYTES,)) + varint(len(data)) + data if data else b""


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
