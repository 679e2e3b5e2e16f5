"""Vehicles: bodies with wheels, joints or rotors of their own in the spatial world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from symaware_cli.geometry import Array


class Vehicle(ABC):
    """Moves the bodies of a group in the world `pybullet`, for models with wheels, joints or rotors.

    `Model.vehicle` creates one for a group. The world loads the bodies, calls `dress` for each if it is visible,
    `attach` once, `actuate` at the beginning of each time step, `push` before each physics step, and `read` for the
    states.

    Attributes:
        flags: Additional flags for ``loadURDF``.
        needs_ground: Whether it drives on the ground, so that a world without one is refused.
        ground: The height of the ground [m], which the world sets before all calls; None without a ground.
    """

    flags: int = 0
    needs_ground: bool = False
    ground: float | None = 0.0

    @abstractmethod
    def description(self) -> Path:
        """Return the URDF file of one body."""

    @abstractmethod
    def pose(self, state: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return the initial position of a body's base [m] and its orientation as a quaternion (x, y, z, w).

        Args:
            state: The state of one agent; shape (nx,).
        """

    def dress(self, engine: Any, client: int, body: int) -> None:  # noqa: B027 (most keep the looks of the file)
        """Change how a body looks, just after it was loaded with its visual shapes.

        Args:
            engine: The module ``pybullet``.
            client: The client's id, for every call.
            body: The body's id.
        """

    @abstractmethod
    def attach(self, engine: Any, client: int, bodies: Sequence[int], state: Array, step_time: float) -> None:
        """Adopt the bodies.

        Args:
            engine: The module ``pybullet``.
            client: The client's id, for every call.
            bodies: The id of each agent's body.
            state: The initial states; shape (n, nx).
            step_time: Duration of a physics step [s].

        Raises:
            WorldError: It does not support the world; the path may be that of a parameter: ``("with", "gravity")``.
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


def place_body(engine: Any, client: int, body: int, values: Sequence[float]) -> None:
    """Set the pose and velocity of a body; its joints stay as they are.

    Args:
        engine: The module ``pybullet``.
        client: The client's id.
        body: The body's id.
        values: Pose and velocities, as returned by `read_bodies`.
    """
    engine.resetBasePositionAndOrientation(body, values[:3], values[3:7], client)
    engine.resetBaseVelocity(body, values[7:10], values[10:13], client)


def read_bodies(engine: Any, client: int, bodies: Sequence[int]) -> Array:
    """Read the poses and velocities of bodies' centres of mass.

    Args:
        engine: The module ``pybullet``.
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
