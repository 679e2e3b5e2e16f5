"""MJCF: reads robots in the format of MuJoCo strictly, for their links, joints and looks, and the files they refer to.

Reasons: docs/decisions/0080-robots-as-agents.md
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath

import numpy as np

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.mesh_file import content
from symaware_cli.assets.mjcf_defaults import ACTUATORS, MjcfDefaults, bare, kept_defaults
from symaware_cli.assets.mjcf_inclusion import LARGEST_FILES, MjcfInclusions
from symaware_cli.assets.mjcf_looks import MjcfLooks
from symaware_cli.assets.mjcf_pose import ORIENTATIONS, UNTURNED, MjcfPoses, numbers_in, quadruple, triple
from symaware_cli.assets.robot_joint import RobotJoint
from symaware_cli.assets.urdf import MeshReference, MimicJoint, numbers_of
from symaware_cli.assets.xml_tree import XmlElement, xml_tree
from symaware_cli.geometry import Articulation, Link, rotated

_MOST_LINKS = 1_000

#: Sections with settings of the simulation and of pictures, which the scenario has instead.
_OF_OTHERS = {"option", "size", "visual", "statistic", "custom", "sensor", "keyframe", "contact"}

#: Settings of the compiler that matter for a robot and name no folder.
_COMPILER = (
    *("angle", "eulerseq", "autolimits", "inertiafromgeom", "inertiagrouprange"),
    *("boundmass", "boundinertia", "balanceinertia", "settotalmass"),
)

#: The elements of a body that are read, and those that are no part of a robot's mechanics.
_IN_BODY = {"body", "inertial", "joint", "freejoint", "geom", "site"}
_UNUSED_IN_BODY = {"camera", "light"}

#: The numbers of values in the size of each kind of geometry, and with two ends (`fromto`) instead of a pose.
_SIZES = {"sphere": (1, 1), "capsule": (2, 1), "cylinder": (2, 1), "ellipsoid": (3, 3), "box": (3, 2), "mesh": (0, 0)}

#: Attributes that hold finite numbers in any element, besides the attributes that are read.
_NUMBERS = frozenset(
    [
        "pos",
        "quat",
        "axisangle",
        "euler",
        "xyaxes",
        "zaxis",
        "axis",
        "range",
        "size",
        "fromto",
        "mass",
        "density",
        "inertia",
        "diaginertia",
        "fullinertia",
        "damping",
        "stiffness",
        "armature",
        "frictionloss",
        "springref",
        "springdamper",
        "margin",
        "gap",
        "friction",
        "solref",
        "solimp",
        "solreflimit",
        "solimplimit",
        "solreffriction",
        "solimpfriction",
        "actuatorfrcrange",
        "polycoef",
        "anchor",
        "relpose",
        "scale",
        "vertex",
        "normal",
        "gravcomp",
        "rgba",
    ]
)

#: The largest magnitude of such a number.
_GREATEST = 1e9


class MjcfDescription:
    """A robot of MJCF: one body with its descendants, without the scene around it.

    Lights, cameras, sensors, actuators, key frames, options and planes are left out: the scenario has its own. Features
    that no world could simulate as the file says are refused.

    Attributes:
        root: The root element, with the needed parts of the file and of the files that it includes; bodies and joints
            have names.
        name: The name of the model.
        meshes: The meshes of its links, in the order of the file.
        includes: The files that it includes, by their paths relative to it.
    """

    def __init__(self, data: bytes, find: Callable[[XmlElement, str], Path] | None = None) -> None:
        """Read a model.

        Args:
            data: The file.
            find: Returns the path of a file that an element includes; by default all inclusions are refused.

        Raises:
            AssetError: The file is no XML, describes no robot, or describes one that cannot be loaded as written.
        """
        whole = xml_tree(data)
        if whole.tag != "mujoco":
            whole.refuse("it describes no robot: an MJCF file has a `mujoco` with a `worldbody`")
        inclusions = MjcfInclusions(find, LARGEST_FILES - len(data))
        inclusions.resolve(whole)
        self.includes = inclusions.paths
        self.name = whole.get("model") or ""
        self.root = _copied(whole)
        self._read_compiler(whole)
        self._defaults = MjcfDefaults(whole.children("default"))
        for section in whole.children("default"):
            self.root.append(kept_defaults(section))
        colours = {
            each.get("name"): numbers_in(each, each.attrib, "rgba", 4) if "rgba" in each.attrib else None
            for section in whole.children("asset")
            for each in section.children("material")
        }
        self.meshes: list[MeshReference] = []
        self._mesh_files: dict[str, str] = {}
        self._mesh_scales: dict[str, tuple[float, ...]] = {}
        for section in whole.children("asset"):
            self._read_assets(section)
        self._looks = MjcfLooks(self._defaults, self._poses, colours, self._mesh_files, self._mesh_scales)
        self._bodies: list[tuple[XmlElement, int, str]] = []
        self._joints: dict[str, tuple[XmlElement, dict[str, str]]] = {}
        self._read_bodies(whole)
        self._keep_couplings(whole)
        self._efforts = self._read_actuators(whole)

    @classmethod
    def read(cls, path: Path, find: Callable[[XmlElement, str], Path] | None = None) -> MjcfDescription:
        """Read a file.

        Raises:
            AssetError: The file cannot be read, is too long, or is no valid description.
        """
        return cls(content(path, LARGEST_FILES), find)

    def unsupported_joint(self, follow: bool = False) -> AssetError | None:
        """Return None: joints that worlds do not move are refused when a file is read."""
        return None

    def followers(self) -> dict[str, MimicJoint]:
        """Return an empty mapping: couplings of joints are left to the engine that loads the file."""
        return {}

    # -- settings

    def _read_compiler(self, whole: XmlElement) -> None:
        given: dict[str, str] = {}
        for each in whole.children("compiler"):
            given |= each.attrib
            if each.get("coordinate", "local") != "local":
                each.refuse("coordinates are `local`")
        compiler = XmlElement("compiler", {key: given[key] for key in _COMPILER if key in given})
        self.root.insert(0, compiler)
        self._degrees = given.get("angle", "degree") != "radian"
        sequence = given.get("eulerseq", "xyz")
        if len(sequence) != 3 or sequence.strip("xyzXYZ"):
            whole.refuse(f"the `eulerseq` is `{sequence[:20]}`, and it has three letters of x, y, z, X, Y, Z")
        self._poses = MjcfPoses(self._degrees, sequence)
        self._auto = given.get("autolimits", "true") != "false"
        self._mesh_folder = given.get("meshdir", given.get("assetdir", ""))
        self._strips = given.get("strippath", "false") == "true"

    # -- assets

    def _read_assets(self, section: XmlElement) -> None:
        kept = XmlElement("asset")
        for each in section.children():
            if each.tag in ("texture", "material"):
                continue
            if each.tag != "mesh" or each.get("builtin") or len(each):
                each.refuse(f"`{each.tag}` is no asset that a robot can have here; those are meshes from files")
            self._read_mesh(each)
            kept.append(bare(each))
        self.root.append(kept)

    def _read_mesh(self, mesh: XmlElement) -> None:
        given = self._defaults.attributes(mesh, "main")
        file = mesh.get("file") or ""
        name = mesh.get("name") or PurePosixPath(file).stem
        if not name or name in self._mesh_scales:
            mesh.refuse(f"the mesh `{name}` exists twice" if name else "a mesh has a `name` or a `file`")
        mesh.set("name", name)
        scale = numbers_in(mesh, given, "scale", 3) if "scale" in given else (1.0, 1.0, 1.0)
        if not all(scale):
            mesh.refuse("the `scale` of a mesh is not 0")
        if any(key in given for key in ("refpos", "refquat")):
            mesh.refuse("meshes with a reference pose are not read; move the geometry instead")
        self._mesh_scales[name] = scale
        if file:
            inner = PurePosixPath(file).name if self._strips else file
            self._mesh_files[name] = str(PurePosixPath(self._mesh_folder, inner))
            self.meshes.append(MeshReference(self._mesh_files[name], mesh, True))
        elif not mesh.get("vertex"):
            mesh.refuse("a mesh has a `file`, or a `vertex`")

    def mesh_file(self, name: str) -> str | None:
        """Return the name of a mesh's file in `meshes`; None for a mesh whose vertices are in the robot's own file."""
        return self._mesh_files.get(name)

    # -- bodies

    def _read_bodies(self, whole: XmlElement) -> None:
        tops: list[XmlElement] = []
        for section in whole.children("worldbody"):
            for each in section.children():
                if each.tag == "body":
                    tops.append(each)
                elif each.tag == "geom":
                    given = self._defaults.attributes(each, section.get("childclass") or "main")
                    if given.get("type") != "plane":
                        each.refuse("a shape outside of the robot's body; the scenario has entities for such")
                elif each.tag not in ("light", "camera", "site"):
                    each.refuse(f"`{each.tag}` is not read here; a robot is one `body` with those that it carries")
        if len(tops) != 1:
            (tops[1] if tops else whole).refuse(f"a robot is one `body` in `worldbody`; this file has {len(tops)}")
        world = XmlElement("worldbody")
        self._read_body(tops[0], -1, "main", world)
        self.root.append(world)

    def _read_body(self, body: XmlElement, parent: int, around: str, into: XmlElement) -> None:
        around = body.get("childclass") or around
        number = len(self._bodies)
        if number >= _MOST_LINKS:
            body.refuse(f"it has more than {_MOST_LINKS:,} bodies")
        name = body.get("name") or f"body{number}"
        if name in {each.get("name") for each, _, _ in self._bodies}:
            body.refuse(f"the body `{name}` exists twice")
        body.set("name", name)
        if body.get("mocap", "false") != "false":
            body.refuse("a body that others move (`mocap`) is no robot")
        self._bodies.append((body, parent, around))
        kept = bare(body)
        into.append(kept)
        if parent < 0:
            # The scenario says where the robot is.
            for key in ("pos", *ORIENTATIONS):
                kept.attrib.pop(key, None)
        self._poses.pose(body, body.attrib)
        for each in body.children():
            if each.tag in _UNUSED_IN_BODY:
                continue
            if each.tag not in _IN_BODY:
                each.refuse(f"`{each.tag}` in a body is not read; those are {', '.join(sorted(_IN_BODY))}")
            if each.tag == "body":
                self._read_body(each, number, around, kept)
                continue
            if each.tag in ("joint", "freejoint") and not self._read_joint(each, parent, around):
                continue
            if each.tag == "geom":
                self._check_geometry(each, around)
            kept.append(bare(each))

    def _read_joint(self, joint: XmlElement, parent: int, around: str) -> bool:
        """Check a joint, and return whether it is one of the robot's own."""
        given = {} if joint.tag == "freejoint" else self._defaults.attributes(joint, around)
        kind = "free" if joint.tag == "freejoint" else given.get("type", "hinge")
        if kind == "free" and parent < 0:
            return False
        name = joint.get("name") or f"joint{len(self._joints)}"
        if kind not in ("hinge", "slide"):
            joint.refuse(f"the joint `{name}` is `{kind}`, none that turns or slides; those are `hinge` and `slide`")
        if parent < 0:
            joint.refuse(f"the joint `{name}` moves the robot's base; a base is fixed or free, as the scenario says")
        if name in self._joints:
            joint.refuse(f"the joint `{name}` exists twice")
        if "ref" in given and numbers_in(joint, given, "ref", 1)[0]:
            joint.refuse(f"the joint `{name}` has a reference position (`ref`), which is not read; it is 0")
        axis = numbers_in(joint, given, "axis", 3) if "axis" in given else (0.0, 0.0, 1.0)
        if not any(axis):
            joint.refuse(f"the axis of the joint `{name}` has no direction")
        for key, count in (("pos", 3), ("range", 2), ("actuatorfrcrange", 2)):
            if key in given:
                numbers_in(joint, given, key, count)
        joint.set("name", name)
        self._joints[name] = joint, given
        return True

    def _check_geometry(self, geometry: XmlElement, around: str) -> None:
        given = self._defaults.attributes(geometry, around)
        kind = given.get("type", "mesh" if "mesh" in given else "sphere")
        if kind not in _SIZES:
            geometry.refuse(f"`{kind}` is no shape of a robot; those are {', '.join(sorted(_SIZES))}")
        self._poses.pose(geometry, given)
        if kind == "mesh" and given.get("mesh") not in self._mesh_scales:
            geometry.refuse(f"there is no mesh `{given.get('mesh', '')}` in `asset`")
        if "fromto" in given:
            numbers_in(geometry, given, "fromto", 6)
        if kind != "mesh":
            if given.get("mesh"):
                geometry.refuse("a shape that is fitted to a mesh is not read; give its `size`")
            least = _SIZES[kind]["fromto" in given]
            size = numbers_of(geometry, "size", given.get("size", ""), None)
            if len(size) < least or not all(each > 0.0 for each in size[:least]):
                geometry.refuse(f"a `{kind}` has {least} sizes greater than 0, not `{given.get('size', '')[:60]}`")

    def _keep_couplings(self, whole: XmlElement) -> None:
        for section in whole.children("equality"):
            kept = XmlElement("equality")
            for each in section.children():
                if each.tag not in ("connect", "weld", "joint"):
                    each.refuse(f"the equality `{each.tag}` is not read; those are connect, joint and weld")
                kept.append(bare(each))
            self.root.append(kept)
        for section in whole.children("tendon"):
            for each in section.children():
                given = self._defaults.attributes(each, "main")
                felt = [key for key in ("stiffness", "damping", "range", "frictionloss", "armature") if key in given]
                if each.tag != "fixed" or felt:
                    each.refuse("a tendon with forces of its own is not read; only actuators may use it")
        for each in whole.children():
            known = {"compiler", "default", "asset", "worldbody", "equality", "tendon", "actuator", *_OF_OTHERS}
            if each.tag not in known:
                each.refuse(f"`{each.tag}` is no section of a robot that is read here")
        for part in self.root.iter():
            assert isinstance(part, XmlElement)
            for key in part.attrib:
                if "file" in key and (part.tag, key) != ("mesh", "file"):
                    part.refuse(f"`{key}` of `{part.tag}` names a file, and only meshes may")
                if key in _NUMBERS and (part.tag, key) != ("mesh", "inertia"):
                    numbers = numbers_of(part, key, part.attrib[key], None)
                    if any(abs(each) > _GREATEST for each in numbers):
                        part.refuse(f"the `{key}` of `{part.tag}` has a number over {_GREATEST:g}")

    def _read_actuators(self, whole: XmlElement) -> dict[str, float]:
        """Return the greatest force or torque of each joint that has an actuator with a limit [N] or [N m]."""
        efforts: dict[str, float] = {}
        for section in whole.children("actuator"):
            for each in section.children():
                given, joint = self._defaults.attributes(each, "main"), each.get("joint")
                if joint is None or each.tag not in ACTUATORS:
                    continue
                if joint not in self._joints:
                    each.refuse(f"there is no joint `{joint}`")
                key = "forcerange" if "forcerange" in given else "ctrlrange" if each.tag == "motor" else None
                if key is not None and key in given:
                    low, high = numbers_in(each, given, key, 2)
                    gear = numbers_of(each, "gear", given.get("gear", "1"), None)[:1] or (1.0,)
                    efforts[joint] = max(abs(low), abs(high)) * abs(gear[0])
        return efforts

    # -- properties

    def joints(self) -> dict[str, RobotJoint]:
        """Return the joints that move, by their names, in the order of the file."""
        found = {}
        for name, (element, given) in self._joints.items():
            turns = given.get("type", "hinge") == "hinge"
            limited = given.get("limited", "auto")
            lower, upper = -math.inf, math.inf
            if "range" in given and (limited == "true" or (limited == "auto" and self._auto)):
                factor = math.pi / 180.0 if turns and self._degrees else 1.0
                lower, upper = (factor * each for each in numbers_in(element, given, "range", 2))
            effort = self._efforts.get(name, math.inf)
            if "actuatorfrcrange" in given and given.get("actuatorfrclimited", "auto") != "false":
                effort = min(effort, max(map(abs, numbers_in(element, given, "actuatorfrcrange", 2))))
            found[name] = RobotJoint(name, turns, lower, upper, effort, math.inf, element)
        return found

    def articulation(self, paths: Mapping[str, Path], scale: float = 1.0, name: str = "") -> Articulation:
        """Return links, joints and visual shapes. Meshes are named by their paths.

        A body with several joints, or with one away from its origin, has links without looks between them.

        Args:
            paths: The files of the meshes, by the names that `meshes` has.
            scale: Scale factor of all lengths.
            name: Its name if the file has none.
        """
        links: list[Link] = []
        places: list[int] = []
        for body, parent, around in self._bodies:
            position, orientation = self._poses.pose(body, body.attrib) if parent >= 0 else (np.zeros(3), UNTURNED)
            carrier, label = places[parent] if parent >= 0 else -1, str(body.get("name"))
            joints = [each for each in body.children("joint") if each.get("name") in self._joints and parent >= 0]
            offset = np.zeros(3)
            for number, joint in enumerate(joints):
                _, given = self._joints[str(joint.get("name"))]
                at = np.array(numbers_in(joint, given, "pos", 3)) if "pos" in given else np.zeros(3)
                axis = np.array(numbers_in(joint, given, "axis", 3) if "axis" in given else (0.0, 0.0, 1.0))
                last = number == len(joints) - 1 and not at.any()
                links.append(
                    Link(
                        name=label if last else f"{label}/{joint.get('name')}",
                        parent=carrier,
                        position=triple(scale * (position + rotated(orientation, at - offset))),
                        orientation=quadruple(orientation),
                        joint=str(joint.get("name")),
                        motion="turn" if given.get("type", "hinge") == "hinge" else "slide",
                        axis=triple(axis / np.linalg.norm(axis)),
                        visuals=self._looks.visuals(body, around, paths, scale) if last else (),
                    )
                )
                carrier, position, orientation, offset = len(links) - 1, np.zeros(3), UNTURNED, at
            if not joints or offset.any():
                links.append(
                    Link(
                        name=label,
                        parent=carrier,
                        position=triple(scale * (position - offset)),
                        orientation=quadruple(orientation),
                        visuals=self._looks.visuals(body, around, paths, scale),
                    )
                )
            places.append(len(links) - 1)
        return Articulation(name=self.name or name, links=tuple(links))

    def rolling_radius(self, joint: str) -> float | None:
        """Return the radius of the round shape that a joint carries, such as a wheel [m]; None without one."""
        for body, _, around in self._bodies:
            if all(each.get("name") != joint for each in body.children("joint")):
                continue
            for geometry in body.children("geom"):
                given = self._defaults.attributes(geometry, around)
                if given.get("type", "mesh" if "mesh" in given else "sphere") in ("cylinder", "sphere", "capsule"):
                    return numbers_of(geometry, "size", given["size"], None)[0]
        return None


def _copied(whole: XmlElement) -> XmlElement:
    root = XmlElement("mujoco", {"model": whole.get("model") or "robot"})
    root.line, root.column = whole.line, whole.column
    return root
