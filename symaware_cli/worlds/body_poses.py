"""Body poses: reads and sets positions, orientations and joint positions of PyBullet bodies, also along a path."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from symaware_cli.core import Pose
from symaware_cli.geometry import Array, Articulation, continued, yaws
from symaware_cli.worlds.body_builder import BodyPart, turn
from symaware_cli.worlds.bullet import engine

Transform = tuple[Sequence[float], Sequence[float]]

#: The body type that `getDynamicsInfo` reports for multibodies.
_MULTIBODY = 2


class BodyPoses:
    """Reads and sets the poses of bodies on demand, with one or two calls of the engine for each body."""

    def __init__(self, client: int) -> None:
        """Initialise for a world.

        Args:
            client: The engine's client.
        """
        self._client = client
        self._bases: dict[int, Transform | None] = {}
        self._any_apart = False
        #: The engine's indices of the joints of a body.
        self._joints: dict[int, Sequence[int]] = {}

    def base(self, body: int) -> Transform | None:
        """Return the transform from the centre of mass, as the engine reports it, to the base; None if equal."""
        if body not in self._bases:
            dynamics = engine.getDynamicsInfo(body, -1, self._client)
            position, orientation = dynamics[3:5]
            # Of a body that is no multibody the engine returns uninitialised memory.
            apart = dynamics[10] == _MULTIBODY and (any(position) or any(orientation[:3]))
            self._bases[body] = engine.invertTransform(position, orientation) if apart else None
            self._any_apart |= apart
        return self._bases[body]

    def pose(self, body: int) -> Transform:
        """Return the position [m] and the quaternion (x, y, z, w) of a base."""
        pose: Transform = engine.getBasePositionAndOrientation(body, self._client)
        base = self.base(body)
        return engine.multiplyTransforms(*pose, *base) if base else pose

    def displace(self, body: int, moved: Sequence[float], heading: float, faster: Sequence[float]) -> None:
        """Move the base of an upright body [m], set its heading [rad], and add to its velocity [m/s]."""
        position, _ = self.pose(body)
        velocity, spin = engine.getBaseVelocity(body, self._client)
        there = [one + by for one, by in zip(position, moved, strict=True)]
        engine.resetBasePositionAndOrientation(body, *self.centre(body, there, turn(heading)), self._client)
        # Resetting the pose has set the velocity to zero.
        velocity = [one + by for one, by in zip(velocity, faster, strict=True)]
        engine.resetBaseVelocity(body, velocity, spin, self._client)

    def follow(
        self,
        members: Sequence[BodyPart],
        level: float,
        course: Pose,
        tilt: tuple[float, float],
        fall: Sequence[float],
    ) -> None:
        """Set the poses of an entity's bodies, and velocities that bring them to its path's pose after a physics step.

        Args:
            members: The bodies.
            level: Height of the entity if its path has two coordinates [m].
            course: Pose and velocities of the entity.
            tilt: Its roll and its pitch [rad].
            fall: Change of the velocity by gravity in a physics step, which is compensated [m/s].
        """
        x, y, z = (*course.position, level)[:3]
        velocity_x, velocity_y, velocity_z = (
            speed - falling for speed, falling in zip((*course.velocity, 0.0)[:3], fall, strict=False)
        )
        cosine, sine, rate = math.cos(course.heading), math.sin(course.heading), course.turn_rate
        for body, ahead, aside, turned in members:
            out_x, out_y = cosine * ahead - sine * aside, sine * ahead + cosine * aside
            pose = self.centre(body, (x + out_x, y + out_y, z), turn(course.heading + turned, *tilt))
            engine.resetBasePositionAndOrientation(body, *pose, self._client)
            moving = (velocity_x - rate * out_y, velocity_y + rate * out_x, velocity_z)
            engine.resetBaseVelocity(body, moving, (0.0, 0.0, rate), self._client)

    def centre(self, body: int, position: Sequence[float], orientation: Sequence[float]) -> Transform:
        """Return the pose of the centre of mass for a pose of the base, for `resetBasePositionAndOrientation`."""
        base = self.base(body)
        if base is None:
            return position, orientation
        there: Transform = engine.multiplyTransforms(position, orientation, *engine.invertTransform(*base))
        return there

    def poses(self, bodies: Sequence[int]) -> Array:
        """Return the positions [m] and quaternions (x, y, z, w) of the bases; shape (n, 7)."""
        flat: list[float] = []
        for body in bodies:
            position, orientation = self.pose(body)
            flat += position
            flat += orientation
        return np.array(flat).reshape(len(bodies), 7)

    def read(self, bodies: Sequence[int], headings: Array) -> tuple[Array, Array, Array, Array]:
        """Read the poses and velocities of several bodies.

        Args:
            bodies: The engine's ids; `base` must have been called for each.
            headings: Their previous headings, from which turns are counted [rad]; shape (n,).

        Returns:
            Positions of the bases [m], shape (n, 3); headings [rad], shape (n,); the velocities of the centres of
            mass [m/s] with the turn rates about the vertical [rad/s], shape (n, 4); and quaternions (x, y, z, w) of the
            bases, shape (n, 4).
        """
        if not bodies:
            return np.empty((0, 3)), np.empty(0), np.empty((0, 4)), np.empty((0, 4))
        values = read_bodies(self._client, bodies)
        for row, body in enumerate(bodies if self._any_apart else ()):
            base = self.base(body)
            if base:
                position, orientation = values[row, :3].tolist(), values[row, 3:7].tolist()
                values[row, :7] = np.concatenate(engine.multiplyTransforms(position, orientation, *base))
        turned = values[:, 3:7]
        return values[:, :3], continued(headings, yaws(turned)), values[:, [7, 8, 9, 12]], turned

    def joints(self, bodies: Sequence[int], articulation: Articulation) -> Array:
        """Return the positions of the moving joints, in the order of an articulation [rad] or [m]; (n, joints)."""
        flat: list[float] = []
        for body in bodies:
            numbers = self._numbers(body, articulation.joints)
            flat += [state[0] for state in engine.getJointStates(body, numbers, self._client)]
        return np.array(flat).reshape(len(bodies), len(articulation.joints))

    def set_joints(self, bodies: Sequence[int], articulation: Articulation, positions: Array) -> None:
        """Set the positions of the joints, as returned by `joints` in another world."""
        for body, row in zip(bodies, positions.tolist(), strict=True):
            for number, position in zip(self._numbers(body, articulation.joints), row, strict=True):
                engine.resetJointState(body, number, position, physicsClientId=self._client)

    def _numbers(self, body: int, joints: Mapping[str, str]) -> Sequence[int]:
        if body not in self._joints:
            names = {
                engine.getJointInfo(body, number, self._client)[1].decode(): number
                for number in range(engine.getNumJoints(body, self._client))
            }
            self._joints[body] = [names[joint] for joint in joints]
        return self._joints[body]


def read_bodies(client: int, bodies: Sequence[int]) -> Array:
    """Read the poses and velocities of bodies' centres of mass.

    Args:
        client: The client's id.
        bodies: Their ids.

    Returns:
        Positions [m], orientations as quaternions (x, y, z, w), velocities [m/s] and angular velocities [rad/s] in
        the world's coordinates; shape (n, 13).
    """
    pose, motion = engine.getBasePositionAndOrientation, engine.getBaseVelocity
    # One list and one array at the end: filling an array row by row costs twice as much.
    flat: list[float] = []
    for body in bodies:
        position, orientation = pose(body, client)
        velocity, spin = motion(body, client)
        flat += position
        flat += orientation
        flat += velocity
        flat += spin
    return np.array(flat).reshape(len(bodies), 13)
