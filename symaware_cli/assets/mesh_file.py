"""Mesh files: reads STL, OBJ and Collada strictly and within bounds, and writes STL.

Files are read here before an engine or a viewer gets them, because engines skip, misread or crash on damaged ones.

Reasons: docs/decisions/0060-files-of-robots.md
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.geometry import Array, Indices
from symaware_cli.world import record

#: Mesh formats that viewers can read, and their media types.
MEDIA_TYPES = {".obj": "model/obj", ".stl": "model/stl", ".glb": "model/gltf-binary"}

#: Mesh formats that are read here; only these may be the shape of a body.
SUFFIXES = (".obj", ".stl", ".dae")

#: The greatest size of a mesh file [bytes], and the most triangles and vertices in one; all are checked before the
#: numbers are parsed, and bound the time as well, which grows linearly with them.
LARGEST_FILE = 64 << 20
MOST_TRIANGLES = 1_000_000

#: A mesh is flat if its extent along some direction is less than this part of its greatest extent.
_FLAT = 1e-6

#: Binary STL: the size of its head, and a triangle: a normal, three corners and two attribute bytes.
_STL_HEAD = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

#: A number as all three formats write it; Python would also accept `nan`, `inf` and `1_000`.
_NUMBER = re.compile(rb"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_INTEGER = re.compile(rb"[-+]?[0-9]{1,9}")

_SOLID = re.compile(rb"\s*solid\b", re.IGNORECASE)
_BOM = b"\xef\xbb\xbf"

#: The words that may follow each other in an ASCII STL file, with the number of arguments.
_STL_GRAMMAR = {
    b"solid": (b"facet", b"endsolid"),
    b"facet": (b"outer",),
    b"outer": (b"vertex",),
    b"vertex": (b"vertex", b"endloop"),
    b"endloop": (b"endfacet",),
    b"endfacet": (b"facet", b"endsolid"),
    b"endsolid": (b"solid",),
}


@record
class MeshSurface:
    """The surface of a mesh file, in units of the file; in metres for Collada.

    Attributes:
        vertices: Shape (v, 3).
        corners: The vertices of each triangle; shape (t, 3).
        parts: For each part of the file that collides as a convex hull of its own, its number of triangles. An OBJ has
            one for each of its objects and groups, the other formats one.
    """

    vertices: Array
    corners: Indices
    parts: tuple[int, ...]

    @property
    def triangles(self) -> Array:
        """The corners of each triangle; shape (t, 3, 3)."""
        return np.asarray(self.vertices[self.corners])

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper corner of the bounding box of the triangles; (3,) each."""
        used = self.vertices[np.unique(self.corners)]
        return used.min(axis=0), used.max(axis=0)

    @property
    def is_flat(self) -> bool:
        """Whether all triangles lie in one plane, so that they enclose no volume."""
        used = self.vertices[np.unique(self.corners)]
        spread = np.linalg.svd(used - used.mean(axis=0), compute_uv=False)
        return len(spread) < 3 or bool(spread[2] <= _FLAT * spread[0])


def read_mesh(path: Path) -> MeshSurface:
    """Read a mesh file.

    Raises:
        AssetError: The file cannot be read, is too large, or is damaged.
    """
    return parse_mesh(content(path, LARGEST_FILE), path.suffix)


