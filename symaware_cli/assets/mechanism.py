"""Mechanisms: robots from files whose joints have motors, as worlds with joints move them.

Reasons: docs/decisions/0080-robots-as-agents.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from symaware_cli.geometry import Array


@dataclass(frozen=True)
class Motor:
    """A motor of a joint, with gear.

    Attributes:
        joint: The name of the joint.
        drive: The kind of its command: a velocity, a position or a torque (a force for a joint that slides).
        effort: Its greatest torque [N m] or force [N].
        velocity: The greatest velocity with which it approaches a position [rad/s] or [m/s].
        gain: The velocity for each radian or metre that is left to a position [1/s].
    """

    joint: str
    drive: Literal["velocity", "position", "torque"]
    effort: float
    velocity: float = float("inf")
    gain: float = 10.0


class Posture(NamedTuple):
    """The pose, velocity and joint positions of a robot at the start.

    Attributes:
        position: The origin of the base [m]; shape (3,). With `Mechanism.stands` the height is that at which the robot
            stands on the ground.
        orientation: The orientation of the base, a quaternion (x, y, z, w).
        velocity: The velocity of the base's origin [m/s]; shape (3,).
        rate: The angular velocity of the base in the world's coordinates [rad/s]; shape (3,).
        joints: The positions of the joints, in the order of `Mechanism.joints` [rad] or [m].
        joint_velocities: The velocities of the joints [rad/s] or [m/s].
    """

    position: Sequence[float]
    orientation: Sequence[float]
    velocity: Sequence[float]
    rate: Sequence[float]
    joints: Sequence[float]
    joint_velocities: Sequence[float]


class Postures(NamedTuple):
    """The postures of a group's robots, a row for each; see `Posture`.

    Attributes:
        positions: Shape (n, 3).
        orientations: Shape (n, 4).
        velocities: Shape (n, 3).
        rates: Shape (n, 3).
        joints: Shape (n, joints).
        joint_velocities: Shape (n, joints).
    """

    positions: Array
    orientations: Array
    velocities: Array
    rates: Array
    joints: Array
    joint_velocities: Array


class Placed(NamedTuple):
    """The poses of robots that follow from the states of their agents, a row for each; see `Posture`.

    Attributes:
        positions: The origins of the bases [m]; shape (n, 3). The height has no meaning for robots that stand on the
            ground.
        orientations: The orientations of the bases; shape (n, 4).
        joints: The positions of the joints [rad] or [m], arbitrary where unknown; shape (n, joints).
    """

    positions: Array
    orientations: Array
    joints: Array


class Mechanism(ABC):
    """Connects the states and control inputs of a model with the base, joints and motors of a robot.

    `Model.mechanism` creates one for a group. A world with ``mechanisms`` loads a robot for each agent, with the file
    of its body, in the posture of its state; commands the motors with the values of `commands` at the beginning of each
    time step; and calls `states` at its end. Motors give a joint its velocity in each physics step, within their
    effort. Motors that are given a position approach it at a velocity in proportion to the remaining distance.

    Attributes:
        joints: The joints that the mechanism reads and sets.
        motors: The motors.
        known: Those of `joints` whose positions follow from a state; None if all do.
        is_fixed: Whether the base cannot move.
        stands: Whether the robot stands on the ground at the start; a world without one is refused.
    """

    joints: Sequence[str]
    motors: Sequence[Motor]
    known: Sequence[str] | None = None
    is_fixed: bool = False
    stands: bool = False

    @abstractmethod
    def posture(self, state: Array) -> Posture:
        """Return the posture in which an agent begins, from its state; shape (nx,)."""

    def placed(self, states: Array) -> Placed:
        """Return the poses of robots, from the states of their agents; shape (n, nx).

        By default `posture` is called for each agent; a mechanism that computes all at once must return the same.
        """
        postures = [self.posture(state) for state in states]
        return Placed(
            np.array([each.position for each in postures], float).reshape(-1, 3),
            np.array([each.orientation for each in postures], float).reshape(-1, 4),
            np.array([each.joints for each in postures], float).reshape(-1, len(self.joints)),
        )

    @abstractmethod
    def commands(self, control_input: Array) -> Array:
        """Return the command of each motor [rad/s, rad, N m or m/s, m, N] for saturated control inputs.

        Args:
            control_input: Shape (n, nu).

        Returns:
            Shape (n, motors).
        """

    @abstractmethod
    def states(self, postures: Postures, before: Array) -> Array:
        """Return the states of agents.

        Args:
            postures: The postures of their robots.
            before: The states before the step, needed for elements that count turns; shape (n, nx).

        Returns:
            Shape (n, nx).
        """
