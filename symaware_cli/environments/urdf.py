"""URDF: reads robot descriptions for their links, joints and looks, and for the files that they refer to."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from symaware_cli.geometry.articulation import Articulation, Link, Visual
from symaware_cli.geometry.rotation import attitude

#: The maximum size of a file [bytes].
_LARGEST_FILE = 16 << 20

#: Joint types and their motions. Joints of other types, which PyBullet does not move by one number, count as fixed.
_MOTIONS = {"revolute": "turn", "continuous": "turn", "prismatic": "slide"}

#: The attributes with the size of each shape: name, number of values, and default.
_SIZES: Mapping[str, Sequence[tuple[str, int, tuple[float, ...] | None]]] = {
    "box": [("size", 3, None)],
    "sphere": [("radius", 1, None)],
    "cylinder": [("radius", 1, None), ("length", 1, None)],
    "capsule": [("radius", 1, None), ("length", 1, None)],
    "mesh": [("scale", 3, (1.0, 1.0, 1.0))],
}


class UrdfError(ValueError):
    """A file cannot be read, or describes no robot."""


class _SafeTreeBuilder(ElementTree.TreeBuilder):
    """Rejects document type declarations: their entities could make a small file fill the memory."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise UrdfError("cannot be read: it declares a document type")


def tree(data: bytes) -> Element:
    """Parse XML without a document type declaration.

    Raises:
        UrdfError: It is no such XML.
    """
    try:
        return ElementTree.fromstring(data, ElementTree.XMLParser(target=_SafeTreeBuilder()))
    except (ElementTree.ParseError, UnicodeDecodeError, LookupError) as error:
        raise UrdfError(f"cannot be read: {error}") from error


