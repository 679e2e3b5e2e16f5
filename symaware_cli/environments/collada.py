"""Collada: reads the triangles of a .dae file, a format that viewers do not draw."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from xml.etree.ElementTree import Element

import numpy as np

from symaware_cli.environments.urdf import UrdfError, tree
from symaware_cli.geometry.rotation import about, rotated
from symaware_cli.geometry.vectors import Array

#: The deepest nesting of nodes.
_DEEPEST = 64


def triangles(data: bytes) -> Array:
    """Read all triangles of a scene (COLLADA 1.4.1 of the Khronos Group, 2008).

    Materials and animations are ignored, and so is the up axis, as in PyBullet and ROS.

    Args:
        data: The file.

    Returns:
        The three corners of each [m]; shape (t, 3, 3).

    Raises:
        UrdfError: It is no valid Collada file.
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
        raise UrdfError(f"is invalid: {error}") from error
    corners = np.concatenate([np.empty((0, 3, 3)), *(placed if scenes else geometries.values())])
    return metres * corners


def _geometry(geometry: Element) -> Array:
    """Return the triangles of a mesh; (t, 3, 3)."""
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
    """Yield the vertices of each face."""
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
    """Yield the triangles of a node and its children, in the frame of the node's parent."""
    if depth > _DEEPEST:
        raise ValueError("its nodes are nested too deeply")
    inner = [geometries[_link(each, "url")] for each in node.iterfind("instance_geometry")]
    for child in node.iterfind("node"):
        inner += _placed(child, geometries, depth + 1)
    for corners in inner:
        moved = corners
        for change in reversed(list(node)):
            moved = _moved(change, moved)
        yield moved


def _moved(change: Element, corners: Array) -> Array:
    """Apply one of a node's transformations; they are applied from the last to the first."""
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
