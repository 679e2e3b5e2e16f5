"""Collada: the surface of a .dae file, which viewers do not draw."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from symaware_cli.environments.urdf import UrdfError, tree
from symaware_cli.geometry.rotation import about, rotated

Array = NDArray[np.float64]

#: How deep nodes may lie in each other.
_DEEPEST = 64


def triangles(data: bytes) -> Array:
    """Read all triangles of a scene (COLLADA 1.4.1 of the Khronos Group, 2008).

    Materials and what moves are passed over; so is which axis points up, as PyBullet and ROS do.

    Args:
        data: The file.

    Returns:
        Three corners of each; (t, 3, 3) [m].

    Raises:
        UrdfError: It is no Collada, or makes no sense.
    """
    root = tree(data)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "COLLADA":
        raise UrdfError("is no Collada file")
    try:
        geometries = {each.get("id"): _geometry(each) for each in root.iterfind("library_geometries/geometry")}
        scenes = root.findall("library_visual_scenes/visual_scene")
        placed = [each for scene in scenes[:1] for node in scene.iterfind("node") for each in _placed(node, geometries)]
        unit = root.find("asset/unit")
        metres = float(unit.get("meter", "1")) if unit is not None else 1.0
    except (ValueError, IndexError, KeyError) as error:
        raise UrdfError(f"makes no sense: {error}") from error
    corners = np.concatenate([np.empty((0, 3, 3)), *(placed if scenes else geometries.values())])
    surface: Array = metres * corners
    return surface


def _geometry(geometry: Element) -> Array:
    """The triangles of a mesh; (t, 3, 3)."""
    mesh = geometry.find("mesh")
    if mesh is None:
        return np.empty((0, 3, 3))
    sources = {source.get("id"): _source(source) for source in mesh.iterfind("source")}
    positions = {
        vertices.get("id"): sources[_link(own, "source")]
        for vertices in mesh.iterfind("vertices")
        for own in vertices.iterfind("input")
        if own.get("semantic") == "POSITION"
    }
    parts = [np.empty((0, 3, 3))]
    for kind in ("triangles", "polylist", "polygons"):
        for part in mesh.iterfind(kind):
            inputs = part.findall("input")
            width = 1 + max(int(own.get("offset", "0")) for own in inputs)
            vertex = next(own for own in inputs if own.get("semantic") == "VERTEX")
            points = positions[_link(vertex, "source")]
            faces = list(_faces(part, width, int(vertex.get("offset", "0"))))
            fans = [(face[0], one, other) for face in faces for one, other in pairwise(face[1:])]
            parts.append(points[np.array(fans, np.intp).reshape(-1, 3)])
    return np.concatenate(parts)


def _faces(part: Element, width: int, offset: int) -> Iterator[list[int]]:
    """The vertices of each face."""
    lists = [[int(word) for word in (each.text or "").split()][offset::width] for each in part.iterfind("p")]
    if part.tag == "polygons":
        yield from lists
        return
    flat = [index for each in lists for index in each]
    counts = [int(word) for word in (part.findtext("vcount") or "").split()]
    if part.tag == "triangles":
        counts = [3] * (len(flat) // 3)
    ends = np.cumsum([0, *counts]).tolist()
    for start, end in pairwise(ends):
        yield flat[start:end]


def _source(source: Element) -> Array:
    numbers = np.array((source.findtext("float_array") or "").split(), float)
    accessor = source.find("technique_common/accessor")
    stride = int(accessor.get("stride", "1")) if accessor is not None else 3
    return numbers[: len(numbers) // stride * stride].reshape(-1, stride)[:, :3]


def _placed(node: Element, geometries: dict[str | None, Array], depth: int = 0) -> Iterator[Array]:
    """The triangles of a node and those in it, in the frame of what it lies in."""
    if depth > _DEEPEST:
        raise ValueError("its nodes lie too deep in each other")
    inner = [geometries[_link(each, "url")] for each in node.iterfind("instance_geometry")]
    for child in node.iterfind("node"):
        inner += _placed(child, geometries, depth + 1)
    for corners in inner:
        moved = corners
        for change in reversed(list(node)):
            moved = _moved(change, moved)
        yield moved


def _moved(change: Element, corners: Array) -> Array:
    """Apply one of the changes of a node, of which the last comes first."""
    if change.tag not in ("matrix", "translate", "rotate", "scale"):
        return corners
    numbers = np.array((change.text or "").split(), float)
    moved: Array = corners + numbers[:3]
    match change.tag:
        case "matrix":
            matrix = numbers.reshape(4, 4)
            moved = corners @ matrix[:3, :3].T + matrix[:3, 3]
        case "rotate":
            axis = numbers[:3] / max(float(np.linalg.norm(numbers[:3])), 1e-12)
            moved = rotated(about(axis, np.radians(numbers[3])), corners)
        case "scale":
            moved = corners * numbers[:3]
    return moved


def _link(element: Element, key: str) -> str:
    return (element.get(key) or "").removeprefix("#")
