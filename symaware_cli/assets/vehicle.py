"""Vehicles: bodies with wheels, joints or rotors, independent of the physics engine.

Reasons: docs/decisions/0081-vehicles-and-cameras.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Literal

from symaware_cli.geometry import Array, Mask


class VehicleBodies(ABC):
    """The bodies of a group of vehicles in the engine of a world, as a `Vehicle` reads and moves them.

    A row is an agent of the group. Joints have their names from the file, and a link has the name of the joint that
    moves it.

    Attributes:
        count: The number of bodies.
        gravity: Acceleration of free bodies [x, y, z] [m/s^2].
        margin: The distance outside of their shapes at which bodies touch each other [m].
    """

    # Handles of an engine follow from the scenario. A subclass with further state adds it by `captured` and `restored`.
    uncaptured: ClassVar[Collection[str]] = "*"

    count: int
    gravity: Sequence[float]
    margin: float = 0.0

    @property
    def present(self) -> Mask | None:
        """Whether each agent is in the world, by row; None if all are."""
        return None

    # -- once, in `Vehicle.attach`

    @abstractmethod
    def set_inertia(self, inertia: Sequence[float]) -> None:
        """Set the moments of inertia of the bases about the axes of the body [kg m^2], and remove all damping."""

    @abstractmethod
    def set_friction(self, friction: Mapping[str, float]) -> None:
        """Set the friction of the named links and 0 for all others, and remove the damping of all joints."""

    @abstractmethod
    def release(self, joints: Sequence[str]) -> None:
        """Let joints move freely."""

    @abstractmethod
    def add_motors(self, joints: Sequence[str], kind: Literal["rate", "angle"], torque: float) -> None:
        """Add motors, each of which brings a joint to a rate, or to an angle: a tenth of the way in a physics step.

        Args:
            joints: The joints.
            kind: The quantity that `command` sets.
            torque: The greatest torque of each [N m].
        """

    # -- in a run

    @abstractmethod
    def command(self, row: int, joints: Sequence[str], targets: Sequence[float]) -> None:
        """Set the targets of motors that were added together: rates [rad/s] or angles [rad]."""

    @abstractmethod
    def push(self, forces: Array, torques: Array) -> None:
        """Apply forces [N] at the centres of mass and torques [N m] in the next physics step.

        Args:
            forces: In the axes of the world; shape (n, 3).
            torques: In the axes of the world; shape (n, 3).
        """

    @abstractmethod
    def read(self) -> Array:
        """Read the centres of mass of the bases.

        Returns:
            Positions [m], orientations as quaternions (x, y, z, w), velocities [m/s] and angular velocities [rad/s] in
            the axes of the world; shape (n, 13).
        """

    @abstractmethod
    def place(self, row: int, values: Sequence[float]) -> None:
        """Set the pose and velocity of a body, as `read` returns them; its joints stay as they are."""

    @abstractmethod
    def set_velocity(self, row: int, velocity: Sequence[float], spin: Sequence[float]) -> None:
        """Set the velocity [m/s] and the angular velocity [rad/s] of a body in the axes of the world."""

    @abstractmethod
    def joint(self, row: int, joint: str) -> tuple[float, float]:
        """Return the angle [rad] and the rate [rad/s] of a joint."""

    @abstractmethod
    def set_joint(self, row: int, joint: str, position: float, rate: float) -> None:
        """Set the angle [rad] and the rate [rad/s] of a joint."""


class Vehicle(ABC):
    """Moves the bodies of a group in worlds that provide ``vehicles``, for models with wheels, joints or rotors.

    `Model.vehicle` creates one for a group. The world loads the bodies, calls `attach` once and `start` for all of
    them, `actuate` at the beginning of each time step, `push` before each physics step, and `read` for the states.
    Agents that enter later are put to their pose, and `start` is called for them again.

    Attributes:
        inertia_from_file: Whether moments of inertia are taken from the file; else PyBullet derives them from shapes.
        needs_ground: Whether the vehicle drives on the ground, so that a world without one is refused.
        colours: Red, green, blue and opacity, from 0 to 1, of links with another colour than in the file, by joint.
        ground: The height of the ground [m], which the world sets before all calls; None without a ground.
    """

    inertia_from_file: bool = False
    needs_ground: bool = False
    colours: ClassVar[Mapping[str, tuple[float, float, float, float]]] = {}
    ground: float | None = 0.0

    @abstractmethod
    def description(self) -> Path:
        """Return the URDF file of one body."""

    def portable_description(self) -> Path:
        """Return a URDF file of the same body that needs no package besides that of the model.

        Worlds of engines other than PyBullet load this file, which has the same joints.
        """
        return self.description()

    @abstractmethod
    def pose(self, state: Array, margin: float = 0.0) -> tuple[Sequence[float], Sequence[float]]:
        """Return the initial position of a body's base [m] and its orientation as a quaternion (x, y, z, w).

        Args:
            state: The state of one agent; shape (nx,).
            margin: The distance outside of their shapes at which bodies touch each other [m].
        """

    @abstractmethod
    def attach(self, bodies: VehicleBodies, state: Array) -> None:
        """Adopt the bodies, and set properties that never change.

        Args:
            bodies: The bodies, at their poses.
            state: The initial states; shape (n, nx).

        Raises:
            WorldError: The vehicle does not support the world; the path may be that of a parameter: ``("with",
                "gravity")``.
        """

    @abstractmethod
    def start(self, rows: Sequence[int], state: Array) -> None:
        """Set the initial velocities and joints of some bodies, which are at their poses.

        Args:
            rows: The rows of the agents in the group.
            state: The states of these agents; shape (k, nx).
        """

    @abstractmethod
    def actuate(self, control_input: Array) -> None:
        """Set the saturated control inputs of a time step; shape (n, nu)."""

    def push(self) -> None:  # noqa: B027 (most have nothing to do)
        """Apply forces and torques that last for one physics step only."""

    @abstractmethod
    def read(self) -> tuple[Array, Array]:
        """Return the states, shape (n, nx), and the velocities [m/s], shape (n, 3)."""

    def displace(self, rows: Sequence[int], change: Array) -> None:
        """Displace bodies instantaneously, and change their velocities; used for process noise and pushes.

        Args:
            rows: The rows of the agents in the group.
            change: The change of each state; shape (k, nx).

        Raises:
            NotImplementedError: The vehicle does not support this.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot be displaced")
