"""The quadrotor: a Crazyflie 2.x with four rotor speeds as control input, and its bodies in worlds with vehicles."""

from __future__ import annotations

import math as numbers
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from symaware_cli.assets import Vehicle, VehicleBodies
from symaware_cli.core import Cylinder, Entity, Parameters, Quantity, Shape, WorldError
from symaware_cli.engine.models.crazyflie import (
    DRAG,
    INERTIA,
    MASS,
    THRUST,
    THRUST_TO_WEIGHT,
    downwash,
    drag,
    ground_effect,
    rotor_speeds,
    rotor_wrench,
)
from symaware_cli.engine.models.noise import Deviation, NoisyModel
from symaware_cli.engine.models.vector import (
    Axes,
    Vector,
    added,
    body_axes,
    cross,
    dot,
    quaternion_axes,
    to_world,
    unit,
)
from symaware_cli.geometry import Array, attitude, continued
from symaware_cli.world import columns, rows

#: [m] Where absent agents are, so that they push nobody down.
_ELSEWHERE = 1e6


class Quadrotor(NoisyModel):
    """A Crazyflie 2.x in flight: a rigid body under the thrust of four rotors, with their speeds as control input.

    Its attitude is roll, pitch and yaw (first about z, then y, then x), which are singular if the nose points straight
    up or down. Angular rates are about the axes of the body. Rotors reach their speed instantaneously.

    In worlds with vehicles, `pybullet` and `mujoco`, it is a body with collisions. In others the same equations are
    integrated, without ground effect and downwash.
    """

    batchable = True

    state = (
        *(Quantity(axis, "m") for axis in "xyz"),
        *(Quantity(angle, "rad") for angle in ("roll", "pitch", "yaw")),
        *(Quantity(f"velocity_{axis}", "m/s") for axis in "xyz"),
        *(Quantity(f"rate_{axis}", "rad/s") for axis in "xyz"),
    )
    control_input = tuple(Quantity(f"rotor_{number}", "rad/s") for number in (1, 2, 3, 4))
    position = (0, 1, 2)
    heading = 5
    velocities = (6, 7, 8)
    angles = (3, 4, 5)
    # The collision shape of assets/crazyflie.urdf.
    body = Entity(shape=Shape(cylinder=Cylinder(radius=0.07, height=0.03)), mass=MASS)
    needs_vehicle = ("ground_effect", "downwash")

    class Parameters(Parameters):
        """Control input, environment effects, and gains for following a velocity."""

        input: Literal["speed", "normalised"] = Field(
            "speed",
            description="What its rotors are told: their speeds [rad/s], or these as parts of the greatest, 0 to 1.",
        )
        gravity: float = Field(9.81, gt=0, description="Acceleration of gravity [m/s^2]; that of the world.")
        drag: bool = Field(True, description="Whether the air brakes it.")
        ground_effect: bool = Field(
            False,
            description="Whether rotors push more near the ground, in worlds with vehicles (Cheeseman, Bennett 1955).",
        )
        downwash: bool = Field(
            False, description="Whether those of its group that fly above push it down, in worlds with vehicles."
        )
        max_tilt: float = Field(
            0.6, gt=0, lt=1.3, description="Greatest angle to which it tilts to follow a velocity [rad]."
        )
        velocity_gain: float = Field(
            4.0, gt=0, description="Acceleration for each m/s between the velocity and the wanted one [1/s]."
        )
        attitude_frequency: float = Field(
            20.0, gt=0, description="Natural frequency at which the attitude is corrected, critically damped [rad/s]."
        )
        yaw_frequency: float = Field(5.0, gt=0, description="The same of the yaw [rad/s].")
        process_noise: Deviation = None

    def _declare(self) -> None:
        self.top_speed = numbers.sqrt(THRUST_TO_WEIGHT * MASS * 9.81 / (4.0 * THRUST))
        #: The speed of a rotor for each unit of control input [rad/s].
        self.input_scale = 1.0
        if self.parameters.input == "normalised":
            self.input_scale = self.top_speed
            self.control_input = tuple(Quantity(name, "1") for name, _ in self.control_input)

    @property
    def hover_speed(self) -> float:
        """The speed of each rotor at which it hovers [rad/s]."""
        return numbers.sqrt(MASS * self.parameters.gravity / (4.0 * THRUST))

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the range from standstill to the thrust of 2.25 times its weight on Earth."""
        return [0.0] * 4, [self.top_speed / self.input_scale] * 4

    def rotor_speeds(self, control_input: Any) -> Any:
        """Return the rotor speeds for a control input [rad/s], with elements as in `derivative`."""
        if self.input_scale == 1.0:
            return control_input
        return [control_input[number] * self.input_scale for number in range(4)]

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the Newton-Euler equations of a rigid body."""
        roll, pitch, yaw = state[3], state[4], state[5]
        velocity, rate = (state[6], state[7], state[8]), (state[9], state[10], state[11])
        axes = body_axes(roll, pitch, yaw, math)
        speeds = self.rotor_speeds(control_input)
        thrust, torque = rotor_wrench(speeds)
        force: Vector = (0.0, 0.0, thrust)
        if self.parameters.drag:
            force = added(force, drag(axes, velocity, speeds))
        pushed = to_world(axes, force)
        sine, cosine, tangent = math.sin(roll), math.cos(roll), math.tan(pitch)
        inertia_x, inertia_y, inertia_z = INERTIA
        return (
            *velocity,
            rate[0] + tangent * (sine * rate[1] + cosine * rate[2]),
            cosine * rate[1] - sine * rate[2],
            (sine * rate[1] + cosine * rate[2]) / math.cos(pitch),
            pushed[0] / MASS,
            pushed[1] / MASS,
            pushed[2] / MASS - self.parameters.gravity,
            (torque[0] + (inertia_y - inertia_z) * rate[1] * rate[2]) / inertia_x,
            (torque[1] + (inertia_z - inertia_x) * rate[2] * rate[0]) / inertia_y,
            (torque[2] + (inertia_x - inertia_y) * rate[0] * rate[1]) / inertia_z,
        )

    def velocity(self, state: Array, control_input: Array) -> Array:
        """Return the velocity in the state."""
        return state[:, 6:9].copy()

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Accelerate in proportion to the velocity error, and keep the yaw."""
        wanted = self.parameters.velocity_gain * (velocity - state[:, 6:9])
        return self.accelerate(state, wanted, state[:, 5])

    def accelerate(self, state: Array, acceleration: Array, yaw: Array) -> Array:
        """Return the control inputs that tilt the vehicle towards an acceleration and produce it.

        Gravity and drag are compensated. The attitude is controlled on the group of rotations (T. Lee, M. Leok and N.
        H. McClamroch, Geometric Tracking Control of a Quadrotor UAV on SE(3), CDC 2010), without feedforward of the
        rate of the desired attitude.

        Args:
            state: The states; shape (n, 12).
            acceleration: The desired accelerations [m/s^2]; shape (n, 3).
            yaw: The desired yaw angles [rad]; shape (n,).

        Returns:
            Shape (n, 4), not yet saturated.
        """
        parameters, elements = self.parameters, columns(state)
        axes = body_axes(elements[3], elements[4], elements[5], np)
        rate = (elements[9], elements[10], elements[11])
        wanted_x, wanted_y, wanted_z = columns(acceleration)
        wanted_z = wanted_z + parameters.gravity
        if parameters.drag:
            hover = 4.0 * self.hover_speed
            braked = drag(axes, (elements[6], elements[7], elements[8]), (hover, 0.0, 0.0, 0.0))
            lost = to_world(axes, braked)
            wanted_x, wanted_y, wanted_z = (
                wanted - by / MASS for wanted, by in zip((wanted_x, wanted_y, wanted_z), lost, strict=True)
            )
        # Never upside down, and limited tilt: height takes precedence over horizontal motion.
        wanted_z = np.maximum(wanted_z, 0.2 * parameters.gravity)
        aside = np.sqrt(wanted_x * wanted_x + wanted_y * wanted_y)
        share = np.minimum(1.0, np.tan(parameters.max_tilt) * wanted_z / np.maximum(aside, 1e-9))
        wanted = (wanted_x * share, wanted_y * share, wanted_z)
        wanted_axes = _axes_towards(wanted, yaw)
        thrust = MASS * dot(wanted, axes[2])
        error = _attitude_error(axes, wanted_axes)
        frequency = (parameters.attitude_frequency, parameters.attitude_frequency, parameters.yaw_frequency)
        gyration = (
            (INERTIA[2] - INERTIA[1]) * rate[1] * rate[2],
            (INERTIA[0] - INERTIA[2]) * rate[2] * rate[0],
            (INERTIA[1] - INERTIA[0]) * rate[0] * rate[1],
        )
        torque = tuple(
            inertia * (-natural * natural * off - 2.0 * natural * turning) + spun
            for inertia, natural, off, turning, spun in zip(INERTIA, frequency, error, rate, gyration, strict=True)
        )
        speeds = rotor_speeds(thrust, torque, self.top_speed)
        return rows([speed / self.input_scale for speed in speeds], len(state))

    def vehicle(self) -> Vehicle:
        """Return its body and rotors in worlds with vehicles."""
        return QuadrotorVehicle(self.parameters, self.rotor_speeds)


def _axes_towards(thrust: Vector, yaw: Array) -> Axes:
    """Return the attitude with the z axis along a thrust and the nose at a yaw."""
    upwards = unit(thrust)
    left = unit(cross(upwards, (np.cos(yaw), np.sin(yaw), np.zeros_like(yaw))))
    return cross(left, upwards), left, upwards


def _attitude_error(axes: Axes, wanted: Axes) -> Vector:
    """Return the skew part of the rotation from one attitude to another as a vector in the axes of the body."""

    def element(row: int, column: int) -> Any:
        return dot(wanted[row], axes[column])

    return (
        0.5 * (element(2, 1) - element(1, 2)),
        0.5 * (element(0, 2) - element(2, 0)),
        0.5 * (element(1, 0) - element(0, 1)),
    )


class QuadrotorVehicle(Vehicle):
    """The bodies and rotors of quadrotors in worlds with vehicles."""

    def __init__(self, parameters: Any, rotor_speeds: Callable[[Array], Any]) -> None:
        self._parameters = parameters
        self._rotor_speeds = rotor_speeds

    def description(self) -> Path:
        """Return the URDF file that comes with this package."""
        return Path(__file__).parent / "assets" / "crazyflie.urdf"

    def pose(self, state: Array, margin: float = 0.0) -> tuple[Sequence[float], Sequence[float]]:
        """Return the position of the centre of mass and the attitude."""
        return state[:3].tolist(), attitude(state[3], state[4], state[5]).tolist()

    def attach(self, bodies: VehicleBodies, state: Array) -> None:
        """Set the inertia of the bodies.

        Raises:
            WorldError: The world has another gravity than the model.
        """
        self._bodies = bodies
        self._is_current = False
        gravity = list(bodies.gravity)
        *aside, down = gravity
        if any(aside) or down >= 0.0:
            raise WorldError(f"it needs gravity straight down, and that of the world is {gravity}")
        if not np.isclose(-down, self._parameters.gravity):
            raise WorldError(
                f"the gravity of the world is {-down:g} m/s^2, and the model's {self._parameters.gravity:g}: set "
                f"`gravity` to {-down:g}, too",
                *("with", "gravity"),
            )
        bodies.set_inertia(INERTIA)
        self._yaws = state[:, 5].copy()

    def start(self, rows: Sequence[int], state: Array) -> None:
        """Set the initial velocities."""
        for row, own, spin in zip(rows, state, _spins(state), strict=True):
            self._bodies.set_velocity(row, own[6:9].tolist(), spin.tolist())
            self._yaws[row] = own[5]
        self._is_current = False

    def actuate(self, control_input: Array) -> None:
        """Set the rotor speeds."""
        self._rotors = self._rotor_speeds(columns(control_input))
        self._thrust, self._torque = rotor_wrench(self._rotors)
        turning = self._rotors[0] + self._rotors[1] + self._rotors[2] + self._rotors[3]
        #: Drag over the velocity along the axes of the bodies [N s/m]; shape (3, n).
        self._drag = np.array([[-coefficient] for coefficient in DRAG]) * turning

    def push(self) -> None:
        """Apply thrust, reaction torques and aerodynamic forces at the centre of mass."""
        if not self._is_current:
            self._read_bodies()
        self._is_current = False
        axes, parameters = self._axes, self._parameters
        lift = self._thrust
        if parameters.ground_effect and self.ground is not None:
            lift = lift * ground_effect(self._values[:, 2] - self.ground)
        #: Force and torque along the axes of the bodies.
        along = np.zeros((2, 3, len(lift)))
        along[0, 2], along[1] = lift, self._torque
        if parameters.drag:
            along[0] += self._drag * _projections(axes, self._values[:, 7:10])
        force, torque = along[:, :1] * axes[0] + along[:, 1:2] * axes[1] + along[:, 2:] * axes[2]
        if parameters.downwash and self._bodies.count > 1:
            places, present = self._values[:, :3], self._bodies.present
            if present is not None:
                places = np.where(present[:, None], places, _ELSEWHERE)
            force[2] -= downwash(places)
        self._bodies.push(force.T, torque.T)

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
        state[:, 9:] = _projections(axes, values[:, 10:]).T
        return state, values[:, 7:10].copy()

    def displace(self, rows: Sequence[int], change: Array) -> None:
        """Displace and turn the bodies, and change their velocities; angular rates stay in the axes of the body."""
        changed = self.read()[0][list(rows)] + change
        values, spins = self._values[list(rows)], _spins(changed)
        values[:, :3], values[:, 7:10] = changed[:, :3], changed[:, 6:9]
        for row, own, state, spin in zip(rows, values, changed, spins, strict=True):
            own[3:7], own[10:13] = attitude(state[3], state[4], state[5]), spin
            self._yaws[row] = state[5]
            self._bodies.place(row, own.tolist())
        self._is_current = False

    def _read_bodies(self) -> None:
        """Read the poses and velocities of all bodies; valid until the next physics step."""
        values = self._values = self._bodies.read()
        self._axes = quaternion_axes(values[:, 3:7])
        self._is_current = True


def _projections(axes: Array, vectors: Array) -> Array:
    """Return the elements of vectors along the axes of bodies; (3, 3, n) and (n, 3) to (3, n)."""
    x, y, z = vectors.T
    found: Array = axes[:, 0] * x + axes[:, 1] * y + axes[:, 2] * z
    return found


def _spins(state: Array) -> Array:
    """Return the angular velocities in the world's coordinates [rad/s]; (n, 12) to (n, 3)."""
    values = columns(state)
    axes = body_axes(values[3], values[4], values[5], np)
    return np.stack(np.broadcast_arrays(*to_world(axes, (values[9], values[10], values[11]))), axis=1)