def content(path: Path, largest: int) -> bytes:
    """Return the content of a file of at most `largest` bytes.

    Raises:
        AssetError: The file cannot be read, or is larger.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(largest + 1)
    except OSError as error:
        raise AssetError(f"it cannot be read: {error.strerror}") from error
    if len(data) > largest:
        raise AssetError(f"it is longer than {largest >> 20} MiB")
    return data


def parse_mesh(data: bytes, suffix: str) -> MeshSurface:
    """Read a mesh.

    Args:
        data: The file.
        suffix: The suffix of its name, such as ``.obj``.

    Raises:
        AssetError: The mesh is damaged, has too many triangles, or is of another format.
    """
    match suffix.lower():
        case ".stl":
            surface = _stl(data)
        case ".obj":
            surface = _obj(normalised(data))
        case ".dae":
            from symaware_cli.assets.collada import triangles

            surface = _of_triangles(triangles(data, MOST_TRIANGLES))
        case other:
            raise AssetError(f"a mesh is an .obj, .stl or .dae file, not {other or 'one without a suffix'}")
    if not len(surface.corners):
        raise AssetError("it has no triangles")
    return surface


@lru_cache(maxsize=256)
def _checked(path: Path, modified: int, size: int, encloses: bool) -> AssetError | None:
    try:
        surface = read_mesh(path)
        if encloses and surface.is_flat:
            raise AssetError("its triangles lie in one plane, and the shape of a body encloses a volume")
    except AssetError as error:
        return error.with_traceback(None)
    return None


def check_mesh(path: Path, encloses: bool) -> None:
    """Check a mesh file; a file that has not changed is read only once in a process.

    Args:
        path: The file.
        encloses: Whether the mesh is the shape of a body, which must enclose a volume.

    Raises:
        AssetError: The file cannot be used.
    """
    try:
        state = path.stat()
    except OSError as error:
        raise AssetError(f"it cannot be read: {error.strerror}") from error
    found = _checked(path, state.st_mtime_ns, state.st_size, encloses)
    if found is not None:
        raise AssetError(str(found), found.line, found.column)


def normalised(data: bytes) -> bytes:
    """Return an OBJ file as the simplest reader takes it: without a byte order mark or continued lines."""
    data = data.removeprefix(_BOM)
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    return re.sub(rb"\\[ \t]*\r?\n", b" ", data) if b"\\" in data else data


def is_binary_stl(data: bytes) -> bool:
    """Whether a file is a binary STL file of the length that its head states."""
    if len(data) < _STL_HEAD:
        return False
    (count,) = struct.unpack_from("<I", data, _STL_HEAD - 4)
    return bool(len(data) == _STL_HEAD + count * _TRIANGLE.itemsize)


def stl(corners: Array) -> bytes:
    """Write a mesh as a binary STL file; corners (t, 3, 3), counter-clockwise as seen from outside."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records = np.zeros(len(corners), _TRIANGLE)
    records["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    records["corners"] = corners
    return bytes(_STL_HEAD - 4) + struct.pack("<I", len(corners)) + records.tobytes()


def _of_triangles(corners: Array) -> MeshSurface:
    count = len(corners)
    return MeshSurface(corners.reshape(-1, 3), np.arange(3 * count).reshape(count, 3), (count,))


# -- STL


def _stl(data: bytes) -> MeshSurface:
    if is_binary_stl(data):
        (count,) = struct.unpack_from("<I", data, _STL_HEAD - 4)
        _check_count(count)
        corners = np.frombuffer(data, _TRIANGLE, count, _STL_HEAD)["corners"].astype(float)
        wrong = np.flatnonzero(~np.isfinite(corners).all(axis=(1, 2)))
        if len(wrong):
            raise AssetError(f"triangle {wrong[0] + 1:,} has a coordinate that is no finite number")
        return _of_triangles(corners)
    if _SOLID.match(data) and b"\0" not in data:
        _check_count(data.lower().count(b"endfacet"))
        return _of_triangles(_ascii_stl(data))
    if not data:
        raise AssetError("it is empty")
    if len(data) < _STL_HEAD:
        raise AssetError(f"it is cut off: a binary STL file has a head of {_STL_HEAD} bytes, and this has {len(data)}")
    (count,) = struct.unpack_from("<I", data, _STL_HEAD - 4)
    expected = _STL_HEAD + count * _TRIANGLE.itemsize
    raise AssetError(f"its head states {count:,} triangles, which take {expected:,} bytes; the file has {len(data):,}")


def _ascii_stl(data: bytes) -> Array:
    """Return the corners of each triangle; (t, 3, 3)."""
    numbers: list[bytes] = []
    before, loop, line = b"endsolid", 0, 0
    for line, text in enumerate(data.splitlines(), 1):
        words = text.lower().split()
        if not words:
            continue
        word = words[0]
        if word not in _STL_GRAMMAR[before]:
            wanted = " or ".join(f"`{each.decode()}`" for each in _STL_GRAMMAR[before])
            raise AssetError(f"`{_shown(word)}` stands where {wanted} is expected", line)
        if word == b"vertex":
            loop += 1
            numbers += _coordinates(words, 3, line, exact=True)
        elif word == b"endloop":
            if loop != 3:
                raise AssetError(f"a facet has 3 vertices, not {loop}", line)
            loop = 0
        before = word
    if before != b"endsolid":
        wanted = " or ".join(f"`{each.decode()}`" for each in _STL_GRAMMAR[before])
        raise AssetError(f"it is cut off: {wanted} is expected", line)
    return _finite(numbers).reshape(-1, 3, 3)


# -- OBJ


def _obj(data: bytes) -> MeshSurface:
    # Each face has at least three indices, so that the bytes bound the number of triangles; most files are refused
    # by the number of their lines before anything is parsed.
    _check_count(data.count(b"\nf"), data.count(b"\nv "))
    numbers: list[bytes] = []
    places: list[int] = []
    corners: list[tuple[int, int, int]] = []
    lines: list[int] = []
    counts = [0]
    for line, text in enumerate(data.splitlines(), 1):
        words = text.split()
        if not words or words[0][:1] == b"#":
            continue
        word = words[0]
        if word == b"v":
            numbers += _coordinates(words, 3, line)
            places.append(line)
        elif word == b"f":
            face = _face(words, len(numbers) // 3, line)
            corners += [(face[0], face[place], face[place + 1]) for place in range(1, len(face) - 1)]
            lines += [line] * (len(face) - 2)
            counts[-1] += len(face) - 2
            if len(corners) > MOST_TRIANGLES:
                _check_count(len(corners))
        elif word in (b"o", b"g") and counts[-1]:
            counts.append(0)
    vertices, indices = _finite(numbers, places).reshape(-1, 3), np.array(corners, np.intp).reshape(-1, 3)
    # A face may refer to vertices that follow it.
    outside = (indices < 0) | (indices >= len(vertices))
    for row in np.flatnonzero(outside.any(axis=1))[:1].tolist():
        index = int(indices[row][outside[row]][0])
        said = f"vertex {index + 1}" if index >= 0 else "a vertex before the first"
        raise AssetError(f"a face refers to {said}, and there are {len(vertices):,}", lines[row])
    return MeshSurface(vertices, indices, tuple(count for count in counts if count))


def _face(words: Sequence[bytes], count: int, line: int) -> list[int]:
    """Return the vertices of a face; its indices begin at 1, or with -1 at the last of `count` vertices."""
    if len(words) < 4:
        raise AssetError(f"a face has at least 3 vertices, not {len(words) - 1}", line)
    face = []
    for word in words[1:]:
        written = word.split(b"/")
        if len(written) > 3 or not _INTEGER.fullmatch(written[0]):
            raise AssetError(f"`{_shown(word)}` is no vertex of a face, such as `1` or `1/2/3`", line)
        for other in written[1:]:
            if other and not _INTEGER.fullmatch(other):
                raise AssetError(f"`{_shown(word)}` is no vertex of a face, such as `1` or `1/2/3`", line)
        index = int(written[0])
        face.append(index + count if index < 0 else index - 1)
    return face


# -- numbers


def _coordinates(words: Sequence[bytes], count: int, line: int, exact: bool = False) -> Sequence[bytes]:
    """Return the words that are the numbers of a vertex."""
    given = words[1 : count + 1]
    if len(given) < count or (exact and len(words) != count + 1):
        raise AssetError(f"a vertex has {count} numbers, not {len(words) - 1}", line)
    for word in given:
        if not _NUMBER.fullmatch(word):
            hint = "; decimals are written with a point" if b"," in word else ""
            raise AssetError(f"`{_shown(word)}` is no finite number{hint}", line)
    return given


def _finite(numbers: Sequence[bytes], places: Sequence[int] = ()) -> Array:
    found = np.array([float(number) for number in numbers])
    wrong = np.flatnonzero(~np.isfinite(found))
    if len(wrong):
        line = places[wrong[0] // 3] if len(places) else 0
        raise AssetError(f"`{_shown(numbers[wrong[0]])}` is too large a number", line)
    return found


def _check_count(*counts: int) -> None:
    """Refuse a file with too many triangles or vertices."""
    if max(counts) > MOST_TRIANGLES * 3:
        raise AssetError(f"it has {max(counts):,} vertices; at most {3 * MOST_TRIANGLES:,} are read")
    if counts[0] > MOST_TRIANGLES:
        raise AssetError(f"it has {counts[0]:,} triangles; at most {MOST_TRIANGLES:,} are read")


def _shown(word: bytes) -> str:
    return word[:40].decode(errors="replace")
