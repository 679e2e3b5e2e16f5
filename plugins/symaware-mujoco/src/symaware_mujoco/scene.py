"""Scenes: the bodies of a scenario as a model of MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from symaware_cli.assets import AssetError, AssetFolders, Mechanism, Posture, asset, read_mesh
from symaware_cli.core import Entity, Mesh, Obstacle, Shape, WorldError
from symaware_cli.geometry import Array, Articulation, Visual, attitude
from symaware_mujoco.bounce import IMPEDANCE
from symaware_mujoco.robot import lowest, read_robot

#: Bits of collisions: two geometries collide if one has a bit as its type that the other has as its affinity.
GROUND, BODY, FIXED, ON_PATH = 1, 2, 4, 8

#: Groups of geometries, which rays select by: entities, agents, the ground, shapes for cameras only, and invisible
#: shapes, such as those of absent agents.
ENTITIES, AGENTS, FLOOR, LOOKS, HIDDEN = 0, 1, 2, 3, 5

#: [kg] The mass of bodies on paths, so great that nothing diverts them.
IMMOVABLE = 1e6

#: [m] The radius of a body without a shape, for its inertia.
_POINT = 0.1

#: [kg m^2] The inertia of a rotor, so great that no load slows it down.
_ROTOR = 1e4

#: [N m] The torque of a clutch before it is set.
_SLIPPING = 1e-9

#: The precision with which a clutch brings a joint to the rate of its rotor in a physics step.
_GRIP = 0.999

#: [byte] The memory limit of the engine for contacts and joint forces; memory is allocated when needed. The default of
#: the engine is too little for a heap of a hundred bodies.
_MEMORY = 512 * 2**20

#: [m] The distance at which bodies begin to push each other, so that stacked bodies do before they fall.
MARGIN = 1e-5

#: [m] The distance up to which a contact lasts once it has begun, as bodies in contact part for single physics steps.
NEAR = 5e-4


class Surface(NamedTuple):
    """The properties of a geometry in contacts, and its owner.

    Attributes:
        owner: The index of the agent, the entity or the ground.
        friction: The coefficient of friction, to be multiplied by that of the other body.
        elasticity: The elasticity, to be multiplied by that of the other body.
    """

    owner: int
    friction: float
    elasticity: float


class Scene:
    """Collects bodies, from which `compile` creates the model.

    Attributes:
        surfaces: The surface of each geometry, by its name.
        levels: The height of each entity, by its name [m].
    """

    def __init__(
        self,
        step: float,
        gravity: Sequence[float],
        iterations: int,
        height: float,
        floor: float | None,
        folders: AssetFolders,
    ) -> None:
        """Begin an empty scene.

        Args:
            step: The physics step [s].
            gravity: The gravity [m/s^2]; shape (3,).
            iterations: The most iterations of the solver in a step.
            height: The height of shapes that define none [m].
            floor: The height of the ground [m]; None without one.
            folders: The folders to which names of files are relative.
        """
        self._spec = mujoco.MjSpec()
        self._spec.memory = _MEMORY
        option = self._spec.option
        option.timestep, option.gravity, option.iterations = step, list(gravity), iterations
        # Elliptic cones, and friction much stiffer than the forces that it resists, so that bodies at rest do not
        # creep.
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 100.0
        option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        # States that are not finite end a run (see `engine_warnings`); by default the engine would reset itself.
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self._spec.compiler.autolimits = False
        self._height, self._floor, self._folders = height, floor, folders
        self._meshes: dict[tuple[str, float], Sequence[Array]] = {}
        self.surfaces: dict[str, Surface] = {}
        self.levels: dict[str, float] = {}

    def add_ground(self, height: float, surface: Surface) -> None:
        """Add the ground, a plane."""
        self._add(
            self._spec.worldbody,
            surface,
            GROUND,
            0,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0, 0, 1],
            pos=[0, 0, height],
        )

    def level(self, shape: Shape | None, *where: str) -> float:
        """Return the height of the origin of a body that stands on the ground [m]; `where` is its path."""
        if self._floor is None:
            return 0.0
        if shape is None:
            return self._floor
        if shape.mesh:
            return self._floor - min(float(each[:, 2].min()) for each in self._parts(shape.mesh, *where))
        if shape.circle:
            return self._floor + shape.circle.radius
        if shape.box:
            return self._floor + 0.5 * shape.box.upright
        return self._floor + 0.5 * (shape.cylinder.height if shape.cylinder else self._height)

    def add_agent(
        self, name: str, entity: Entity, height: float | None, turns: bool, surface: Surface, *where: str
    ) -> None:
        """Add an upright body, which is moved by the forces of its agent, without gravity.

        Args:
            name: The id of the agent.
            entity: The body of the agent.
            height: The height of the body, if it moves in a plane [m].
            turns: Whether the body turns about the vertical.
            surface: Its surface.
            where: The path of the body, for messages.
        """
        body = self._spec.worldbody.add_body(name=body_name(name), pos=[0.0, 0.0, height or 0.0], gravcomp=1.0)
        for axis, letter in enumerate("xyz" if height is None else "xy"):
            body.add_joint(name=f"{name}/{letter}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=_unit(axis))
        if turns:
            body.add_joint(name=f"{name}/heading", type=mujoco.mjtJoint.mjJNT_HINGE, axis=_unit(2))
        affinity = BODY | FIXED | ON_PATH | (GROUND if height is None else 0)
        self._add_shape(body, entity.shape, entity.mass, surface, BODY, affinity, where)

    def add_obstacle(self, name: str, obstacle: Obstacle, surface: Surface) -> None:
        """Add an entity: free, on a path, or fixed."""
        pose, where = obstacle.pose(), ("environment", "entities", name)
        x, y, *rest = pose.position
        qx, qy, qz, qw = attitude(obstacle.roll, obstacle.pitch, pose.heading).tolist()
        if obstacle.shape.robot:
            self._add_robot(name, obstacle, (x, y, *rest), [qw, qx, qy, qz], surface)
            return
        height = rest[0] if rest else self.level(obstacle.shape, *where)
        self.levels[name] = height
        body = self._spec.worldbody.add_body(name=body_name(name), pos=[x, y, height], quat=[qw, qx, qy, qz])
        everything = GROUND | BODY | FIXED | ON_PATH
        if obstacle.is_free:
            body.add_freejoint(name=f"{name}/free")
            self._add_shape(body, obstacle.shape, obstacle.mass or 0.0, surface, BODY, everything, where)
        elif obstacle.path:
            body.gravcomp = 1.0
            body.add_freejoint(name=f"{name}/free")
            self._add_shape(body, obstacle.shape, IMMOVABLE, surface, ON_PATH, 0, where)
        else:
            self._add_shape(body, obstacle.shape, 0.0, surface, FIXED, 0, where)

    def _add_robot(
        self, name: str, obstacle: Obstacle, position: Sequence[float], quaternion: Sequence[float], surface: Surface
    ) -> None:
        where, file = ("environment", "entities", name, "shape"), obstacle.shape.robot
        assert file is not None
        if obstacle.path:
            raise WorldError("this world has no robots from files on paths", *where[:-1], "path")
        robot = read_robot(file, self._folders, *where)
        x, y, *rest = position
        height = rest[0] if rest else (self._floor or 0.0) - lowest(robot, np.array(quaternion))
        self.levels[name] = height
        joint = "free" if obstacle.is_free else None
        self.attach(name, robot, surface, joint, [x, y, height], quaternion)

    def add_robot_agent(
        self, id: str, shape: Shape, posture: Posture, mechanism: Mechanism, surface: Surface, *where: str
    ) -> float:
        """Add a robot from a file whose joints have motors, and return the height of its base [m].

        Args:
            id: The id of the agent.
            shape: The shape with the file.
            posture: The posture, with the pose of its base.
            mechanism: Whether its base is free, and whether it stands on the ground.
            surface: Its surface.
            where: The path of the body, for messages.
        """
        assert shape.robot is not None
        robot = read_robot(shape.robot, self._folders, *where, "shape")
        x, y, z, w = posture.orientation
        quaternion = [w, x, y, z]
        place = [*posture.position]
        if mechanism.stands:
            place[2] = (self._floor or 0.0) - lowest(robot, np.array(quaternion))
        self.attach(id, robot, surface, None if mechanism.is_fixed else "base", place, quaternion)
        return float(place[2])

    def attach(
        self,
        name: str,
        robot: Any,
        surface: Surface,
        joint: str | None = "free",
        position: Sequence[float] = (0.0, 0.0, 0.0),
        quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
    ) -> Any:
        """Add a robot, and return its base.

        Args:
            name: The name of the agent or entity, a prefix of the names of its joints and links.
            robot: The specification of the robot, which becomes part of this scene.
            surface: The surface of all its links.
            joint: The name of the joint by which its base is free; None if it is fixed.
            position: The origin of the base [m].
            quaternion: The orientation of the base (w, x, y, z).
        """
        frame = self._spec.worldbody.add_frame(pos=list(position), quat=list(quaternion))
        base = frame.attach_body(robot.worldbody.first_body(), f"{name}/", "")
        if joint is not None:
            base.add_freejoint(name=f"{name}/{joint}")
        bodies = [base, *base.find_all(mujoco.mjtObj.mjOBJ_BODY)]
        for number, body in enumerate(bodies):
            # Links of one robot pass through each other.
            for other in bodies[:number]:
                self._spec.add_exclude(bodyname1=other.name, bodyname2=body.name)
            moves = joint is not None or body is not base
            kind, affinity = (BODY, GROUND | BODY | FIXED | ON_PATH) if moves else (FIXED, 0)
            for geometry in body.geoms:
                self._register(geometry, surface, kind, affinity)
        return base

    def dress(self, name: str, described: Articulation, surface: Surface) -> None:
        """Add the visual shapes of a robot, which only cameras see.

        Args:
            name: The name of the agent or entity, which was attached.
            described: The links of the robot with their visual shapes.
            surface: The surface, whose owner is used.
        """
        for link in described.links:
            body = self._spec.body(f"{name}/{link.name}")
            for visual in link.visuals:
                self._add_look(body, visual, surface)

    def _add_look(self, body: Any, visual: Visual, surface: Surface) -> None:
        x, y, z, w = visual.orientation
        options: dict[str, Any] = {"pos": visual.position, "quat": [w, x, y, z], "mass": 0.0, "group": LOOKS}
        options["rgba"] = [1.0, 1.0, 1.0, 1.0] if visual.colour is None else visual.colour
        if visual.kind == "mesh":
            faces = read_mesh(Path(visual.mesh)).triangles.reshape(-1, 3) * np.array(visual.size)
            corners, places = np.unique(faces, axis=0, return_inverse=True)
            mesh = self._spec.add_mesh(name=f"look{len(self.surfaces)}", uservert=corners.ravel().tolist())
            mesh.userface, mesh.inertia = places.ravel().tolist(), mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            options |= {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": mesh.name}
        elif visual.kind == "box":
            options |= {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [0.5 * each for each in visual.size]}
        elif visual.kind == "sphere":
            options |= {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [visual.size[0], 0.0, 0.0]}
        elif visual.kind in ("cylinder", "capsule"):
            kind = mujoco.mjtGeom.mjGEOM_CYLINDER if visual.kind == "cylinder" else mujoco.mjtGeom.mjGEOM_CAPSULE
            options |= {"type": kind, "size": [visual.size[0], 0.5 * visual.size[1], 0.0]}
        else:
            return
        self._add(body, surface, 0, 0, **options)

    def add_clutch(self, joint: str) -> None:
        """Connect a joint by a clutch to a separate rotor, whose rate no load changes.

        The clutch is dry friction between both rates: it brings the joint to the rate of the rotor within its torque,
        which is initially 0. The rotor has the name of the joint with `/rotor` behind it, the clutch with `/clutch`.
        """
        body = self._spec.worldbody.add_body(name=f"{joint}/rotor")
        body.mass, body.inertia, body.ipos, body.explicitinertial = 1e-3, [1e-6] * 3, [0, 0, 0], True
        body.add_joint(name=f"{joint}/rotor", type=mujoco.mjtJoint.mjJNT_HINGE, axis=_unit(2), armature=_ROTOR)
        clutch = self._spec.add_tendon(name=f"{joint}/clutch")
        clutch.wrap_joint(joint, 1.0)
        clutch.wrap_joint(f"{joint}/rotor", -1.0)
        # A tiny torque, as the engine leaves out constraints without any.
        clutch.frictionloss = _SLIPPING
        clutch.solref_friction = [-1.0, -1.0 / self._spec.option.timestep]
        clutch.solimp_friction = [_GRIP, _GRIP, 0.001, 0.5, 2.0]

    def _add_shape(
        self,
        body: Any,
        shape: Shape | None,
        mass: float,
        surface: Surface,
        kind: int,
        affinity: int,
        where: tuple[str, ...],
    ) -> None:
        if shape is None:
            moment = 0.4 * mass * _POINT * _POINT
            body.mass, body.inertia, body.ipos, body.explicitinertial = mass, [moment] * 3, [0, 0, 0], True
            return
        common = {"mass": mass}
        if shape.circle:
            self._add(
                body,
                surface,
                kind,
                affinity,
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[shape.circle.radius, 0, 0],
                **common,
            )
        elif shape.cylinder:
            size = [shape.cylinder.radius, 0.5 * shape.cylinder.height, 0]
            self._add(body, surface, kind, affinity, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, **common)
        elif shape.box:
            size = [0.5 * shape.box.length, 0.5 * shape.box.width, 0.5 * shape.box.upright]
            self._add(body, surface, kind, affinity, type=mujoco.mjtGeom.mjGEOM_BOX, size=size, **common)
        elif shape.polygon:
            half = 0.5 * self._height
            corners = [(x, y, z) for x, y in shape.polygon.vertices for z in (-half, half)]
            self._add_hull(body, surface, kind, affinity, np.array(corners), mass)
        elif shape.mesh:
            parts = self._parts(shape.mesh, *where)
            for each in parts:
                self._add_hull(body, surface, kind, affinity, each, mass / len(parts))
        elif shape.wall:
            self._add_wall(body, shape, mass, surface, kind, affinity)
        else:
            said = "a robot from a file is an agent of a model that drives its joints, such as `articulated`"
            raise WorldError(said, *where, "shape", shape.kind)

    def _add_hull(self, body: Any, surface: Surface, kind: int, affinity: int, corners: Array, mass: float) -> None:
        """Add the convex hull of some corners; shape (n, 3)."""
        name = f"hull{len(self.surfaces)}"
        convex = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        self._spec.add_mesh(name=name, uservert=corners.ravel().tolist(), inertia=convex)
        self._add(body, surface, kind, affinity, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=mass)

    def _parts(self, mesh: Mesh, *where: str) -> Sequence[Array]:
        """Return the corners of each convex part of a mesh [m], shape (n, 3)."""
        key = (mesh.file, mesh.scale)
        if key not in self._meshes:
            place = (*where, "shape", "mesh", "file")
            asset.check(mesh.file, self._folders, *place)
            try:
                surface = read_mesh(asset.find(mesh.file, self._folders, *place))
            except AssetError as error:
                raise WorldError(error.located(mesh.file), *place) from error
            parts = np.split(surface.triangles, np.cumsum(surface.parts)[:-1])
            found = [np.unique(each.reshape(-1, 3), axis=0) * mesh.scale for each in parts if len(each)]
            if any(np.linalg.matrix_rank(each - each.mean(axis=0), tol=1e-9) < 3 for each in found):
                raise WorldError(
                    f"a part of `{mesh.file}` is flat, and this world has bodies with a volume only", *place
                )
            self._meshes[key] = found
        return self._meshes[key]

    def _add_wall(self, body: Any, shape: Shape, mass: float, surface: Surface, kind: int, affinity: int) -> None:
        wall = shape.wall
        assert wall is not None
        half, height = 0.5 * wall.thickness, 0.5 * self._height
        parts = 2 * len(wall.points) - 1
        for (x, y), (to_x, to_y) in pairwise(wall.points):
            angle = 0.5 * math.atan2(to_y - y, to_x - x)
            self._add(
                *(body, surface, kind, affinity),
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[0.5 * math.dist((x, y), (to_x, to_y)), half, height],
                pos=[0.5 * (x + to_x), 0.5 * (y + to_y), 0.0],
                quat=[math.cos(angle), 0.0, 0.0, math.sin(angle)],
                mass=mass / parts,
            )
        for x, y in wall.points:
            size = [half, height, 0]
            self._add(
                *(body, surface, kind, affinity),
                type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=size,
                pos=[x, y, 0.0],
                mass=mass / parts,
            )

    def _add(self, body: Any, surface: Surface, kind: int, affinity: int, **options: Any) -> None:
        self._register(body.add_geom(**options), surface, kind, affinity)

    def _register(self, geometry: Any, surface: Surface, kind: int, affinity: int) -> None:
        geometry.name = f"{surface.owner}/{len(self.surfaces)}"
        self.surfaces[geometry.name] = surface
        geometry.contype, geometry.conaffinity = kind, affinity
        geometry.margin, geometry.gap = 0.5 * MARGIN, 0.5 * NEAR
        geometry.solimp = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0]

    def compile(self) -> Any:
        """Return the model.

        Raises:
            WorldError: MuJoCo refuses the model.
        """
        try:
            return self._spec.compile()
        except ValueError as error:
            raise WorldError(f"MuJoCo refuses the scene: {' '.join(str(error).split())}", "environment") from error


def body_name(name: str) -> str:
    """Return the name of a body in the engine, which reserves the name `world`."""
    return f"{name}/body"


def _unit(axis: int) -> list[float]:
    return [float(axis == other) for other in range(3)]