def parsed(path: Path) -> Element:
    """Parse a URDF file.

    Raises:
        UrdfError: It cannot be read, is too long, is no XML, or describes no robot.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise UrdfError(f"cannot be read: it is longer than {_LARGEST_FILE >> 20} MiB")
        root = tree(path.read_bytes())
    except OSError as error:
        raise UrdfError(f"cannot be read: {error}") from error
    if root.tag != "robot" or root.find("link") is None:
        raise UrdfError("describes no robot: a URDF has a `robot` with at least one `link`")
    return root


def meshes(root: Element, path: Path) -> dict[str, Path]:
    """Return the paths of the meshes that a description refers to, by the names it uses."""
    names = [mesh.get("filename") or "" for mesh in root.iter("mesh")]
    return {name: _beside(path, name) for name in names}


def articulation(path: Path, scale: float = 1.0) -> Articulation:
    """Read links, joints and visual shapes from a URDF file that an engine has accepted.

    Meshes are named by their paths. Invalid visual elements are ignored, as engines do.

    Args:
        path: The file.
        scale: Scale factor of all lengths.

    Raises:
        UrdfError: It cannot be read, or its joints form a loop.
    """
    return _Reader(parsed(path), path, scale).articulation


class _Reader:
    """Reads one description."""

    def __init__(self, root: Element, path: Path, scale: float) -> None:
        self._path, self._scale = path, scale
        self._colours = {material.get("name"): _colour(material) for material in root.iterfind("material")}
        elements = {link.get("name") or "": link for link in root.iterfind("link")}
        carried: dict[str, list[tuple[str, Element]]] = {}
        children = set()
        for joint in root.iterfind("joint"):
            parent, child = joint.find("parent"), joint.find("child")
            if parent is not None and child is not None:
                children.add(child.get("link"))
                carried.setdefault(parent.get("link") or "", []).append((child.get("link") or "", joint))
        base = next((name for name in elements if name not in children), "")
        links = list(self._links(base, elements, carried))
        self.articulation = Articulation(name=root.get("name") or path.stem, links=tuple(links))

    def _links(
        self, base: str, elements: Mapping[str, Element], carried: Mapping[str, Sequence[tuple[str, Element]]]
    ) -> Iterator[Link]:
        """Yield the links, parents before children."""
        waiting: list[tuple[str, int, Element | None]] = [(base, -1, None)]
        count = 0
        while waiting:
            name, parent, joint = waiting.pop(0)
            if name not in elements:
                continue
            visuals = tuple(each for visual in elements[name].iterfind("visual") if (each := self._visual(visual)))
            yield Link(name=name, parent=parent, visuals=visuals, **({} if joint is None else self._joint(joint)))
            # A loop of joints would never end.
            if count > len(elements):
                raise UrdfError("is invalid: its joints form a loop")
            waiting += [(child, count, each) for child, each in carried.get(name, ())]
            count += 1

    def _joint(self, joint: Element) -> dict[str, object]:
        motion = _MOTIONS.get(joint.get("type") or "", "fixed")
        placed: dict[str, object] = {**self._origin(joint)}
        if motion == "fixed":
            return placed
        axis = joint.find("axis")
        along = np.array(_numbers(axis, "xyz", 3, (1.0, 0.0, 0.0)))
        along = along / max(float(np.linalg.norm(along)), 1e-12)
        return {**placed, "joint": joint.get("name") or "", "motion": motion, "axis": tuple(along.tolist())}

    def _origin(self, element: Element) -> dict[str, tuple[float, ...]]:
        origin = element.find("origin")
        position = [self._scale * each for each in _numbers(origin, "xyz", 3, (0.0, 0.0, 0.0))]
        turned = attitude(*_numbers(origin, "rpy", 3, (0.0, 0.0, 0.0)))
        return {"position": tuple(position), "orientation": tuple(turned.tolist())}

    def _visual(self, element: Element) -> Visual | None:
        geometry, material = element.find("geometry"), element.find("material")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None or shape.tag not in _SIZES:
            return None
        colour = None
        if material is not None:
            colour = _colour(material) or self._colours.get(material.get("name"))
        mesh = ""
        try:
            if shape.tag == "mesh":
                file = _beside(self._path, shape.get("filename") or "")
                mesh, colour = str(file), colour or material_colour(file)
            size = tuple(number for given in _SIZES[shape.tag] for number in _numbers(shape, *given))
        except UrdfError:
            return None
        size = tuple(self._scale * each for each in size)
        return Visual(kind=shape.tag, size=size, mesh=mesh, colour=colour, **self._origin(element))


def materials(path: Path) -> list[str]:
    """Return the material libraries of an OBJ file and the textures that these refer to, as relative paths."""
    found: list[str] = []
    for library in _find_all(path, ".obj", rb"^mtllib[ \t]+(.+)"):
        pictures = _find_all(path.parent / library, ".mtl", rb"^[ \t]*map_\w+[ \t]+(?:.*[ \t])?(\S+)")
        found += [library, *(os.path.join(os.path.dirname(library), picture) for picture in pictures)]
    return found


def _find_all(path: Path, kind: str, pattern: bytes) -> list[str]:
    """Return the group of each match in a file; nothing if it has another suffix or does not exist."""
    if path.suffix.lower() != kind or not path.is_file():
        return []
    with open(path, "rb") as file:
        found = re.findall(pattern, file.read(1 << 16), re.MULTILINE)
    return [name.decode(errors="replace").strip() for name in found]


def material_colour(path: Path) -> tuple[float, float, float, float] | None:
    """Return the colour of the first material of an OBJ file, from its material library."""
    if path.suffix.lower() != ".obj" or not path.is_file():
        return None
    with open(path, "rb") as file:
        named = re.search(rb"^mtllib[ \t]+(\S+)", file.read(1 << 16), re.MULTILINE)
    if named is None:
        return None
    library = _beside(path, named[1].decode(errors="replace"))
    if not library.is_file() or library.parent != path.parent:
        return None
    with open(library, "rb") as file:
        match = re.search(rb"^[ \t]*Kd[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", file.read(1 << 16), re.MULTILINE)
    if match is None:
        return None
    try:
        red, green, blue = (min(max(float(match[number]), 0.0), 1.0) for number in (1, 2, 3))
    except ValueError:
        return None
    return red, green, blue, 1.0


def _beside(path: Path, name: str) -> Path:
    return Path(os.path.normpath(path.parent / name.removeprefix("package://")))


def _colour(material: Element) -> tuple[float, float, float, float] | None:
    numbers = _numbers(material.find("color"), "rgba", 4, ())
    if not numbers:
        return None
    red, green, blue, opacity = (min(max(each, 0.0), 1.0) for each in numbers)
    return red, green, blue, opacity


def _numbers(
    element: Element | None, key: str, count: int, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """Return the first numbers of an attribute; like the engine, accept commas and additional numbers."""
    text = "" if element is None else element.get(key) or ""
    try:
        numbers = tuple(float(each) for each in text.replace(",", " ").split()[:count])
    except ValueError:
        numbers = ()
    if len(numbers) == count and all(map(math.isfinite, numbers)):
        return numbers
    if default is None:
        raise UrdfError(f"is invalid: `{key}` has {count} numbers, not `{text}`")
    return default
