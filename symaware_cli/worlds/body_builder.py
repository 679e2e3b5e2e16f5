"""Body builder: creates PyBullet bodies from the shapes of a scenario, and the ground that they stand on.

The ground is a plane for balls and wheels, and a slab of the same height for all other bodies: on a plane PyBullet
finds only one more contact point of a box in each physics step, so a box that lands flat is tipped first, and a sliding
box turns. On another box it finds all four at once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from symaware_cli.assets import MimicJoint, asset
from symaware_cli.assets.asset import AssetFolders, Robot
from symaware_cli.core import Entity, Shape, Urdf, Wall, WorldError
from symaware_cli.geometry import HeightRange, attitude
from symaware_cli.worlds.bullet import engine, quiet
from symaware_cli.worlds.bullet_collisions import COLLIDES_WITH, FACED, FIXED, FREE
from symaware_cli.worlds.engine_files import EngineFiles

#: The types of joints with one degree of freedom.
_MOVING = (engine.JOINT_REVOLUTE, engine.JOINT_PRISMATIC)

#: [N] or [N m] What the gear of a joint that follows another may take, and the part of its error that a physics step
#: corrects.
_GEAR_FORCE, _GEAR_CORRECTION = 1e4, 0.5

#: [m] Larger than any distance between a body and the ground.
_ANY_DISTANCE = 1e3

#: [m] How far the slab reaches beyond the bodies' initial positions, and its thickness. The larger it is, the less
#: exact are its contacts with round faces, which the engine computes from the corners.
_REACH = 1000.0

#: [m] How much higher the slab is than the plane: the engine misses the contacts of boxes that only just touch.
_RAISED = 1e-5


class BodyPart(NamedTuple):
    """One of the bodies that an entity consists of.

    Attributes:
        body: The engine's id of the body.
        x: Position in the coordinates of the entity [m].
        y: The other coordinate [m].
        heading: Heading relative to that of the entity [rad].
    """

    body: int
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0


class BodyBuilder:
    """Creates the bodies of one world."""

    def __init__(
        self, client: int, folders: AssetFolders, files: EngineFiles, height: float, floor: float | None, loading: int
    ) -> None:
        """Initialise the builder of a world.

        Args:
            client: The engine's client.
            folders: The folders to which the scenario's file names are relative.
            files: Makes the files that the engine loads.
            height: Height of shapes without one of their own [m].
            floor: The height of the ground [m]; None without a ground.
            loading: Flags for loading URDF files.
        """
        self._client = client
        self._folders = folders
        self._files = files
        self._robots: dict[tuple[str, str], tuple[Path, dict[str, MimicJoint]]] = {}
        self._height = height
        self._floor = floor
        self._loading = loading
        self._collision_shapes: dict[str, int] = {}

    def _standing_height(self, shape: Shape | None) -> float:
        """The height of a planar body that stands on the ground [m]; 0 for files, whose extent is not known yet."""
        return 0.0 if self._floor is None else self._floor + self._half_height(shape)

    def _half_height(self, shape: Shape | None) -> float:
        """The height of a shape's origin above the ground that it stands on [m]."""
        if shape is None or shape.mesh or shape.urdf:
            return 0.0
        if shape.circle:
            return shape.circle.radius
        if shape.box:
            return 0.5 * shape.box.upright
        return 0.5 * (shape.cylinder.height if shape.cylinder else self._height)

    def make(
        self,
        mass: float,
        shape: Shape | None,
        position: Sequence[float],
        orientation: Sequence[float],
        *where: str,
        held: bool = False,
    ) -> int:
        """Create a body of any shape but a wall.

        Args:
            mass: Its mass [kg], 0 for a fixed body; a body from a URDF file has the masses of the file unless 0.
            shape: Its shape.
            position: Its position [m]; with two coordinates it stands on the ground.
            orientation: A quaternion (x, y, z, w).
            *where: Path in the scenario, for messages.
            held: Whether the joints of a URDF file are held in their positions.
        """
        if shape is not None and shape.mjcf:
            raise WorldError("this world has no robots from MJCF files", *where, "shape", "mjcf", needs="mechanisms")
        place = position if len(position) == 3 else (*position, self._standing_height(shape))
        if shape is not None and shape.urdf:
            body = self._load(mass, shape.urdf, place, orientation, *where)
            if not held:
                self._release_joints(body)
                self._couple(body, self._robots[shape.urdf.file, shape.urdf.missing][1], shape.urdf.scale)
        else:
            body = self._body(mass, self._collision_shape(shape, *where), place, orientation)
        # `_standing_height` is exact for upright bodies with a shape of their own only.
        known = shape is None or not (shape.mesh or shape.urdf or any(orientation[:2]))
        if len(position) == 2 and self._floor is not None and not known:
            self._place_on_ground(body, self._floor)
        return body

    def make_plane(self, height: float) -> int:
        """Create the infinite plane that balls and vehicles stand on, at a height [m]."""
        shape = engine.createCollisionShape(engine.GEOM_PLANE, physicsClientId=self._client)
        return self._body(0.0, shape, (0.0, 0.0, height), turn(0.0))

    def make_slab(self, height: float, starts: Iterable[Sequence[float]]) -> int:
        """Create the slab that all other bodies stand on, around their initial positions.

        Args:
            height: The height of its top [m].
            starts: Initial positions of these bodies; at least one.
        """
        places = np.array([start[:2] for start in starts])
        low, high = places.min(axis=0), places.max(axis=0)
        half = [*(0.5 * (high - low) + _REACH).tolist(), 0.5 * _REACH]
        shape = engine.createCollisionShape(engine.GEOM_BOX, halfExtents=half, physicsClientId=self._client)
        x, y = (0.5 * (low + high)).tolist()
        # The plane is visible instead. Without a visual shape the slab would be drawn as its collision shape.
        speck = engine.createVisualShape(engine.GEOM_SPHERE, radius=1e-3, physicsClientId=self._client)
        return self._body(0.0, shape, (x, y, height + _RAISED - 0.5 * _REACH), turn(0.0), speck)

    def _body(
        self, mass: float, outline: int, position: Sequence[float], orientation: Sequence[float], look: int = -1
    ) -> int:
        body: int = engine.createMultiBody(
            mass, outline, look, position, orientation, useMaximalCoordinates=1, physicsClientId=self._client
        )
        return body

    def _load(
        self, mass: float, urdf: Urdf, position: Sequence[float], orientation: Sequence[float], *where: str
    ) -> int:
        key = urdf.file, urdf.missing
        if key not in self._robots:
            robot = asset.described(urdf.file, self._folders, *where, "shape", "urdf", "file", missing=urdf.missing)
            unsupported = robot.description.unsupported_joint(follow=True)
            if unsupported is not None:
                raise WorldError(unsupported.located(urdf.file), *where, "shape", "urdf", "file")
            self._robots[key] = self.robot_file(robot), robot.description.followers()
        file, _ = self._robots[key]
        body = self.load_robot(
            file,
            urdf.file,
            position,
            orientation,
            engine.URDF_USE_INERTIA_FROM_FILE,
            *(*where, "shape", "urdf", "file"),
            useFixedBase=mass == 0.0,
            globalScaling=urdf.scale,
        )
        self._check(body, urdf.file, mass > 0.0, *where, "shape", "urdf", "file")
        return body

    def _couple(self, body: int, followers: Mapping[str, MimicJoint], scale: float) -> None:
        """Let joints follow those that they mimic, by gears."""
        known = [engine.getJointInfo(body, number, self._client) for number in self.moving_joints(body)]
        joints = {info[1].decode(): (info[0], info[2] == engine.JOINT_PRISMATIC) for info in known}
        for name, follower in followers.items():
            (number, slides), (other, other_slides) = joints[name], joints[follower.joint]
            offset = follower.offset * scale**slides
            engine.resetJointState(body, number, offset, physicsClientId=self._client)
            gear = engine.createConstraint(
                *(body, number, body, other, engine.JOINT_GEAR, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                physicsClientId=self._client,
            )
            engine.changeConstraint(
                gear,
                gearRatio=-follower.factor * scale ** (slides - other_slides),
                relativePositionTarget=offset,
                maxForce=_GEAR_FORCE,
                erp=_GEAR_CORRECTION,
                physicsClientId=self._client,
            )

    def robot_file(self, robot: Robot) -> Path:
        """Return the file of a robot for `load_robot`."""
        return self._files.robot(robot, pictures=not self._loading & engine.URDF_IGNORE_VISUAL_SHAPES)

    def load_robot(
        self,
        file: Path,
        name: str,
        position: Sequence[float],
        orientation: Sequence[float],
        flags: int,
        *where: str,
        **options: Any,
    ) -> int:
        """Load a robot.

        Args:
            file: Its file, from `robot_file`.
            name: The name of the file that it was made from, for messages.
            position: [m]; shape (3,).
            orientation: A quaternion (x, y, z, w).
            flags: Additional flags for ``loadURDF``.
            where: Path in the scenario, for messages.
            options: Further arguments of ``loadURDF``.

        Returns:
            The engine's body.

        Raises:
            WorldError: The engine cannot load it.
        """
        with quiet() as output:
            try:
                body: int = engine.loadURDF(
                    str(file),
                    position,
                    orientation,
                    flags=flags | self._loading,
                    physicsClientId=self._client,
                    **options,
                )
            except engine.error:
                body = -1
        if body < 0:
            raise WorldError(f"PyBullet cannot load `{name}`: {told(output)}", *where)
        try:
            engine.getBasePositionAndOrientation(body, self._client)
        except engine.error as error:
            # So it is with some 130 joints and more.
            joints = engine.getNumJoints(body, self._client)
            raise WorldError(f"PyBullet cannot move `{name}`, which has {joints} joints", *where) from error
        return body

    def _release_joints(self, body: int) -> None:
        """Let the joints move with the friction of the file; by default the engine's motors hold them."""
        for number in self.moving_joints(body):
            friction = engine.getJointInfo(body, number, self._client)[7]
            engine.setJointMotorControl2(
                body, number, engine.VELOCITY_CONTROL, targetVelocity=0.0, force=friction, physicsClientId=self._client
            )

    def moving_joints(self, body: int) -> list[int]:
        """Return the engine's indices of a body's revolute and prismatic joints."""
        joints = range(engine.getNumJoints(body, self._client))
        return [number for number in joints if engine.getJointInfo(body, number, self._client)[2] in _MOVING]

    def _place_on_ground(self, body: int, floor: float) -> None:
        """Move a body vertically so that its lowest point touches the ground."""
        # Bounding boxes of rotated parts would be too large; the distance to a plane is exact.
        ground = self.make_plane(floor)
        near = engine.getClosestPoints(body, ground, _ANY_DISTANCE, physicsClientId=self._client)
        engine.removeBody(ground, self._client)
        (x, y, z), orientation = engine.getBasePositionAndOrientation(body, self._client)
        place = (x, y, z - min((point[8] for point in near), default=0.0))
        engine.resetBasePositionAndOrientation(body, place, orientation, self._client)

    def _check(self, body: int, file: str, moves: bool, *where: str) -> None:
        """Check that the engine supports the masses and the joints of a file."""
        masses = [engine.getDynamicsInfo(body, link, self._client)[0] for link in self._links(body)]
        wrong = [mass for mass in masses if not 0.0 <= mass < math.inf]
        if wrong:
            raise WorldError(f"`{file}` gives a link a mass of {wrong[0]:g}; it is a number greater than 0", *where)
        if moves and masses[0] == 0.0:
            raise WorldError(
                f"`{file}` gives its base no mass, and cannot be moved without one; without `mass`, the entity has a "
                "fixed base",
                *where,
            )
        carried = masses[1:]
        joints = [engine.getJointInfo(body, number, self._client) for number in range(len(carried))]
        for number, joint in reversed(list(enumerate(joints))):
            name, kind, parent = joint[1].decode(), joint[2], joint[16]
            if kind in _MOVING and carried[number] == 0.0:
                raise WorldError(f"`{file}` gives no mass to the link that its joint `{name}` moves", *where)
            if parent >= 0:
                carried[parent] += carried[number]

    def _collision_shape(self, shape: Shape | None, *where: str) -> int:
        """Return the engine's id of a collision shape; equal shapes share one."""
        if shape is None:
            return -1
        key = shape.model_dump_json()
        if key not in self._collision_shapes:
            with quiet():
                number = self._create_collision_shape(shape, *where)
            if number < 0:
                raise WorldError("PyBullet cannot make a body of this shape", *where, "shape", shape.kind)
            self._collision_shapes[key] = number
        return self._collision_shapes[key]

    def _create_collision_shape(self, shape: Shape, *where: str) -> int:
        arguments: dict[str, Any] = {"shapeType": engine.GEOM_MESH}
        if shape.circle:
            arguments = {"shapeType": engine.GEOM_SPHERE, "radius": shape.circle.radius}
        elif shape.cylinder:
            arguments = {
                "shapeType": engine.GEOM_CYLINDER,
                "radius": shape.cylinder.radius,
                "height": shape.cylinder.height,
            }
        elif shape.box:
            extents = (shape.box.length, shape.box.width, shape.box.upright)
            arguments = {"shapeType": engine.GEOM_BOX, "halfExtents": [0.5 * extent for extent in extents]}
        elif shape.polygon:
            half = 0.5 * self._height
            arguments["vertices"] = [[*corner, height] for corner in shape.polygon.vertices for height in (-half, half)]
        elif shape.mesh:
            place = (*where, "shape", "mesh", "file")
            asset.check(shape.mesh.file, self._folders, *place)
            arguments["fileName"] = str(self._files.mesh(asset.find(shape.mesh.file, self._folders, *place)))
            arguments["meshScale"] = [shape.mesh.scale] * 3
        try:
            number: int = engine.createCollisionShape(**arguments, physicsClientId=self._client)
        except engine.error:
            return -1
        return number

    def set_surface(self, body: int, friction: float, elasticity: float, damping: float) -> None:
        """Set friction, elasticity and damping [1/s] of a body and its links."""
        for link in self._links(body):
            engine.changeDynamics(
                body,
                link,
                lateralFriction=friction,
                restitution=elasticity,
                linearDamping=damping,
                angularDamping=damping,
                activationState=engine.ACTIVATION_STATE_DISABLE_SLEEPING,
                # Bodies that are near but do not touch yet are not pushed: they would bounce less.
                contactProcessingThreshold=0.0,
                physicsClientId=self._client,
            )

    def set_collision_kind(self, body: int, kind: int) -> None:
        """Set with which bodies a body collides, by its kind; links that move on a fixed base count as free bodies."""
        moved = set(self.moving_joints(body)) if kind == FIXED else set()
        for link in self._links(body):
            if link >= 0 and engine.getJointInfo(body, link, self._client)[16] in moved:
                moved.add(link)
            own = FACED if link in moved else kind
            engine.setCollisionFilterGroupMask(body, link, own, COLLIDES_WITH[own], self._client)

    def moment(self, body: int, entity: Entity) -> float:
        """The moment of inertia about the vertical [kg m^2]."""
        moment = float(engine.getDynamicsInfo(body, -1, self._client)[2][2]) if entity.shape else 0.0
        # A body without a shape has the inertia of a ball with a radius of 0.1 m.
        return moment or 0.4 * entity.mass * 0.01

    def span(self, bodies: Sequence[int], level: float) -> HeightRange:
        """Return the vertical extent of an entity's bodies relative to its level [m], as the engine has it now."""
        boxes = [engine.getAABB(body, link, self._client) for body in bodies for link in self._links(body)]
        return HeightRange(level, min(low[2] for low, _ in boxes) - level, max(high[2] for _, high in boxes) - level)

    def _links(self, body: int) -> range:
        """The base of a body, and all its links."""
        return range(-1, engine.getNumJoints(body, self._client))

    def make_wall(self, mass: float, wall: Wall, position: Sequence[float], heading: float) -> list[BodyPart]:
        """Create a box for each segment of a wall, and a cylinder for each of its points; fixed if the mass is 0.

        PyBullet allows at most 16 shapes in one body.
        """
        place = (*position[:2], self._standing_height(Shape(wall=wall)) if len(position) == 2 else position[2])
        half, height, members = 0.5 * wall.thickness, self._height, []

        def add(shape: int, x: float, y: float, turned: float) -> None:
            cosine, sine = math.cos(heading), math.sin(heading)
            where = (place[0] + cosine * x - sine * y, place[1] + sine * x + cosine * y, place[2])
            members.append(BodyPart(self._body(mass, shape, where, turn(heading + turned)), x, y, turned))

        for (x, y), (to_x, to_y) in pairwise(wall.points):
            extents = [0.5 * math.dist((x, y), (to_x, to_y)), half, 0.5 * height]
            shape = engine.createCollisionShape(engine.GEOM_BOX, halfExtents=extents, physicsClientId=self._client)
            add(shape, 0.5 * (x + to_x), 0.5 * (y + to_y), math.atan2(to_y - y, to_x - x))
        shape = engine.createCollisionShape(
            engine.GEOM_CYLINDER, radius=half, height=height, physicsClientId=self._client
        )
        for x, y in dict.fromkeys(wall.points):
            add(shape, x, y, 0.0)
        return members


def collision_kind(shape: Shape | None) -> int:
    """Return the collision kind of a free body: whether it collides with the plane or with the slab."""
    return FREE if shape is None or shape.circle else FACED


def turn(heading: float, roll: float = 0.0, pitch: float = 0.0) -> Sequence[float]:
    """Return the quaternion (x, y, z, w) of a roll, a pitch and a heading, applied in this order [rad]."""
    if roll or pitch:
        orientation: list[float] = attitude(roll, pitch, heading).tolist()
        return orientation
    return (0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading))


def told(output: Sequence[str]) -> str:
    """Return the engine's messages about a problem, in one line and without the places in its own code."""
    # A message may begin on the line of another, and warnings about a missing inertia precede every error.
    text = "\n".join(output)
    parts = re.split(r"b3(?:Warning|Error|Printf)\[[^\]]*\]:", text)
    kinds = re.findall(r"b3(Warning|Error|Printf)\[", text)
    errors = [part for kind, part in zip(kinds, parts[1:], strict=False) if kind == "Error"]
    words = " ".join(" ".join(errors or parts).split())
    return words or "it gives no reason"
