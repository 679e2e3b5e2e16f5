"""Descriptions of robots: URDF files, read once for what refers to other files and for what the robot looks like."""

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

#: [bytes] No description is longer.
_LONGEST = 16 << 20

#: How joints move what they carry. Others, which PyBullet does not move by one number either, count as fixed.
_MOTIONS = {"revolute": "turn", "continuous": "turn", "prismatic": "slide"}

#: What says how large a shape is: attributes, how many numbers each has, and what they are where nothing is said.
_SIZES: Mapping[str, Sequence[tuple[str, int, tuple[float, ...] | None]]] = {
    "box": [("size", 3, None)],
    "sphere": [("radius", 1, None)],
    "cylinder": [("radius", 1, None), ("length", 1, None)],
    "capsule": [("radius", 1, None), ("length", 1, None)],
    "mesh": [("scale", 3, (1.0, 1.0, 1.0))],
}


class UrdfError(ValueError):
    """A file describes no robot."""


class _Plain(ElementTree.TreeBuilder):
    """Builds trees of documents that declare nothing: entities could make a small file fill the memory."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise UrdfError("cannot be read: it declares a document type")


def tree(data: bytes) -> Element:
    """Read XML that declares nothing.

    Raises:
        UrdfError: It is none.
    """
    try:
        return ElementTree.fromstring(data, ElementTree.XMLParser(target=_Plain()))
    except (ElementTree.ParseError, UnicodeDecodeError, LookupError) as error:
        raise UrdfError(f"cannot be read: {error}") from error


def parsed(path: Path) -> Element:
    """Read a URDF file.

    Raises:
        UrdfError: It cannot be read, is too long, is no XML, or no robot.
    """
    try:
        if path.stat().st_size > _LONGEST:
            raise UrdfError(f"cannot be read: it is longer than {_LONGEST >> 20} MiB")
        root = tree(path.read_bytes())
    except OSError as error:
        raise UrdfError(f"cannot be read: {error}") from error
    if root.tag != "robot" or root.find("link") is None:
        raise UrdfError("describes no robot: a URDF has a `robot` with at least one `link`")
    return root


def meshes(root: Element, path: Path) -> dict[str, Path]:
    """The meshes that a description names, by these names, and where they should be."""
    names = [mesh.get("filename") or "" for mesh in root.iter("mesh")]
    return {name: _beside(path, name) for name in names}


def articulation(path: Path, scale: float = 1.0) -> Articulation:
    """Read links, joints and what they look like out of a URDF file, which an engine has accepted.

    Meshes are named by their paths. What is said of a look and makes no sense is passed over, as engines do.

    Args:
        path: The file.
        scale: By how much everything in it is enlarged.

    Raises:
        UrdfError: It cannot be read, or its links carry each other in a circle.
    """
    return _Reader(parsed(path), path, scale).articulation


class _Reader:
    """What is read out of one description."""

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
        """The links in the order in which they carry each other; parents before children."""
        waiting: list[tuple[str, int, Element | None]] = [(base, -1, None)]
        count = 0
        while waiting:
            name, parent, joint = waiting.pop(0)
            if name not in elements:
                continue
            visuals = tuple(each for visual in elements[name].iterfind("visual") if (each := self._visual(visual)))
            yield Link(name=name, parent=parent, visuals=visuals, **({} if joint is None else self._joint(joint)))
            # A link that carries itself would go round for ever.
            if count > len(elements):
                raise UrdfError("makes no sense: its links carry each other in a circle")
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
    """What an OBJ file names beside it that says how it looks: libraries of materials, and pictures that they name."""
    found: list[str] = []
    for library in _said(path, ".obj", rb"^mtllib[ \t]+(.+)"):
        pictures = _said(path.parent / library, ".mtl", rb"^[ \t]*map_\w+[ \t]+(?:.*[ \t])?(\S+)")
        found += [library, *(os.path.join(os.path.dirname(library), picture) for picture in pictures)]
    return found


def _said(path: Path, kind: str, pattern: bytes) -> list[str]:
    """What lines of a file say that look so; nothing if it is of another kind or cannot be read."""
    if path.suffix.lower() != kind or not path.is_file():
        return []
    with open(path, "rb") as file:
        said = re.findall(pattern, file.read(1 << 16), re.MULTILINE)
    return [name.decode(errors="replace").strip() for name in said]


def material_colour(path: Path) -> tuple[float, float, float, float] | None:
    """The colour of the first material of an OBJ file, as the file beside it says."""
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
        said = re.search(rb"^[ \t]*Kd[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", file.read(1 << 16), re.MULTILINE)
    if said is None:
        return None
    try:
        red, green, blue = (min(max(float(said[number]), 0.0), 1.0) for number in (1, 2, 3))
    except ValueError:
        return None
    return red, green, blue, 1.0


def _beside(path: Path, name: str) -> Path:
    return Path(os.path.normpath(path.parent / name.removeprefix("package://")))


def _colour(material: Element) -> tuple[float, float, float, float] | None:
    said = _numbers(material.find("color"), "rgba", 4, ())
    if not said:
        return None
    red, green, blue, opacity = (min(max(each, 0.0), 1.0) for each in said)
    return red, green, blue, opacity


def _numbers(
    element: Element | None, key: str, count: int, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """The first numbers of an attribute, as the engine takes them: it is content with commas and with more of them."""
    said = "" if element is None else element.get(key) or ""
    try:
        numbers = tuple(float(each) for each in said.replace(",", " ").split()[:count])
    except ValueError:
        numbers = ()
    if len(numbers) == count and all(map(math.isfinite, numbers)):
        return numbers
    if default is None:
        raise UrdfError(f"makes no sense: `{key}` has {count} numbers, not `{said}`")
    return default
