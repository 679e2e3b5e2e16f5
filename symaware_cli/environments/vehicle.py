"""Vehicles: bodies that move by wheels, joints or rotors of their own in a world of rigid bodies in space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Vehicle(ABC):
    """How the bodies of a group move in the world `pybullet`, for models that no mere velocity describes.

    A model makes one for its group in `Model.vehicle`. The world loads the bodies, calls `dress` for each if it can be
    seen, `attach` once, `actuate` at the beginning of each time step, `push` before each physics step, and reads the
    states back by `read`.

    Attributes:
        flags: What ``loadURDF`` is told besides.
        needs_ground: Whether it drives on the ground, so that a world without one is refused.
        ground: The height of the ground [m], which the world says before all else; None where there is none.
    """

    flags: int = 0
    needs_ground: bool = False
    ground: float | None = 0.0

    @abstractmethod
    def description(self) -> Path:
        """The URDF file of one body."""

    @abstractmethod
    def pose(self, state: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return where a body starts: the position of its base [m] and its orientation as a quaternion (x, y, z, w).

        Args:
            state: The state of one agent; shape (nx,).
        """

    def dress(self, engine: Any, client: int, body: int) -> None:  # noqa: B027 (most are as the file has them)
        """Change what a body looks like, just after it was loaded together with that.

        Args:
            engine: The module ``pybullet``.
            client: The client's id, for every call.
            body: The body's id.
        """

    @abstractmethod
    def attach(self, engine: Any, client: int, bodies: Sequence[int], state: Array, step_time: float) -> None:
        """Take over the bodies.

        Args:
            engine: The module ``pybullet``.
            client: The client's id, for every call.
            bodies: The id of each agent's body.
            state: The initial states; shape (n, nx).
            step_time: A physics step [s].

        Raises:
            WorldError: The world is none for it; the path may be that of a parameter, as ``("with", "gravity")``.
        """

    @abstractmethod
    def actuate(self, control_input: Array) -> None:
        """Take over the saturated control inputs of a time step; shape (n, nu)."""

    def push(self) -> None:  # noqa: B027 (most have nothing to do)
        """Apply what has to be applied anew in each physics step."""

    @abstractmethod
    def read(self) -> tuple[Array, Array]:
        """Return the states, shape (n, nx), and the velocities [m/s], shape (n, 3)."""

    def displace(self, rows: Sequence[int], change: Array) -> None:
        """Put bodies elsewhere all at once, and give them another velocity: what process noise and pushes do.

        Args:
            rows: Which agents.
            change: What to add to the state of each; shape (k, nx).

        Raises:
            NotImplementedError: The vehicle cannot do that.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot be displaced")


def place_body(engine: Any, client: int, body: int, values: Sequence[float]) -> None:
    """Put a body somewhere, with a velocity; its joints stay as they are.

    Args:
        engine: The module ``pybullet``.
        client: The client's id.
        body: Its id.
        values: What `read_bodies` returns of it.
    """
    engine.resetBasePositionAndOrientation(body, values[:3], values[3:7], client)
    engine.resetBaseVelocity(body, values[7:10], values[10:13], client)


def read_bodies(engine: Any, client: int, bodies: Sequence[int]) -> Array:
    """Read where bodies are and how they move, of their centres of mass.

    Args:
        engine: The module ``pybullet``.
        client: The client's id.
        bodies: Their ids.

    Returns:
        Positions [m], orientations as quaternions (x, y, z, w), velocities [m/s] and angular velocities [rad/s] in
        the world's coordinates; shape (n, 13).
    """
    pose, motion = engine.getBasePositionAndOrientation, engine.getBaseVelocity
    # One list and one array at the end: rows of an array that are filled one by one cost twice as much.
    flat: list[float] = []
    for body in bodies:
        position, orientation = pose(body, client)
        velocity, spin = motion(body, client)
        flat += position
        flat += orientation
        flat += velocity
        flat += spin
    return np.array(flat).reshape(len(bodies), 13)
