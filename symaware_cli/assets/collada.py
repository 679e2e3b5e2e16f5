"""Collada: reads the triangles of a .dae file, a format that viewers do not draw."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.xml_tree import XmlElement, xml_tree
from symaware_cli.geometry import Array, Indices, about, rotated

_PARTS = ("triangles", "polylist", "polygons")
_CHANGES = ("matrix", "translate", "rotate", "scale")


def triangles(data: bytes, most: int) -> Array:
    """Read all triangles of a scene (COLLADA 1.4.1 of the Khronos Group, 2008).

    Materials and animations are ignored, and so is the up axis, as in PyBullet and ROS.

    Args:
        data: The file.
        most: The greatest number of triangles, counting those of a geometry as often as it is placed.

    Returns:
        The three corners of each triangle [m]; shape (t, 3, 3).

    Raises:
        AssetError: The data is no valid Collada file, or has more triangles.
    """
    root = xml_tree(data)
    for element in root.iter():
        element.tag = element.tag.rpartition(":")[2]
    if root.tag != "COLLADA":
        raise AssetError(f"it is no Collada file: it begins with `{root.tag[:40]}`")
    return _Scene(root, most).corners()


class _Scene:
    """Reads one scene."""

    def __init__(self, root: XmlElement, most: int) -> None:
        self._root, self._most = root, most
        self._count = 0
        self._geometries = {each.get("id"): _geometry(each) for each in _all(root, "library_geometries/geometry")}

    def corners(self) -> Array:
        """Return the corners of all triangles [m]; (t, 3, 3)."""
        scenes = _all(self._root, "library_visual_scenes/visual_scene")
        placed = [np.empty((0, 3, 3))]
        if not scenes:
            placed += self._geometries.values()
            self._bound(sum(map(len, placed)))
        for scene in scenes[:1]:
            for node in _all(scene, "node"):
                placed += self._placed(node, np.eye(4))
        return self._metres() * np.concatenate(placed)

    def _metres(self) -> float:
        for unit in _all(self._root, "asset/unit")[:1]:
            metres = float(_numbers(unit, unit.get("meter", "1"), 1)[0])
            if metres <= 0.0:
                unit.refuse(f"its unit is {metres:g} m long")
            return metres
        return 1.0

    def _bound(self, count: int) -> None:
        self._count += count
        if self._count > self._most:
            raise AssetError(f"it has {self._count:,} triangles or more; at most {self._most:,} are read")

    def _placed(self, node: XmlElement, outer: Array) -> Iterator[Array]:
        """Yield the triangles of a node and its children, in the frame of the scene."""
        frame = outer
        for change in node:
            if change.tag in _CHANGES:
                assert isinstance(change, XmlElement)
                frame = frame @ _change(change)
        for instance in _all(node, "instance_geometry"):
            corners = self._geometries.get(_link(instance, "url"))
            if corners is None:
                instance.refuse(f"it places the geometry `{instance.get('url')}`, which does not exist")
            self._bound(len(corners))
            yield corners @ frame[:3, :3].T + frame[:3, 3]
        for child in _all(node, "node"):
            yield from self._placed(child, frame)


def _geometry(geometry: XmlElement) -> Array:
    """Return the triangles of a mesh; (t, 3, 3)."""
    parts = [np.empty((0, 3, 3))]
    for mesh in _all(geometry, "mesh")[:1]:
        sources = {source.get("id"): source for source in _all(mesh, "source")}
        positions = {
            vertices.get("id"): _source(sources, own)
            for vertices in _all(mesh, "vertices")
            for own in _all(vertices, "input")
            if own.get("semantic") == "POSITION"
        }
        for part in mesh:
            if part.tag in _PARTS:
                assert isinstance(part, XmlElement)
                parts.append(_part(part, positions))
    return np.concatenate(parts)


def _part(part: XmlElement, positions: Mapping[str | None, Array]) -> Array:
    """Return the triangles of one list of faces; (t, 3, 3)."""
    inputs = _all(part, "input")
    vertex = next((own for own in inputs if own.get("semantic") == "VERTEX"), None)
    if vertex is None:
        part.refuse("its faces have no vertices (an `input` with the semantic VERTEX)")
    points = positions.get(_link(vertex, "source"))
    if points is None:
        vertex.refuse(f"it refers to the vertices `{vertex.get('source')}`, which do not exist")
    width = 1 + max(_offset(own) for own in inputs)
    counts = [_integers(each, each.text) for each in _all(part, "vcount")]
    lists = [_integers(each, each.text) for each in _all(part, "p")]
    flat = np.concatenate([np.empty(0, np.intp), *lists])
    if len(flat) % width:
        part.refuse(f"its {len(flat):,} indices are no multiple of the {width} of a vertex")
    corners = flat.reshape(-1, width)[:, _offset(vertex)]
    if part.tag == "polygons":
        sizes = np.array([len(each) // width for each in lists], np.intp)
    elif part.tag == "polylist":
        sizes = np.concatenate([np.empty(0, np.intp), *counts])
    else:
        sizes = np.full(len(corners) // 3, 3)
    if len(sizes) and sizes.min() < 3:
        part.refuse(f"a face has at least 3 vertices, not {sizes.min()}")
    if sizes.sum() != len(corners):
        part.refuse(f"its faces have {sizes.sum():,} vertices, and {len(corners):,} are listed")
    stated = part.get("count", "")
    if stated.strip().isdecimal() and int(stated[:18]) != len(sizes):
        part.refuse(f"it states {stated.strip()[:18]} faces, and has {len(sizes):,}")
    if len(corners) and not (corners.min() >= 0 and corners.max() < len(points)):
        worst = int(corners.max() if corners.max() >= len(points) else corners.min())
        part.refuse(f"a face refers to vertex {worst}, and there are {len(points):,}, counted from 0")
    return np.asarray(points[corners[_fans(sizes)]].reshape(-1, 3, 3))


def _fans(sizes: Indices) -> Indices:
    """Return the places of the corners of the triangles of faces, which are fans; (t, 3)."""
    starts = np.cumsum(sizes) - sizes
    owner = np.repeat(np.arange(len(sizes)), sizes - 2)
    first = np.cumsum(sizes - 2) - (sizes - 2)
    second = np.arange(len(owner)) - first[owner] + 1
    begin = starts[owner]
    return np.stack([begin, begin + second, begin + second + 1], axis=1)


def _source(sources: Mapping[str | None, XmlElement], own: XmlElement) -> Array:
    """Return the points of a source; (v, 3)."""
    source = sources.get(_link(own, "source"))
    if source is None:
        own.refuse(f"it refers to the source `{own.get('source')}`, which does not exist")
    arrays = _all(source, "float_array")
    if not arrays:
        source.refuse("the source of the positions has no `float_array`")
    numbers = _numbers(arrays[0], arrays[0].text or "")
    accessors = _all(source, "technique_common/accessor")
    stride = accessors[0].get("stride", "1") if accessors else "3"
    if not stride.isdecimal() or not 3 <= int(stride[:9]) <= 64:
        source.refuse(f"a position has 3 numbers or more, not a stride of `{stride[:40]}`")
    stated = arrays[0].get("count", "")
    if stated.strip().isdecimal() and int(stated[:18]) != len(numbers):
        arrays[0].refuse(f"it states {stated.strip()[:18]} numbers, and has {len(numbers):,}")
    width = int(stride)
    return numbers[: len(numbers) // width * width].reshape(-1, width)[:, :3]


def _change(change: XmlElement) -> Array:
    """Return one of a node's transformations, which apply from the last to the first; (4, 4)."""
    count = {"matrix": 16, "rotate": 4}.get(change.tag, 3)
    numbers = _numbers(change, change.text or "", count)
    moved = np.eye(4)
    match change.tag:
        case "matrix":
            return numbers.reshape(4, 4)
        case "rotate":
            axis = numbers[:3] / max(float(np.linalg.norm(numbers[:3])), 1e-12)
            moved[:3, :3] = rotated(about(axis, np.radians(numbers[3])), np.eye(3)).T
        case "scale":
            moved[:3, :3] = np.diag(numbers)
        case _:
            moved[:3, 3] = numbers
    return moved


