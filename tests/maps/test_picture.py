"""Pictures of maps are checked before they are decoded."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from symaware_cli.maps.map_error import MapError
from symaware_cli.maps.picture import MOST_PIXELS, read_picture

LEVELS = np.array([[0, 205, 254], [254, 0, 255]], np.uint8)


def png(mode: str = "L", **options: object) -> bytes:
    written = io.BytesIO()
    Image.fromarray(LEVELS).convert(mode).save(written, "PNG", **options)
    return written.getvalue()


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def header(width: int = 3, height: int = 2, depth: int = 8, colour: int = 0) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))


@pytest.mark.parametrize(
    ("content", "suffix"),
    [
        (b"P5\n# made by hand\n3 2\n# two comments\n255\n" + LEVELS.tobytes(), ".pgm"),
        (b"P2 3 2 255\n0 205 254\n254 0 255\n", ".pgm"),
        (png(), ".png"),
        (png("RGB"), ".png"),
        (png("RGBA"), ".png"),
        (png("P"), ".png"),
    ],
)
def test_both_formats_give_the_same_levels(content: bytes, suffix: str) -> None:
    grey, transparent = read_picture(content, suffix)
    assert np.allclose(grey * 255.0, LEVELS, rtol=0.0, atol=1e-9)
    assert not transparent.any()


@pytest.mark.parametrize(
    ("content", "suffix", "said"),
    [
        (b"", ".pgm", "does not begin with P2 or P5"),
        (b"P6\n1 1\n255\nabc", ".pgm", "does not begin with P2 or P5"),
        (b"P5\n3", ".pgm", "ends before its height"),
        (b"P5\n3 two 255\n", ".pgm", r"its height \(byte 5\) is no whole number"),
        (b"P5\n0 2 255\n", ".pgm", "0 x 2 pixels"),
        (b"P5\n99999 99999 255\n", ".pgm", "99999 x 99999 pixels, and a map may have 4,000,000"),
        (b"P5\n1 1 65535\n\x00\x00", ".pgm", "greatest level is 65535"),
        (b"P5\n3 2 255\n\x00\x00", ".pgm", "ends after 2 of 6 pixels"),
        (b"P5\n1 1 7\n\x08", ".pgm", r"pixel 0 \(row 0\) is above the greatest level, 7"),
        (b"P2\n3 2 255\n1 2 3\n4", ".pgm", "ends after 4 of 6 pixels"),
        (b"P2\n2 2 255\n1 2\n-3 4", ".pgm", r"pixel 2 \(row 1\) is no number from 0 to 255"),
        (b"GIF89a", ".png", "does not begin as a PNG file does"),
        (png()[:-20], ".png", "truncated"),
        (png()[:20], ".png", "truncated: its chunk at byte 8"),
        (png().replace(b"IDAT", b"IDAU"), ".png", "checksum"),
        (header(100_000, 100_000), ".png", "100000 x 100000 pixels"),
        (header(depth=16), ".png", "16 bits for each sample"),
        (header(colour=5), ".png", "colour type 5"),
        (b"\x89PNG\r\n\x1a\n" + chunk(b"IDAT", b""), ".png", "first chunk is not its header"),
        (header() + chunk(b"IDAT", b"nonsense") + chunk(b"IEND", b""), ".png", "cannot be decoded"),
        (header() + chunk(b"IEND", b""), ".png", "cannot be decoded"),
        (b"BM", ".bmp", "neither a .pgm nor a .png"),
        (bytes(5 * MOST_PIXELS + 1), ".pgm", "larger than 20 MB"),
    ],
)
def test_damaged_or_too_large_pictures_are_refused_with_a_message(content: bytes, suffix: str, said: str) -> None:
    with pytest.raises(MapError, match=said):
        read_picture(content, suffix)


def test_chunks_beside_the_picture_reach_no_library() -> None:
    bomb = chunk(b"iCCP", b"profile\0\0" + zlib.compress(bytes(1 << 20)))
    content = png()
    with_bomb = content[:33] + bomb + content[33:]
    assert np.array_equal(read_picture(with_bomb, ".png")[0], read_picture(content, ".png")[0])


def test_a_picture_that_expands_beyond_its_size_costs_no_more_than_its_pixels() -> None:
    rows = zlib.compress(bytes(50_000_000), 9)
    grey, _ = read_picture(header() + chunk(b"IDAT", rows) + chunk(b"IEND", b""), ".png")
    assert grey.shape == (2, 3)
