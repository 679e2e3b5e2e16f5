"""Robots from URDF and MJCF files, read and checked by SymAware, and passed to MuJoCo without mesh files."""

from __future__ import annotations

import copy
import re
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from symaware_cli.assets import AssetError, AssetFolders, MjcfDescription, Robot, RobotDescription, asset, read_mesh
from symaware_cli.core import Mjcf, Urdf, WorldError
from symaware_cli.geometry import Array

#: Settings by which MuJoCo reads descriptions: links with fixed joints stay links, and visual shapes are left out.
_COMPILER = {
    "fusestatic": "false",
    "discardvisual": "true",
    "strippath": "false",
    "balanceinertia": "true",
    # A link without mass gets a small one, as the engine moves no body without mass [kg], [kg m^2].
    "boundmass": "1e-6",
    "boundinertia": "1e-9",
}


def read_robot(file: Urdf | Mjcf, folders: AssetFolders, *where: str) -> Any:
    """Return the specification of a robot, whose first body is its base, with collision shapes only.

    Args:
        file: The file.
        folders: The folders to which the name of the file is relative.
        where: The path of the shape, for messages.

    Raises:
        WorldError: The file is damaged, or describes something that this world does not move.
    """
    kind = "urdf" if isinstance(file, Urdf) else "mjcf"
    place = (*where, kind, "file")
    robot = asset.described(file.file, folders, *place, missing=file.missing)
    unsupported = robot.description.unsupported_joint(follow=True)
    if unsupported is not None:
        raise WorldError(unsupported.located(file.file), *place)
    if file.scale != 1.0:
        raise WorldError("this world has robots in the size of their files only", *where, kind, "scale")
    root = copy.deepcopy(robot.description.root)
    hulls = _Hulls(robot, place)
    (hulls.replace_in_urdf if isinstance(file, Urdf) else hulls.replace_in_mjcf)(root)
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        for mesh in spec.meshes:
            if mesh.file:
                mesh.uservert, mesh.file = hulls.corners[mesh.file].ravel().tolist(), ""
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        if isinstance(robot.description, RobotDescription):
            _follow(spec, robot.description)
        model = spec.copy().compile()
    except ValueError as error:
        # Line numbers in messages refer to the text given to the engine.
        told = re.sub(r",? line \d+", "", " ".join(str(error).split()))
        raise WorldError(f"MuJoCo cannot load `{file.file}`: {told}", *place) from error
    if kind == "mjcf":
        _leave_out_looks(spec, model)
    return spec


class _Hulls:
    """Replaces mesh files by short names, and collects the vertices of the meshes."""

    def __init__(self, robot: Robot, place: tuple[str, ...]) -> None:
        self.corners: dict[str, Array] = {}
        self._robot, self._place = robot, place

    def replace_in_urdf(self, root: ElementTree.Element) -> None:
        for element in list(root):
            if element.tag not in ("link", "joint"):
                root.remove(element)
        for link in root.iterfind("link"):
            for visual in link.findall("visual"):
                link.remove(visual)
            for mesh in link.iter("mesh"):
                mesh.set("filename", self._name(mesh.get("filename") or ""))
            for inertia in link.iterfind("inertial/inertia"):
                _make_possible(inertia)
        for axis in root.iterfind("joint/axis"):
            # A fixed joint needs no axis, but the engine requires one.
            axis.set("xyz", axis.get("xyz") or "1 0 0")
        ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", _COMPILER)

    def replace_in_mjcf(self, root: ElementTree.Element) -> None:
        assert isinstance(self._robot.description, MjcfDescription)
        for mesh in root.iterfind("asset/mesh"):
            named = self._robot.description.mesh_file(mesh.get("name") or "")
            if named is not None:
                mesh.set("file", self._name(named))

    def _name(self, file: str) -> str:
        path = self._robot.paths[file]
        try:
            corners = np.unique(read_mesh(path).triangles.reshape(-1, 3), axis=0)
        except AssetError as error:
            raise WorldError(error.located(path.name), *self._place) from error
        # Files in different folders may have the same name.
        name = f"{len(self.corners)}.obj"
        self.corners[name] = corners
        return name


def _make_possible(inertia: ElementTree.Element) -> None:
    """Change an impossible inertia, one that is not positive, to the nearest possible one.

    Missing products of inertia are 0.
    """
    pairs = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    for pair in pairs:
        inertia.set(pair, inertia.get(pair) or "0")
    xx, xy, xz, yy, yz, zz = (float(inertia.get(pair) or 0.0) for pair in pairs)
    values, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    if values[0] > 0.0:
        return
    nearest = axes @ np.diag(np.maximum(values, 1e-9)) @ axes.T
    for pair, value in zip(pairs, nearest[np.triu_indices(3)].tolist(), strict=True):
        inertia.set(pair, repr(value))


def _follow(spec: Any, description: RobotDescription) -> None:
    """Couple joints to those that they mimic."""
    for joint, (other, factor, offset) in description.followers().items():
        equality = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
        equality.name1, equality.name2 = joint, other
        equality.data[:5] = [offset, factor, 0.0, 0.0, 0.0]


def _leave_out_looks(spec: Any, model: Any) -> None:
    """Delete the shapes that do not collide, and keep the masses and inertias of bodies."""
    for body in spec.bodies[1:]:
        known = model.body(body.name)
        body.mass, body.ipos, body.iquat = float(known.mass[0]), known.ipos, known.iquat
        body.inertia, body.explicitinertial = known.inertia, True
    for geometry in list(spec.geoms):
        if not geometry.contype and not geometry.conaffinity:
            spec.delete(geometry)


def lowest(spec: Any, quaternion: Array) -> float:
    """Return the height of the lowest point of a robot relative to the origin of its base [m].

    Args:
        spec: The robot.
        quaternion: The orientation of its base (w, x, y, z).
    """
    alone = spec.copy()
    alone.worldbody.first_body().quat = quaternion
    model = alone.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    lows = []
    for number in range(model.ngeom):
        down, size = data.geom_xmat[number].reshape(3, 3)[2], model.geom_size[number]
        match model.geom_type[number]:
            case mujoco.mjtGeom.mjGEOM_BOX:
                reach = float(np.abs(down) @ size)
            case mujoco.mjtGeom.mjGEOM_SPHERE:
                reach = float(size[0])
            case mujoco.mjtGeom.mjGEOM_CAPSULE:
                reach = float(size[0] + abs(down[2]) * size[1])
            case mujoco.mjtGeom.mjGEOM_CYLINDER:
                reach = float(abs(down[2]) * size[1] + np.sqrt(max(0.0, 1.0 - down[2] ** 2)) * size[0])
            case _:
                mesh = model.geom_dataid[number]
                first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
                reach = -float((model.mesh_vert[first : first + count] @ down).min())
        lows.append(float(data.geom_xpos[number][2]) - reach)
    return min(lows, default=0.0)
