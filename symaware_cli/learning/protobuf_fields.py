"""The wire format of Protocol Buffers: bounded reading, and writing, of the fields of a message.

The format is that of https://protobuf.dev/programming-guides/encoding.

Reasons: docs/decisions/0089-policies.md
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from typing import NamedTuple

#: The kinds of fields that are read, by their number in the wire format.
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5


class FieldError(ValueError):
    """The bytes are no valid message; the text contains the position of the problem in the file."""


class WireField(NamedTuple):
    """A field of a message.

    Attributes:
        number: The number of the field.
        kind: `VARINT`, `FIXED64`, `BYTES` or `FIXED32`.
        value: An unsigned integer, or the content.
        start: The position of the content in the file.
    """

    number: int
    kind: int
    value: int | memoryview
    start: int


class FieldReader:
    """Reads messages of one file, up to a limit of fields.

    Attributes:
        left: The number of fields that may still be read.
    """

    def __init__(self, content: bytes, most: int) -> None:
        self._content = memoryview(content)
        self.left = most

    @property
    def whole(self) -> WireField:
        """The file as a message."""
        return WireField(0, BYTES, self._content, 0)

    def fields(self, message: WireField) -> Iterator[WireField]:
        """Yield the fields of a message.

        Raises:
            FieldError: The message ends within a field, or has bytes that are no field.
        """
        content = content_of(message)
        at, end = 0, len(content)
        while at < end:
            self.left -= 1
            if self.left < 0:
                raise FieldError("it has too many fields")
            begin = message.start + at
            key, at = self._varint(content, at, message.start)
            number, kind = key >> 3, key & 7
            if not 1 <= number < 1 << 29:
                raise FieldError(f"byte {begin}: no field has the number {number}")
            value: int | memoryview
            match kind:
                case 0:
                    value, at = self._varint(content, at, message.start)
                    start = message.start + at
                case 1 | 5:
                    size = 8 if kind == FIXED64 else 4
                    if at + size > end:
                        raise FieldError(f"byte {begin}: the file or message ends within a field")
                    start = message.start + at
                    value, at = int.from_bytes(content[at : at + size], "little"), at + size
                case 2:
                    size, at = self._varint(content, at, message.start)
                    if size > end - at:
                        raise FieldError(f"byte {begin}: a field of {size} bytes, of which {end - at} are there")
                    start = message.start + at
                    value, at = content[at : at + size], at + size
                case _:
                    raise FieldError(f"byte {begin}: a field of the unknown kind {kind}")
            yield WireField(number, kind, value, start)

    @staticmethod
    def _varint(content: memoryview, at: int, start: int) -> tuple[int, int]:
        """Return the number at a position, and the position after it."""
        value = 0
        for place in range(10):
            if at + place >= len(content):
                raise FieldError(f"byte {start + at}: the file or message ends within a number")
            byte = content[at + place]
            value |= (byte & 0x7F) << 7 * place
            if byte < 0x80:
                return value & (1 << 64) - 1, at + place + 1
        raise FieldError(f"byte {start + at}: a number of more than ten bytes")


def content_of(field: WireField) -> memoryview:
    """Return the content of a field that is a message, a text or bytes.

    Raises:
        FieldError: The field is a number.
    """
    if isinstance(field.value, int):
        raise FieldError(f"byte {field.start}: field {field.number} is a number where content is expected")
    return field.value


def text_of(field: WireField) -> str:
    """Return the text of a field.

    Raises:
        FieldError: The field is no text, or longer than 1,000 bytes.
    """
    content = content_of(field)
    if len(content) > 1000:
        raise FieldError(f"byte {field.start}: a name of {len(content)} bytes")
    try:
        return bytes(content).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FieldError(f"byte {field.start}: a name that is not UTF-8") from error


def integer_of(field: WireField) -> int:
    """Return the signed integer of a field.

    Raises:
        FieldError: The field is no integer.
    """
    if field.kind != VARINT or not isinstance(field.value, int):
        raise FieldError(f"byte {field.start}: field {field.number} is no integer")
    return _signed(field.value)


def integers_of(field: WireField, most: int) -> list[int]:
    """Return the signed integers of a repeated field: a single one, or several that are packed.

    Raises:
        FieldError: The field has no integers, or more than `most`.
    """
    if field.kind == VARINT:
        return [integer_of(field)]
    content, at = content_of(field), 0
    found: list[int] = []
    while at < len(content):
        value, at = FieldReader._varint(content, at, field.start)
        if len(found) == most:
            raise FieldError(f"byte {field.start}: more than {most} integers")
        found.append(_signed(value))
    return found


def float_of(field: WireField) -> float:
    """Return the number of a field of single precision.

    Raises:
        FieldError: The field is no number of 32 bits.
    """
    if field.kind != FIXED32 or not isinstance(field.value, int):
        raise FieldError(f"byte {field.start}: field {field.number} is no number of 32 bits")
    (found,) = struct.unpack("<f", field.value.to_bytes(4, "little"))
    return float(found)


def _signed(value: int) -> int:
    return value - (1 << 64) if value >> 63 else value


def varint(value: int) -> bytes:
    """Write an integer, of 64 bits if it is negative."""
    value &= (1 << 64) - 1
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def message(fields: Iterable[tuple[int, int | float | str | bytes]]) -> bytes:
    """Write a message of fields: an integer, a number of single precision, a text, or bytes, by their numbers."""
    found = bytearray()
    for number, value in fields:
        if isinstance(value, int):
            found += varint(number << 3 | VARINT) + varint(value)
        elif isinstance(value, float):
            found += varint(number << 3 | FIXED32) + struct.pack("<f", value)
        else:
            content = value.encode() if isinstance(value, str) else value
            found += varint(number << 3 | BYTES) + varint(len(content)) + content
    return bytes(found)
