"""Mesh files: reads the triangles of OBJ and STL files, computes bounding boxes, and writes STL."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Mesh formats that viewers can read, and their media types.
MEDIA_TYPES = {".obj": "model/obj", ".stl": "model/stl", ".glb": "model/gltf-binary"}

#: Binary STL: size of the head; a triangle consists of a normal, three corners and two attribute bytes.
_STL_HEAD = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def bounds(data: bytes, suffix: str) -> tuple[Array, Array] | None:
    """Compute the bounding box of a mesh.

    Args:
        data: The file.
        suffix: The suffix of its name, such as ``.obj``.

    Returns:
        Its lower and its upper corner, (3,) each, in units of the file; None if the format is not supported.
    """
    vertices = _vertices(data, suffix)
    if vertices is None:
        return None
    sound = vertices[np.isfinite(vertices).all(axis=1)]
    return (sound.min(axis=0), sound.max(axis=0)) if len(sound) else None


def triangles(data: bytes, suffix: str) -> tuple[Array, Indices] | None:
    """Read the triangles of a mesh.

    Args:
        data: The file.
        suffix: The suffix of its name, such as ``.obj``.

    Returns:
        The vertices (v, 3), in units of the file, and the vertex indices of each triangle (t, 3); None if the format is
        not supported.
    """
    vertices = _vertices(data, suffix)
    if vertices is None or not np.isfinite(vertices).all():
        return None
    if suffix.lower() == ".stl":
        corners = np.arange(len(vertices) // 3 * 3).reshape(-1, 3)
    else:
        try:
            corners = np.array(list(_fans(data, len(vertices))), np.intp).reshape(-1, 3)
        except ValueError:
            return None
    inside = not len(corners) or (corners.min() >= 0 and corners.max() < len(vertices))
    return (vertices, corners) if inside else None


def stl(corners: Array) -> bytes:
    """Write a mesh as a binary STL file; corners (t, 3, 3), counter-clockwise as seen from outside."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records = np.zeros(len(corners), _TRIANGLE)
    records["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    records["corners"] = corners
    return bytes(_STL_HEAD - 4) + struct.pack("<I", len(corners)) + records.tobytes()


def _vertices(data: bytes, suffix: str) -> Array | None:
    try:
        match suffix.lower():
            case ".obj":
                return _numbers(data, b"v ")
            case ".stl":
                return _stl(data)
    except (ValueError, struct.error):
        pass
    return None


def _fans(data: bytes, count: int) -> Iterator[tuple[int, int, int]]:
    """Yield the triangles of an OBJ file, whose faces are fans; its indices begin at 1, or at the end with -1."""
    for each in data.split(b"\n"):
        line = each.strip()
        if line.startswith(b"f "):
            face = [int(word.split(b"/")[0]) for word in line.split()[1:]]
            face = [index + count if index < 0 else index - 1 for index in face]
            yield from ((face[0], one, other) for one, other in pairwise(face[1:]))


def _stl(data: bytes) -> Array:
    if len(data) >= _STL_HEAD:
        (count,) = struct.unpack_from("<I", data, _STL_HEAD - 4)
        if len(data) == _STL_HEAD + count * _TRIANGLE.itemsize:
            corners = np.frombuffer(data, _TRIANGLE, count, _STL_HEAD)["corners"]
            return corners.reshape(-1, 3).astype(float)
    return _numbers(data, b"vertex ")


def _numbers(data: bytes, word: bytes) -> Array:
    """Return the first three numbers of each line that begins with a word."""
    lines = [line.split()[1:4] for each in data.split(b"\n") if (line := each.strip()).startswith(word)]
    return np.array(lines, float).reshape(-1, 3)
