"""Surfaces: how far meshes reach, without drawing them."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Files that are surfaces by themselves, for viewers; and what they are called.
MEDIA_TYPES = {".obj": "model/obj", ".stl": "model/stl", ".glb": "model/gltf-binary"}

#: A binary STL: its head, and a triangle of a normal, three corners and two bytes more.
_STL_HEAD = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def bounds(data: bytes, suffix: str) -> tuple[Array, Array] | None:
    """Find the box around a surface.

    Args:
        data: The file.
        suffix: The end of its name, such as ``.obj``.

    Returns:
        Its lower and its upper corner, (3,) each, in units of the file; None if that cannot be told.
    """
    try:
        match suffix.lower():
            case ".obj":
                corners = _numbers(data, b"v ")
            case ".stl":
                corners = _stl(data)
            case _:
                return None
    except (ValueError, struct.error):
        return None
    sound = corners[np.isfinite(corners).all(axis=1)]
    return (sound.min(axis=0), sound.max(axis=0)) if len(sound) else None


def _stl(data: bytes) -> Array:
    if len(data) >= _STL_HEAD:
        (count,) = struct.unpack_from("<I", data, _STL_HEAD - 4)
        if len(data) == _STL_HEAD + count * _TRIANGLE.itemsize:
            corners = np.frombuffer(data, _TRIANGLE, count, _STL_HEAD)["corners"]
            return corners.reshape(-1, 3).astype(float)
    return _numbers(data, b"vertex ")


def _numbers(data: bytes, word: bytes) -> Array:
    """The first three numbers of each line that begins with a word."""
    lines = [line.split()[1:4] for each in data.split(b"\n") if (line := each.strip()).startswith(word)]
    return np.array(lines, float).reshape(-1, 3)
