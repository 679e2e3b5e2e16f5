"""Path follower: moves entities along their paths in the spatial world, in each physics step."""

from __future__ import annotations

import math
from collections.abc import Sequence

from symaware_cli.core import Pose
from symaware_cli.environments.body_builder import BodyPart, turn
from symaware_cli.environments.body_poses import BodyPoses
from symaware_cli.environments.bullet import engine


def follow(
    client: int,
    poses: BodyPoses,
    members: Sequence[BodyPart],
    level: float,
    course: Pose,
    tilt: tuple[float, float],
    fall: Sequence[float],
) -> None:
    """Set the poses of an entity's bodies, and velocities that bring them to the path's pose after a physics step.

    Args:
        client: The engine's client.
        poses: Supplies the centres of mass of the bodies.
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
        pose = poses.centre(body, (x + out_x, y + out_y, z), turn(course.heading + turned, *tilt))
        engine.resetBasePositionAndOrientation(body, *pose, client)
        moving = (velocity_x - rate * out_y, velocity_y + rate * out_x, velocity_z)
        engine.resetBaseVelocity(body, moving, (0.0, 0.0, rate), client)