def _all(element: XmlElement, path: str) -> Sequence[XmlElement]:
    return [each for each in element.iterfind(path) if isinstance(each, XmlElement)]


def _numbers(element: XmlElement, text: str, count: int | None = None) -> Array:
    try:
        numbers = np.array(text.split(), float)
    except ValueError:
        wrong = next(word for word in text.split() if not _is_number(word))
        element.refuse(f"`{wrong[:40]}` is no number")
    if not np.isfinite(numbers).all():
        element.refuse("it has a number that is not finite")
    if count is not None and len(numbers) != count:
        element.refuse(f"it has {len(numbers)} numbers, not {count}")
    return numbers


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _integers(element: XmlElement, text: str | None) -> Indices:
    words = (text or "").split()
    wrong = next((word for word in words if not (word.isdecimal() and len(word) < 10)), None)
    if wrong is not None:
        element.refuse(f"`{wrong[:40]}` is no index")
    return np.array([int(word) for word in words], np.intp)


def _offset(own: XmlElement) -> int:
    offset = own.get("offset", "0")
    if not offset.isdecimal() or len(offset) > 2:
        own.refuse(f"`{offset[:40]}` is no offset")
    return int(offset)


def _link(element: XmlElement, key: str) -> str:
    return (element.get(key) or "").removeprefix("#")
