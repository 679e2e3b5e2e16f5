"""Coordinates of bodies: their places among the positions and velocities of the engine.

Reasons: docs/decisions/0079-mujoco.md
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Array, continued, yaws
from symaware_cli.worlds import BodyStates


class UprightCoordinates:
    """The coordinates x, y, z and heading of agents that stay upright.

    Attributes:
        heights: The height of each agent that moves in a plane [m]; shape (n,).
    """

    #: All of it follows from the scenario.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, model: Any, ids: Sequence[str], heights: Array) -> None:
        """Find the coordinates in a model.

        Args:
            model: The engine's model.
            ids: The agents.
            heights: See the class.
        """
        self.heights = heights
        #: For each agent, the indices of x, y, z and heading in the engine's positions and velocities; -1 for none.
        self._positions_at = np.full((len(ids), 4), -1, np.intp)
        self._velocities_at = np.full((len(ids), 4), -1, np.intp)
        for row, id in enumerate(ids):
            for column, letter in enumerate(("x", "y", "z", "heading")):
                joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{id}/{letter}")
                if joint >= 0:
                    self._positions_at[row, column] = model.jnt_qposadr[joint]
                    self._velocities_at[row, column] = model.jnt_dofadr[joint]

    def set_positions(self, data: Any, values: Array) -> None:
        """Set x, y, z and heading of all agents; shape (n, 4)."""
        _write(self._positions_at, data.qpos, values)

    def set_velocities(self, data: Any, values: Array, row: int | None = None) -> None:
        """Set the velocities of all agents, shape (n, 4), or of one, shape (4,)."""
        _write(self._velocities_at if row is None else self._velocities_at[row], data.qvel, values)

    def change(self, data: Any, row: int, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Add to x, y, z and heading of an agent, and to their velocities; four numbers each."""
        for places, into, values in (
            (self._positions_at[row], data.qpos, positions),
            (self._velocities_at[row], data.qvel, velocities),
        ):
            known = places >= 0
            into[places[known]] += np.array(values)[known]

    def turning_inertias(self, model: Any, rows: slice) -> Array:
        """Return the moments of inertia about the vertical axis of agents that turn [kg m^2]; shape (rows,)."""
        inertias: Array = model.dof_M0[self._velocities_at[rows, 3]]
        return inertias

    def velocities(self, data: Any) -> Array:
        """Return the velocities of all agents [m/s, rad/s]; shape (n, 4)."""
        found: Array = np.where(self._velocities_at >= 0, data.qvel[self._velocities_at], 0.0)
        return found

    def states(self, data: Any) -> BodyStates:
        """Return the states of all agents."""
        if not len(self.heights):
            return BodyStates(np.empty((0, 3)), np.empty(0), np.empty((0, 4)))
        coordinates = np.where(self._positions_at >= 0, data.qpos[self._positions_at], 0.0)
        planar = self._positions_at[:, 2] < 0
        coordinates[planar, 2] = self.heights[planar]
        return BodyStates(coordinates[:, :3], coordinates[:, 3], self.velocities(data))

    def height(self, data: Any, row: int) -> float:
        """Return the height of an agent [m]."""
        place = self._positions_at[row, 2]
        return float(self.heights[row] if place < 0 else data.qpos[place])


class FreeCoordinates:
    """The coordinates of bodies with a free joint: a position and a quaternion each."""

    #: All of it follows from the scenario.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, model: Any, names: Sequence[str]) -> None:
        """Find the coordinates of bodies in a model."""
        joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}/free") for name in names]
        self._positions_at = _consecutive([model.jnt_qposadr[joint] for joint in joints], 7)
        self._velocities_at = _consecutive([model.jnt_dofadr[joint] for joint in joints], 6)

    def pose(self, data: Any, row: int) -> Array:
        """Return the position [m] and the quaternion (w, x, y, z) of a body; shape (7,)."""
        found: Array = data.qpos[self._positions_at[row]]
        return found

    def set_pose(self, data: Any, row: int, pose: Sequence[float]) -> None:
        """Set the position [m] and the quaternion (w, x, y, z) of a body."""
        data.qpos[self._positions_at[row]] = pose

    def set_motion(self, data: Any, row: int, velocity: Sequence[float], turn_rate: float) -> None:
        """Set the velocity of a body [m/s], three numbers, and its turn rate about the vertical [rad/s]."""
        turned = _rotated(data.qpos[self._positions_at[row, 3:]], np.array([0.0, 0.0, turn_rate]), -1.0)
        data.qvel[self._velocities_at[row]] = [*velocity, *turned]

    def damp(self, data: Any, retained: float) -> None:
        """Multiply the velocities of all bodies by a factor."""
        if len(self._velocities_at):
            data.qvel[self._velocities_at] *= retained

    def states(self, data: Any, headings: Array) -> BodyStates:
        """Return the states of all bodies.

        Args:
            data: The engine's data.
            headings: The previous headings, which the new ones continue [rad]; shape (n,).
        """
        poses, motion = data.qpos[self._positions_at], data.qvel[self._velocities_at]
        orientations = poses[:, [4, 5, 6, 3]]  # (w, x, y, z) to (x, y, z, w)
        found = continued(headings, yaws(orientations)) if len(poses) else np.empty(0)
        motion[:, 3] = _upright_rates(poses, motion[:, 3:])
        return BodyStates(poses[:, :3], found, motion[:, :4], orientations)


def _consecutive(firsts: Sequence[int], count: int) -> NDArray[np.intp]:
    """Return rows of consecutive indices; shape (n, count)."""
    return np.array(firsts, np.intp).reshape(-1, 1) + np.arange(count)


def _write(places: NDArray[np.intp], into: Array, values: Array) -> None:
    known = places >= 0
    into[places[known]] = values[known]


def _upright_rates(poses: Array, spins: Array) -> Array:
    """Return turn rates about the vertical [rad/s], shape (n,), from those about the axes of the bodies.

    Args:
        poses: Positions and quaternions (w, x, y, z); shape (n, 7).
        spins: Turn rates about the axes of the bodies [rad/s]; shape (n, 3).
    """
    w, x, y, z = poses[:, 3:].T
    return np.asarray(
        2.0 * (x * z - w * y) * spins[:, 0]
        + 2.0 * (y * z + w * x) * spins[:, 1]
        + (1.0 - 2.0 * (x * x + y * y)) * spins[:, 2]
    )


def _rotated(quaternion: Array, vector: Array, direction: float) -> Array:
    """Rotate a vector by a quaternion (w, x, y, z), or back if the direction is -1."""
    turned, given = np.empty(3), np.array(quaternion, float)
    given[1:] *= direction
    mujoco.mju_rotVecQuat(turned, vector, given)
    return turned
