"""The robot of a body's file, as models of joints and wheels read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symaware_cli.assets import AssetError, AssetFolders, Robot, RobotJoint, asset
from symaware_cli.core import Entity, WorldError
from symaware_cli.geometry import Articulation, rotated


@dataclass(frozen=True)
class Wheel:
    """A wheel, or the hinge that steers one, while all joints are at 0.

    Attributes:
        joint: The name of its joint.
        x: Where it is ahead of the robot's origin [m].
        y: Where it is to the left of it [m].
        sign: 1 if a positive velocity rolls it forwards, or steers it to the left; else -1.
        radius: Its radius [m]; 0 for a hinge.
        velocity: The greatest velocity of the joint [rad/s].
        effort: Its greatest torque [N m].
    """

    joint: str
    x: float
    y: float
    sign: float
    radius: float
    velocity: float
    effort: float


@dataclass(frozen=True)
class RobotFile:
    """A robot that was read, and its name in the scenario."""

    name: str
    robot: Robot

    @property
    def tree(self) -> Articulation:
        """Its links and joints, without the looks that are meshes."""
        return self.robot.description.articulation({})

    @classmethod
    def of(cls, entity: Entity, folders: AssetFolders, *where: str) -> RobotFile:
        """Read the file of a body.

        Args:
            entity: The body.
            folders: The folders to which the name is relative.
            where: The path of the group.

        Raises:
            WorldError: The body has no such file, it is damaged, or a joint moves as no world does.
        """
        file = entity.shape.robot if entity.shape else None
        if file is None or entity.shape is None:
            raise WorldError(
                "the model moves the joints of a robot: give the body a `shape` with `urdf` or `mjcf`",
                *(*where, "entity") if entity.shape else where,
            )
        place = (*where, "entity", "shape", entity.shape.kind)
        robot = asset.described(file.file, folders, *place, "file", missing=file.missing)
        unsupported = robot.description.unsupported_joint()
        if unsupported is not None:
            raise WorldError(unsupported.located(file.file), *place, "file")
        if file.scale != 1.0:
            raise WorldError("robots with motors have the size of their files", *place, "scale")
        return cls(file.file, robot)

    def joint(self, name: str, *where: str | int) -> RobotJoint:
        """Return a joint by its name; `where` is the place of this name in the scenario.

        Raises:
            WorldError: There is none, or its motor has no effort or no velocity.
        """
        joints = self.robot.description.joints()
        if name not in joints:
            known = ", ".join(f"`{each}`" for each in list(joints)[:20]) or "none"
            raise WorldError(f"`{self.name}` has no joint `{name}` that moves; it has {known}", *where)
        joint = joints[name]
        for limit in ("effort", "velocity"):
            if getattr(joint, limit) <= 0.0:
                at = AssetError(
                    f"the joint `{name}` has the {limit} {getattr(joint, limit):g}, so that no motor moves it",
                    *(joint.element.line, joint.element.column, joint.element.file),
                )
                raise WorldError(at.located(self.name), *where)
        return joint

    def wheel(self, name: str, radius: float | None, *where: str | int) -> Wheel:
        """Return a wheel that rolls about the robot's y axis.

        Args:
            name: Its joint.
            radius: Its radius, if the scenario says it [m].
            where: The place of the name in the scenario.

        Raises:
            WorldError: There is no such joint, it has another axis, or the radius is not known.
        """
        joint = self.joint(name, *where)
        (x, y, _), axis = self._at(name)
        if not joint.turns or abs(axis[1]) < 0.99:
            raise WorldError(
                f"the joint `{name}` of `{self.name}` does not turn a wheel about the robot's y axis", *where
            )
        found = radius or self.robot.description.rolling_radius(name)
        if found is None:
            said = f"the wheel of `{name}` in `{self.name}` has no round shape that collides; give a `wheel_radius`"
            raise WorldError(said, *where)
        return Wheel(name, x, y, float(np.sign(axis[1])), found, joint.velocity, joint.effort)

    def hinge(self, name: str, *where: str | int) -> Wheel:
        """Return a hinge that steers a wheel about the robot's z axis.

        Raises:
            WorldError: There is no such joint, or it has another axis.
        """
        joint = self.joint(name, *where)
        (x, y, _), axis = self._at(name)
        if not joint.turns or abs(axis[2]) < 0.99:
            raise WorldError(f"the joint `{name}` of `{self.name}` does not turn about the robot's z axis", *where)
        return Wheel(name, x, y, float(np.sign(axis[2])), 0.0, joint.velocity, joint.effort)

    def _at(self, joint: str) -> tuple[tuple[float, float, float], list[float]]:
        """Return the place of a joint in the frame of the base [m], and its axis."""
        described = self.tree
        positions, orientations = described.frames()
        number = next(number for number, link in enumerate(described.links) if link.joint == joint)
        x, y, z = positions[number].tolist()
        return (x, y, z), rotated(orientations[number], np.array(described.links[number].axis)).tolist()
