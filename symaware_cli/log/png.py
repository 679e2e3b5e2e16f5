"""Deterministic PNG encoder (ISO/IEC 15948), and a decoder for its images.

The only filter used is "up", the difference from the row above.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_UP = 2
#: Colour types: greyscale, and RGB.
_GREY, _COLOUR = 0, 2


def encode(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Encode an image.

    Args:
        image: (height, width, 3) of uint8, or (height, width) of uint16.

    Raises:
        ValueError: The array has a different shape or type.
    """
    if not image.size or (image.ndim, image.dtype.name) not in ((3, "uint8"), (2, "uint16")):
        raise ValueError(f"not an image: an array {image.shape} of {image.dtype}")
    height, width = image.shape[:2]
    depth, kind = (8, _COLOUR) if image.ndim == 3 else (16, _GREY)
    rows = np.frombuffer(image.astype(image.dtype.newbyteorder(">")).tobytes(), np.uint8).reshape(height, -1)
    above = np.concatenate([np.zeros_like(rows[:1]), rows[:-1]])
    lines = np.concatenate([np.full((height, 1), _UP, np.uint8), rows - above], axis=1)
    header = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)
    return _SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(lines.tobytes(), 6)) + _chunk(b"IEND")


def size(data: bytes) -> tuple[int, int]:
    """Return width and height of any PNG.

    Raises:
        ValueError: It is not a PNG.
    """
    if data[:8] != _SIGNATURE or len(data) < 24:
        raise ValueError("not a PNG")
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def decode(data: bytes) -> NDArray[Any]:
    """Decode an image that `encode` produced; other PNGs need another library.

    Raises:
        ValueError: It is not such an image.
    """
    try:
        if data[:8] != _SIGNATURE:
            raise ValueError("not a PNG")
        width, height, depth, kind = struct.unpack(">IIBB", data[16:26])
        length = int.from_bytes(data[33:37], "big")
        lines = np.frombuffer(zlib.decompress(data[41 : 41 + length]), np.uint8).reshape(height, -1)
    except (struct.error, zlib.error) as error:
        raise ValueError("a damaged PNG") from error
    if (depth, kind) not in ((8, _COLOUR), (16, _GREY)) or (lines[:, 0] != _UP).any():
        raise ValueError("a PNG of another program")
    rows = np.ascontiguousarray(np.cumsum(lines[:, 1:], axis=0, dtype=np.uint8))
    if kind == _COLOUR:
        return rows.reshape(height, width, 3)
    return rows.view(">u2").astype(np.uint16).reshape(height, width)


def _chunk(name: bytes, data: bytes = b"") -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
