"""Robots from URDF files: read and checked by SymAware, and handed to MuJoCo without the files of its meshes."""

from __future__ import annotations

import copy
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from symaware_cli.assets import AssetError, AssetFolders, asset, read_mesh
from symaware_cli.core import Urdf, WorldError
from symaware_cli.geometry import Array

#: How MuJoCo reads a description: links that no joint moves stay links, and what they look like is left out.
_COMPILER = {"fusestatic": "false", "discardvisual": "true", "strippath": "false", "balanceinertia": "true"}


def read_robot(urdf: Urdf, folders: AssetFolders, *where: str) -> Any:
    """Return the specification of a robot, whose first body is its base.

    Args:
        urdf: The file.
        folders: The folders to which its name is relative.
        where: The path of the shape, for messages.

    Raises:
        WorldError: The file is damaged, or describes something that this world does not move.
    """
    place = (*where, "urdf", "file")
    robot = asset.described(urdf.file, folders, *place)
    unsupported = robot.description.unsupported_joint()
    if unsupported is not None:
        raise WorldError(unsupported.located(urdf.file), *place)
    if urdf.scale != 1.0:
        raise WorldError("this world has robots in the size of their files only", *where, "urdf", "scale")
    root = copy.deepcopy(robot.description.root)
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
    hulls: dict[str, Array] = {}
    for link in root.iterfind("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        for mesh in link.iter("mesh"):
            path = robot.paths[mesh.get("filename") or ""]
            try:
                corners = np.unique(read_mesh(path).triangles.reshape(-1, 3), axis=0)
            except AssetError as error:
                raise WorldError(error.located(path.name), *place) from error
            # Names of files may be the same in several folders.
            name = f"{len(hulls)}.obj"
            hulls[name] = corners
            mesh.set("filename", name)
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", _COMPILER)
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        for mesh in spec.meshes:
            mesh.uservert, mesh.file = hulls[mesh.file].ravel().tolist(), ""
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        spec.copy().compile()
    except ValueError as error:
        raise WorldError(f"MuJoCo cannot load `{urdf.file}`: {' '.join(str(error).split())}", *place) from error
    return spec


def lowest(spec: Any, quaternion: Array) -> float:
    """Return how far a robot reaches below its origin, as a height of at most 0 or more [m].

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
