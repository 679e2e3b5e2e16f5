"""URDF: reads robot descriptions strictly, for their links, joints and looks, and for the files that they refer to."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.mesh_file import content
from symaware_cli.assets.robot_joint import RobotJoint
from symaware_cli.assets.xml_tree import XmlElement, xml_tree
from symaware_cli.geometry import Articulation, Link, Visual, attitude

#: The greatest size of a file [bytes].
_LARGEST_FILE = 16 << 20

#: The most links, and the longest name of a link or a joint: PyBullet cuts longer names off.
_MOST_LINKS = 1_000
_LONGEST_NAME = 255

#: Joint types that move, and their motions.
_MOTIONS = {"revolute": "turn", "continuous": "turn", "prismatic": "slide"}

#: The joint types that the specification of URDF has, and `spherical`, which PyBullet adds.
_JOINT_TYPES = {*_MOTIONS, "fixed", "floating", "planar", "spherical"}

#: The attributes with the size of each shape: name, and number of values. A plane is an extension of PyBullet.
_SIZES: Mapping[str, Sequence[tuple[str, int]]] = {
    "box": [("size", 3)],
    "sphere": [("radius", 1)],
    "cylinder": [("radius", 1), ("length", 1)],
    "capsule": [("radius", 1), ("length", 1)],
    "mesh": [],
    "plane": [],
}

#: Attributes that hold numbers, wherever an engine reads them: element, attribute, and number of values.
_NUMBERS: Sequence[tuple[str, str, int]] = [
    ("origin", "xyz", 3),
    ("origin", "rpy", 3),
    ("axis", "xyz", 3),
    ("color", "rgba", 4),
    ("mimic", "multiplier", 1),
    ("mimic", "offset", 1),
    *(("inertia", f"i{pair}", 1) for pair in ("xx", "xy", "xz", "yy", "yz", "zz")),
    *(("limit", name, 1) for name in ("lower", "upper", "effort", "velocity")),
    *(("dynamics", name, 1) for name in ("damping", "friction")),
]

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)


@dataclass(frozen=True)
class MeshReference:
    """A mesh that a description refers to.

    Attributes:
        name: The name in the description, such as ``package://robot/meshes/arm.stl``.
        element: The element that names it.
        collides: Whether the mesh is a collision shape; otherwise it is only visual.
    """

    name: str
    element: XmlElement
    collides: bool


class MimicJoint(NamedTuple):
    """The relation of a joint to another joint that it mimics.

    Attributes:
        joint: The other joint.
        factor: The factor by which the other joint's position is multiplied.
        offset: The offset that is added to the product [rad] or [m].
    """

    joint: str
    factor: float
    offset: float


class RobotDescription:
    """A robot description whose links and joints form a tree, and whose numeric attributes are numbers.

    Attributes:
        root: The element of the robot.
        name: The name of the robot.
        meshes: The meshes of its links, in the order of the file.
        empty: Collision shapes of the size 0, which collide with nothing, with a warning about each.
    """

    def __init__(self, data: bytes) -> None:
        """Read a description.

        Args:
            data: The file.

        Raises:
            AssetError: The file is no XML, describes no robot, or describes one that no engine could load as written.
        """
        self.root = xml_tree(data)
        if self.root.tag != "robot" or self.root.find("link") is None:
            self.root.refuse("it describes no robot: a URDF has a `robot` with at least one `link`")
        self.name = self.root.get("name") or ""
        self._refuse_macros()
        self._links = self._named("link", _MOST_LINKS)
        self._joints = self._named("joint", _MOST_LINKS)
        self.meshes: list[MeshReference] = []
        self.empty: list[tuple[XmlElement, str]] = []
        for link in self._links.values():
            self._check_link(link)
        self._carried: dict[str, list[tuple[str, XmlElement]]] = {name: [] for name in self._links}
        carrier: dict[str, str] = {}
        for name, joint in self._joints.items():
            parent, child = self._ends(joint)
            if child in carrier:
                joint.refuse(f"the joint `{name}` carries the link `{child}`, as the joint `{carrier[child]}` does")
            carrier[child] = name
            self._carried[parent].append((child, joint))
            self._check_joint(joint)
        self._base = self._find_base(carrier)
        self._check_numbers()

    @classmethod
    def read(cls, path: Path) -> RobotDescription:
        """Read a file.

        Raises:
            AssetError: The file cannot be read, is too long, or is no valid description.
        """
        return cls(content(path, _LARGEST_FILE))

    def leave_out(self, shapes: Collection[XmlElement]) -> None:
        """Leave out shapes that are not needed, such as visual shapes whose meshes are missing."""
        for link in self._links.values():
            for kind in ("visual", "collision"):
                for each in link.children(kind):
                    if any(shape in shapes for geometry in each.children("geometry") for shape in geometry):
                        link.remove(each)
        self.meshes = [each for each in self.meshes if each.element not in shapes]

    # -- joints that engines cannot move

    def followers(self) -> dict[str, MimicJoint]:
        """Return the joints that mimic others, by name, with the relation of each."""
        found = {}
        for name, joint in self._joints.items():
            for mimic in joint.children("mimic"):
                factor, offset = (
                    _numbers(mimic, key, 1)[0] if mimic.get(key) else default
                    for key, default in (("multiplier", 1.0), ("offset", 0.0))
                )
                found[name] = MimicJoint(mimic.get("joint") or "", factor, offset)
        return found

    def unsupported_joint(self, follow: bool = False) -> AssetError | None:
        """Return the problem with the first joint that a world does not move as the file says; None without one.

        Args:
            follow: Whether joints of the world can follow others.
        """
        for name, joint in self._joints.items():
            kind = joint.get("type")
            if kind not in _MOTIONS and kind != "fixed":
                said = (
                    f"the joint `{name}` is `{kind}`, none that turns or slides; those are of the type `revolute`, "
                    "`continuous` or `prismatic`"
                )
                return AssetError(said, joint.line, joint.column)
            mimic = joint.find("mimic")
            if isinstance(mimic, XmlElement):
                if not follow:
                    said = f"the joint `{name}` mimics another one, and here joints move each by itself"
                    return AssetError(said, mimic.line, mimic.column)
                other = self._joints.get(mimic.get("joint") or "", joint)
                if other is joint or other.get("type") not in _MOTIONS or kind not in _MOTIONS:
                    said = f"the joint `{name}` mimics `{mimic.get('joint')}`, which is no other joint that moves"
                    return AssetError(said, mimic.line, mimic.column)
        return None

    # -- links and joints

    def articulation(self, paths: Mapping[str, Path], scale: float = 1.0, name: str = "") -> Articulation:
        """Return links, joints and visual shapes. Meshes are named by their paths.

        Args:
            paths: The files of the meshes, by the names that the description uses.
            scale: Scale factor of all lengths.
            name: Its name if the file has none.
        """
        colours = {material.get("name"): _colour(material) for material in self.root.children("material")}
        links: list[Link] = []
        waiting: list[tuple[str, int, XmlElement | None]] = [(self._base, -1, None)]
        while waiting:
            link, parent, joint = waiting.pop(0)
            visuals = [_visual(each, paths, scale, colours) for each in self._links[link].children("visual")]
            placed = {} if joint is None else _placed_joint(joint, scale)
            drawn = tuple(visual for visual in visuals if visual)
            waiting += [(child, len(links), each) for child, each in self._carried[link]]
            links.append(Link(name=link, parent=parent, visuals=drawn, **placed))
        return Articulation(name=self.name or name, links=tuple(links))

    def joints(self) -> dict[str, RobotJoint]:
        """Return the joints that move, by their names, in the order of the file."""
        found = {}
        for name, joint in self._joints.items():
            kind = joint.get("type") or ""
            if kind not in _MOTIONS:
                continue
            limits = {"lower": -math.inf, "upper": math.inf, "effort": math.inf, "velocity": math.inf}
            for limit in joint.children("limit")[:1]:
                limits |= {key: _numbers(limit, key, 1)[0] for key in limits if limit.get(key)}
                if kind != "continuous":
                    limits |= {key: 0.0 for key in ("lower", "upper") if not limit.get(key)}
            if kind == "continuous":
                limits |= {"lower": -math.inf, "upper": math.inf}
            found[name] = RobotJoint(name, _MOTIONS[kind] == "turn", element=joint, **limits)
        return found

    def rolling_radius(self, joint: str) -> float | None:
        """Return the radius of the round shape that a joint carries, such as a wheel [m]; None without one."""
        _, child = self._ends(self._joints[joint])
        for collision in self._links[child].children("collision"):
            for shape in (each for geometry in collision.children("geometry") for each in _shapes(geometry)):
                if shape.tag in ("cylinder", "sphere", "capsule"):
                    return _numbers(shape, "radius", 1)[0]
        return None

    def collision_shapes(self) -> Mapping[str, int]:
        """Return the number of collision shapes that each link declares, by its name."""
        return {name: len(link.children("collision")) for name, link in self._links.items()}

    # -- checks

    def _refuse_macros(self) -> None:
        for element in self.root.iter():
            assert isinstance(element, XmlElement)
            if element.tag.startswith("xacro:"):
                element.refuse(f"`{element.tag[:40]}` is an element of xacro; expand the file with `xacro` first")

    def _named(self, tag: str, most: int) -> dict[str, XmlElement]:
        """Return the links or the joints by their names."""
        found: dict[str, XmlElement] = {}
        for element in self.root.children(tag):
            name = element.get("name") or ""
            if not name.strip():
                element.refuse(f"a {tag} has a name")
            if len(name.encode()) > _LONGEST_NAME:
                element.refuse(f"the name of a {tag} has at most {_LONGEST_NAME} characters, not {len(name)}")
            if name in found:
                element.refuse(f"the {tag} `{name}` is already on line {found[name].line}")
            found[name] = element
            if len(found) > most:
                element.refuse(f"it has more than {most:,} {tag}s")
        return found

    def _ends(self, joint: XmlElement) -> tuple[str, str]:
        """Return the parent and the child of a joint."""
        ends = []
        for end in ("parent", "child"):
            elements = joint.children(end)
            if len(elements) != 1 or not elements[0].get("link"):
                joint.refuse(f"the joint `{joint.get('name')}` has one `{end}`, which names a link")
            link = elements[0].get("link") or ""
            if link not in self._links:
                elements[0].refuse(
                    f"the {end} of the joint `{joint.get('name')}` is `{link}`, and there is no such link"
                )
            ends.append(link)
        return ends[0], ends[1]

    def _find_base(self, carrier: Mapping[str, str]) -> str:
        roots = [name for name in self._links if name not in carrier]
        if len(roots) > 1:
            others = f"{', '.join(f'`{name}`' for name in roots[:5])}{', ...' if len(roots) > 5 else ''}"
            self._links[roots[1]].refuse(
                f"it has {len(roots)} links that no joint carries, its roots, and a robot has one: {others}"
            )
        reached, ahead = set(roots), list(roots)
        while ahead:
            after = [child for child, _ in self._carried[ahead.pop()]]
            reached.update(after)
            ahead += after
        for name, link in self._links.items():
            if name not in reached:
                link.refuse(f"its joints form a loop, through the link `{name}`")
        return roots[0]

    def _check_link(self, link: XmlElement) -> None:
        name = link.get("name")
        for kind in ("inertial", "visual", "collision"):
            elements = link.children(kind)
            if kind == "inertial" and len(elements) > 1:
                elements[1].refuse(f"the link `{name}` has two `inertial` elements")
            for element in elements:
                if kind == "inertial":
                    for mass in element.children("mass"):
                        _numbers(mass, "value", 1, finite=False)
                else:
                    self._check_shape(element, name, kind == "collision")

    def _check_shape(self, element: XmlElement, link: str | None, collides: bool) -> None:
        geometries = element.children("geometry")
        shapes = [shape for geometry in geometries for shape in _shapes(geometry)]
        if len(geometries) != 1 or len(shapes) != 1:
            element.refuse(f"a `{element.tag}` of the link `{link}` has one `geometry` with one shape")
        shape = shapes[0]
        if shape.tag not in _SIZES or (shape.tag == "plane" and not collides):
            shape.refuse(f"`{shape.tag[:40]}` is no shape; those are box, sphere, cylinder, capsule and mesh")
        for key, count in _SIZES[shape.tag]:
            for number in _required(shape, key, count):
                if number < 0.0:
                    shape.refuse(f"the `{key}` of a {shape.tag} is greater than 0, not {number:g}")
                # A visual shape of the size 0 hides a link.
                if number == 0.0 and collides and all(shape is not empty for empty, _ in self.empty):
                    self.empty.append((shape, f"the `{key}` of a {shape.tag} is 0, which collides with nothing"))
        if shape.tag == "plane":
            _required(shape, "normal", 3)
        if shape.tag == "mesh":
            file = shape.get("filename") or ""
            if not file.strip():
                shape.refuse("a mesh has a `filename`")
            if "$" in file:
                shape.refuse(f"`{file}` is a placeholder of xacro; expand the file with `xacro` first")
            if not all(_scale(shape)):
                shape.refuse("the `scale` of a mesh is not 0")
            self.meshes.append(MeshReference(file, shape, collides))

    def _check_joint(self, joint: XmlElement) -> None:
        name, kind = joint.get("name"), joint.get("type")
        if kind not in _JOINT_TYPES:
            joint.refuse(f"the joint `{name}` has the type `{kind}`; the types are {', '.join(sorted(_JOINT_TYPES))}")
        for axis in joint.children("axis"):
            if kind in _MOTIONS and not any(_required(axis, "xyz", 3)):
                axis.refuse(f"the axis of the joint `{name}` has no direction")

    def _check_numbers(self) -> None:
        for part in (*self._links.values(), *self._joints.values(), *self.root.children("material")):
            for tag, key, count in _NUMBERS:
                for element in part.iter(tag):
                    assert isinstance(element, XmlElement)
                    if element.get(key) is not None:
                        _numbers(element, key, count)


def _placed_joint(joint: XmlElement, scale: float) -> dict[str, object]:
    motion = _MOTIONS.get(joint.get("type") or "", "fixed")
    placed: dict[str, object] = {**_origin(joint, scale)}
    if motion == "fixed":
        return placed
    axes = joint.children("axis")
    along = np.array(_numbers(axes[0], "xyz", 3) if axes else (1.0, 0.0, 0.0))
    along = along / max(float(np.linalg.norm(along)), 1e-12)
    return {**placed, "joint": joint.get("name") or "", "motion": motion, "axis": tuple(along.tolist())}


def _origin(element: XmlElement, scale: float) -> dict[str, tuple[float, ...]]:
    position: Sequence[float] = (0.0, 0.0, 0.0)
    angles: Sequence[float] = (0.0, 0.0, 0.0)
    for origin in element.children("origin")[:1]:
        position = [scale * each for each in _numbers(origin, "xyz", 3)] if origin.get("xyz") else position
        angles = _numbers(origin, "rpy", 3) if origin.get("rpy") else angles
    return {"position": tuple(position), "orientation": tuple(attitude(*angles).tolist())}


def _visual(
    element: XmlElement,
    paths: Mapping[str, Path],
    scale: float,
    colours: Mapping[str | None, tuple[float, float, float, float] | None],
) -> Visual | None:
    shape = next(shape for geometry in element.children("geometry") for shape in _shapes(geometry))
    colour = None
    for material in element.children("material")[:1]:
        colour = _colour(material) or colours.get(material.get("name"))
    mesh, size = "", [number for key, count in _SIZES[shape.tag] for number in _numbers(shape, key, count)]
    if shape.tag == "mesh":
        file = paths.get(shape.get("filename") or "")
        if file is None:
            return None
        size = list(_scale(shape))
        mesh, colour = str(file), colour or material_colour(file)
    scaled = tuple(scale * each for each in size)
    return Visual(kind=shape.tag, size=scaled, mesh=mesh, colour=colour, **_origin(element, scale))


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
    library = Path(os.path.normpath(path.parent / named[1].decode(errors="replace")))
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


def _colour(material: XmlElement) -> tuple[float, float, float, float] | None:
    for colour in material.children("color")[:1]:
        if colour.get("rgba"):
            red, green, blue, opacity = (min(max(each, 0.0), 1.0) for each in _numbers(colour, "rgba", 4))
            return red, green, blue, opacity
    return None


def _scale(shape: XmlElement) -> tuple[float, float, float]:
    """Return the scale of a mesh along each axis; a single number applies to all axes, as in engines."""
    written = shape.get("scale")
    if written is None:
        return 1.0, 1.0, 1.0
    if len(written.split()) == 1:
        (number,) = _numbers(shape, "scale", 1)
        return number, number, number
    first, second, third = _numbers(shape, "scale", 3)
    return first, second, third


def _shapes(geometry: XmlElement) -> list[XmlElement]:
    """Return the shapes of a geometry. A `material` within a geometry is misplaced, and is ignored as engines do."""
    return [each for each in geometry.children() if each.tag != "material"]


def _required(element: XmlElement, key: str, count: int) -> tuple[float, ...]:
    if element.get(key) is None:
        element.refuse(f"a `{element.tag}` has a `{key}`")
    return _numbers(element, key, count)


def _numbers(element: XmlElement, key: str, count: int, finite: bool = True) -> tuple[float, ...]:
    """Return the numbers of an attribute, after a check of their count."""
    return numbers_of(element, key, element.get(key) or "", count, finite)


def numbers_of(element: XmlElement, key: str, text: str, count: int | None, finite: bool = True) -> tuple[float, ...]:
    """Return the numbers in the text of an attribute, which may come from defaults of the element.

    Args:
        element: The element, for messages.
        key: The name of the attribute.
        text: Its value.
        count: How many numbers it has; None for any number.
        finite: Whether infinity and NaN are refused.

    Raises:
        AssetError: The text has another count of numbers, or something that is no number.
    """
    # Engines accept a comma in front of a blank; one in front of a digit would be a decimal comma.
    words = re.sub(r",(?=\s)", " ", text).split()
    shown = f"`{key}` of `{element.tag}`"
    if "$" in text:
        element.refuse(f"the {shown} is `{text[:60]}`, a placeholder of xacro; expand the file with `xacro` first")
    if not finite and len(words) == 1 and words[0].lower().lstrip("+-") in ("nan", "inf"):
        return (float(words[0]),)
    for word in words:
        if not _NUMBER.fullmatch(word):
            hint = "; numbers are written with a point, and blanks between them" if "," in word else ""
            element.refuse(f"the {shown} is `{text[:60]}`, and `{word[:40]}` is no number{hint}")
    if count is not None and len(words) != count:
        wanted = "1 number" if count == 1 else f"{count} numbers"
        element.refuse(f"the {shown} is `{text[:60]}`, which has {len(words)} numbers; it has {wanted}")
    numbers = tuple(map(float, words))
    if finite and not all(map(math.isfinite, numbers)):
        element.refuse(f"the {shown} is `{text[:60]}`, which is too large")
    return numbers
