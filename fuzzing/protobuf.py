"""Changes protobuf messages without regard to their meaning."""

from __future__ import annotations

import struct
from random import Random

_VARINTS = (0, 1, 2, 127, 128, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**40, 2**63 - 1, 2**63, 2**64 - 1)
_DOUBLES = (0.0, -1.0, 1e9, 1e300, -1e308, 1e-320, float("nan"), float("inf"), float("-inf"))


def altered_message(data: bytes, chance: Random) -> bytes:
    """Change a message: its bytes, its fields, or the numbers in them."""
    kind = chance.randrange(10)
    if kind == 0:
        return chance.choice([b"", b"\x08\x01", chance.randbytes(chance.randrange(60)), b"\x0b" * 200, b"\xff" * 40])
    if kind == 1 and data:
        at = chance.randrange(len(data))
        return data[:at] + chance.choice([b"", chance.randbytes(3)]) + data[at + chance.randrange(4) :]
    fields = _fields(data)
    if not fields:
        return data + chance.randbytes(5)
    place = chance.randrange(len(fields))
    number, wire, content = fields[place]
    match chance.randrange(6):
        case 0:
            del fields[place]
        case 1:
            fields.append(fields[place])
        case 2:
            fields[place] = (chance.randrange(1, 16), wire, content)
        case _:
            fields[place] = (number, wire, _content(wire, content, chance))
    return b"".join(map(_encoded, fields))


def _content(wire: int, content: bytes, chance: Random) -> bytes:
    """Replace, remove or add numbers in a field."""
    if wire == 0:
        return _varint(chance.choice(_VARINTS))
    if wire in (1, 5):
        return struct.pack("<d", chance.choice(_DOUBLES))[-len(content) :]
    altered = bytearray(content)
    match chance.randrange(6):
        case 0:
            return content[: chance.randrange(len(content) + 1) // 8 * 8]
        case 1:
            return content + content[:8]
        case 2:
            return content * chance.choice([2, 20])
        case 3 if len(content) >= 8:
            altered[-8:] = struct.pack("<d", chance.choice(_DOUBLES))
        case 4 if len(content) >= 4:
            at = chance.randrange(len(content) // 4) * 4
            altered[at : at + 4] = struct.pack("<I", chance.choice([0, 1, 2, 3, 100, 65_536, 2**31, 2**32 - 1]))
        case _:
            return altered_message(content, chance) if content else b"\0" * 8
    return bytes(altered)


def _fields(data: bytes) -> list[tuple[int, int, bytes]]:
    """The number, wire type and content of each field, as far as the message can be parsed."""
    fields: list[tuple[int, int, bytes]] = []
    place = 0
    try:
        while place < len(data):
            tag, place = _read(data, place)
            wire = tag & 7
            if wire == 0:
                start = place
                _, place = _read(data, place)
            elif wire == 2:
                length, start = _read(data, place)
                place = start + length
            elif wire in (1, 5):
                start = place
                place += 8 if wire == 1 else 4
            else:
                return fields
            if place > len(data):
                return fields
            fields.append((tag >> 3, wire, data[start:place]))
    except IndexError:
        pass
    return fields


def _encoded(field: tuple[int, int, bytes]) -> bytes:
    number, wire, content = field
    return _varint(number << 3 | wire) + (_varint(len(content)) if wire == 2 else b"") + content


def _read(data: bytes, place: int) -> tuple[int, int]:
    number = shift = 0
    while True:
        number |= (data[place] & 0x7F) << shift
        place += 1
        if data[place - 1] < 0x80 or shift > 63:
            return number, place
        shift += 7


def _varint(number: int) -> bytes:
    out = bytearray()
    while number >= 0x80:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)
