"""Pictures of maps, PGM and PNG, as grey levels; bounded and checked before they are decoded.

PGM (netpbm's `pgm`, plain and raw) is read here. The chunks of a PNG file (ISO/IEC 15948) are checked here, and those
that hold the picture are given to Pillow, so that no other chunk reaches a library.
"""

from __future__ import annotations

import io
import re
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from symaware_cli.maps.map_error import MapError

#: The greatest number of pixels of a picture: a square of 100 m at 5 cm.
MOST_PIXELS = 4_000_000
#: The greatest size of its file [bytes]: text of 4 characters for each pixel of a plain PGM, and some more.
MOST_BYTES = 5 * MOST_PIXELS

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
#: The chunks that hold the picture.
_CRITICAL = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
#: Bit depths by colour type: greyscale, RGB, palette, greyscale with alpha, RGB with alpha.
_DEPTHS = {0: (1, 2, 4, 8), 2: (8,), 3: (1, 2, 4, 8), 4: (8,), 6: (8,)}
#: A word of the head of a PGM file, after white space and comments.
_WORD = re.compile(rb"(?:\s|#[^\n]*\n)*([^\s#]+)")
_HEAD = 10_000

Grey = NDArray[np.float64]


def read_picture(content: bytes, suffix: str) -> tuple[Grey, NDArray[np.bool_]]:
    """Return the grey levels of a picture from 0 (black) to 1 (white), and which pixels are transparent.

    The level of a coloured pixel is the mean of its red, green and blue.

    Args:
        content: The file.
        suffix: The suffix of its name, `.pgm` or `.png`, in lower case.

    Returns:
        Both of shape (height, width), the upper row first.

    Raises:
        MapError: It is damaged, too large, or of another format.
    """
    if len(content) > MOST_BYTES:
        raise MapError(f"it is larger than {MOST_BYTES // 1_000_000} MB")
    if suffix == ".pgm":
        grey = _pgm(content)
        return grey, np.zeros(grey.shape, bool)
    if suffix == ".png":
        return _png(content)
    raise MapError("it is neither a .pgm nor a .png file")


def _check_size(width: int, height: int) -> None:
    if width < 1 or height < 1:
        raise MapError(f"it has {width} x {height} pixels")
    if width * height > MOST_PIXELS:
        raise MapError(f"it has {width} x {height} pixels, and a map may have {MOST_PIXELS:,}")


def _pgm(content: bytes) -> Grey:
    if content[:2] not in (b"P2", b"P5"):
        raise MapError("it does not begin with P2 or P5, as a PGM file does")
    place, words = 2, []
    for name in ("width", "height", "greatest level"):
        found = _WORD.match(content, place, _HEAD)
        if found is None:
            raise MapError(f"it ends before its {name}")
        if not found[1].isdigit() or len(found[1]) > 9:
            raise MapError(f"its {name} (byte {found.start(1)}) is no whole number")
        words.append(int(found[1]))
        place = found.end()
    width, height, most = words
    _check_size(width, height)
    if not 1 <= most <= 255:
        raise MapError(f"its greatest level is {most}; a map has 8 bits for each pixel, so at most 255")
    count = width * height
    if content[:2] == b"P5":
        levels = np.frombuffer(content, np.uint8, offset=min(place + 1, len(content)))
        if len(levels) < count:
            raise MapError(f"it ends after {len(levels):,} of {count:,} pixels")
        levels = levels[:count]
    else:
        written = content[place:].split(None, count)
        if len(written) < count:
            raise MapError(f"it ends after {len(written):,} of {count:,} pixels")
        for number, word in enumerate(written[:count]):
            if not word.isdigit() or len(word) > 3 or int(word) > most:
                raise MapError(f"its pixel {number} (row {number // width}) is no number from 0 to {most}")
        levels = np.array([int(word) for word in written[:count]], np.uint8)
    if levels.max() > most:
        first = int(np.argmax(levels > most))
        raise MapError(f"its pixel {first} (row {first // width}) is above the greatest level, {most}")
    return levels.reshape(height, width) / most


def _png(content: bytes) -> tuple[Grey, NDArray[np.bool_]]:
    picture = _checked_png(content)
    try:
        from PIL import Image
    except ImportError as error:
        raise MapError("PNG files need Pillow: pip install 'symaware-cli[maps]'") from error
    try:
        with Image.open(io.BytesIO(picture), formats=["PNG"]) as image:
            colours = np.asarray(image.convert("RGBA"), float)
    except (OSError, SyntaxError, ValueError, EOFError, zlib.error) as error:
        raise MapError(f"it cannot be decoded: {error}") from error
    return colours[..., :3].sum(axis=2) / 765.0, colours[..., 3] < 255.0


def _checked_png(content: bytes) -> bytes:
    """Return a PNG file with nothing but the chunks of the picture, after a check of all chunks and of its size."""
    if not content.startswith(_SIGNATURE):
        raise MapError("it does not begin as a PNG file does")
    place, kept, kind = len(_SIGNATURE), [_SIGNATURE], b""
    while kind != b"IEND":
        head = content[place : place + 8]
        length = int.from_bytes(head[:4], "big")
        whole, kind = content[place : place + length + 12], head[4:]
        if len(head) < 8 or len(whole) < length + 12:
            raise MapError(f"it is truncated: its chunk at byte {place} is not complete")
        if zlib.crc32(whole[4:-4]) != int.from_bytes(whole[-4:], "big"):
            raise MapError(f"it is damaged: the checksum of its chunk at byte {place} is wrong")
        if place == len(_SIGNATURE):
            if kind != b"IHDR" or length != 13:
                raise MapError("its first chunk is not its header")
            width, height, depth, colour = struct.unpack_from(">IIBB", whole, 8)
            _check_size(width, height)
            if depth not in _DEPTHS.get(colour, ()):
                raise MapError(f"it has {depth} bits for each sample of colour type {colour}; a map has at most 8")
        if kind in _CRITICAL:
            kept.append(whole)
        place += length + 12
    return b"".join(kept)
