"""Quadrotor bodies in the world `pybullet`, with rotor forces applied in each physics step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import WorldError
from symaware_cli.environments.vehicle import Vehicle, place_body, read_bodies
from symaware_cli.geometry.rotation import attitude, continued
from symaware_cli.models import crazyflie
from symaware_cli.models.vector import Vector, added, body_axes, dot, quaternion_axes, to_world
from symaware_cli.world.model import columns

Array = NDArray[np.float64]


class QuadrotorVehicle(Vehicle):
    """The bodies and rotors of quadrotors in the world `pybullet`."""

    def __init__(self, parameters: Any, rotor_speeds: Callable[[Array], Any]) -> None:
        self._parameters = parameters
        self._rotor_speeds = rotor_speeds

    def description(self) -> Path:
        """Return the URDF file that comes with this package."""
        return Path(__file__).parent / "assets" / "crazyflie.urdf"

    def pose(self, state: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return the position of the centre of mass and the attitude."""
        return state[:3].tolist(), attitude(state[3], state[4], state[5]).tolist()

    def attach(self, engine: Any, client: int, bodies: Sequence[int], state: Array, step_time: float) -> None:
        """Set masses and initial velocities of the bodies.

        Raises:
            WorldError: The world has another gravity than the model.
        """
        self._engine, self._client, self._bodies = engine, client, tuple(bodies)
        self._is_current = False
        settings = engine.getPhysicsEngineParameters(client)
        gravity = [settings[f"gravityAcceleration{axis}"] for axis in "XYZ"]
        *aside, down = gravity
        if any(aside) or down >= 0.0:
            raise WorldError(f"it needs gravity straight down, and that of the world is {gravity}")
        if not np.isclose(-down, self._parameters.gravity):
            raise WorldError(
                f"the gravity of the world is {-down:g} m/s^2, and the model's {self._parameters.gravity:g}: set "
                f"`gravity` to {-down:g}, too",
                *("with", "gravity"),
            )
        for body, own, spin in zip(bodies, state, _spins(state), strict=True):
            engine.changeDynamics(
                body,
                -1,
                linearDamping=0.0,
                angularDamping=0.0,
                localInertiaDiagonal=crazyflie.INERTIA,
                physicsClientId=client,
            )
            engine.resetBaseVelocity(body, own[6:9].tolist(), spin.tolist(), client)
        self._yaws = state[:, 5].copy()
        self._read_bodies()

    def actuate(self, control_input: Array) -> None:
        """Set the rotor speeds."""
        self._rotors = self._rotor_speeds(columns(control_input))
        self._thrust, self._torque = crazyflie.rotor_wrench(self._rotors)

    def push(self) -> None:
        """Apply thrust, reaction torques and aerodynamic forces at the centre of mass."""
        if not self._is_current:
            self._read_bodies()
        self._is_current = False
        axes, parameters = self._axes, self._parameters
        lift = self._thrust
        if parameters.ground_effect and self.ground is not None:
            lift = lift * crazyflie.ground_effect(self._values[:, 2] - self.ground)
        force: Vector = (np.zeros_like(lift), np.zeros_like(lift), lift)
        if parameters.drag:
            force = added(force, crazyflie.drag(axes, self._velocity, self._rotors))
        force, torque = to_world(axes, force), to_world(axes, self._torque)
        if parameters.downwash and len(self._bodies) > 1:
            force = (force[0], force[1], force[2] - crazyflie.downwash(self._values[:, :3]))
        engine, client, frame = self._engine, self._client, self._engine.WORLD_FRAME
        forces, torques = np.stack(force, axis=1).tolist(), np.stack(torque, axis=1).tolist()
        places = self._values[:, :3].tolist()
        for body, place, pushed, turned in zip(self._bodies, places, forces, torques, strict=True):
            engine.applyExternalForce(body, -1, pushed, place, frame, client)
            engine.applyExternalTorque(body, -1, turned, frame, client)

    def read(self) -> tuple[Array, Array]:
        """Read the poses and velocities of the bodies."""
        self._read_bodies()
        values = self._values
        axes = self._axes
        state = np.empty((len(values), 12))
        state[:, :3], state[:, 6:9] = values[:, :3], values[:, 7:10]
        state[:, 3] = np.arctan2(axes[1][2], axes[2][2])
        state[:, 4] = np.arcsin(np.clip(-axes[0][2], -1.0, 1.0))
        turned = np.arctan2(axes[0][1], axes[0][0])
        self._yaws = state[:, 5] = continued(self._yaws, turned)
        spin = (values[:, 10], values[:, 11], values[:, 12])
        for axis in range(3):
            state[:, 9 + axis] = dot(axes[axis], spin)
        return state, values[:, 7:10].copy()

    def displace(self, rows: Sequence[int], change: Array) -> None:
        """Displace and turn the bodies, and change their velocities; angular rates stay in the axes of the body."""
        changed = self.read()[0][list(rows)] + change
        values, spins = self._values[list(rows)], _spins(changed)
        values[:, :3], values[:, 7:10] = changed[:, :3], changed[:, 6:9]
        for row, own, state, spin in zip(rows, values, changed, spins, strict=True):
            own[3:7], own[10:13] = attitude(state[3], state[4], state[5]), spin
            self._yaws[row] = state[5]
            place_body(self._engine, self._client, self._bodies[row], own.tolist())
        self._is_current = False

    def _read_bodies(self) -> None:
        """Read the poses and velocities of all bodies; valid until the next physics step."""
        values = self._values = read_bodies(self._engine, self._client, self._bodies)
        x, y, z, w = columns(values[:, 3:7])
        self._axes = quaternion_axes(x, y, z, w)
        velocity_x, velocity_y, velocity_z = columns(values[:, 7:10])
        self._velocity = (velocity_x, velocity_y, velocity_z)
        self._is_current = True


def _spins(state: Array) -> Array:
    """Return the angular velocities in the world's coordinates [rad/s]; (n, 12) to (n, 3)."""
    values = columns(state)
    axes = body_axes(values[3], values[4], values[5], np)
    return np.stack(np.broadcast_arrays(*to_world(axes, (values[9], values[10], values[11]))), axis=1)
