"""Entities that follow a path in the spatial world, put where they are in each physics step."""

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
    """Put the bodies of an entity where it is, with the velocities that bring them where it is after a physics step.

    Args:
        client: The engine's client.
        poses: Who knows where bodies have their mass.
        members: The bodies.
        level: How high the entity is where its path has two coordinates [m].
        course: Where it is, and how it moves.
        tilt: Its roll and its pitch [rad].
        fall: By how much gravity changes a velocity in a physics step, which is made up for [m/s].
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
