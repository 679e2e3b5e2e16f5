"""The quadrotor: a Crazyflie 2.x, told the speeds of its four rotors.

Sources of the figures: [F] J. Foerster, System Identification of the Crazyflie 2.0 Nano Quadrocopter, ETH Zurich, 2015;
[L] C. Luis and J. Le Ny, Design of a Trajectory Tracking Controller for a Nanoquadcopter, Polytechnique Montreal, 2016
(arXiv:1608.05786); [P] J. Panerati et al., Learning to Fly, IROS 2021.
"""

from __future__ import annotations

import math as numbers
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import Parameters, Quantity, Vehicle, WorldError
from symaware_cli.core.model import columns, rows
from symaware_cli.models.noise import Deviation, NoisyModel

Array = NDArray[np.float64]
Vector = tuple[Any, Any, Any]

#: [kg], of the vehicle with its battery [L].
MASS = 0.027
#: [kg m^2] about the x, y and z axes; products of inertia, under a tenth of these, are left out [F].
INERTIA = (16.6e-6, 16.6e-6, 29.3e-6)
#: [m] From the centre to a rotor [F], and of that along either axis.
ARM = 0.046
REACH = ARM / numbers.sqrt(2.0)
#: [m] The radius of a propeller [L].
PROPELLER = 0.0231348
_RADIANS = (60.0 / (2.0 * numbers.pi)) ** 2
#: [N s^2] and [N m s^2]: thrust and reaction torque of a rotor by the square of its speed [L], who count in rpm.
THRUST, REACTION = 3.1582e-10 * _RADIANS, 7.9379e-12 * _RADIANS
#: [kg] Drag by the velocity and the sum of the rotors' speeds, along the axes of the body [F].
DRAG = (9.1785e-7, 9.1785e-7, 10.311e-7)
#: The thrust of all rotors at full speed, by the weight [P].
THRUST_TO_WEIGHT = 2.25
#: Where each rotor is, in units of REACH, and the sense in which its reaction turns the body: the first is in front on
#: the right, the others follow clockwise as seen from above; the first and the third turn counter-clockwise.
ROTORS = ((1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1))
#: Downwash: strength, and growth [1/m] and offset of its width with the distance [P].
_DOWNWASH = (2267.18, 0.16, -0.11)


class Quadrotor(NoisyModel):
    """A Crazyflie 2.x in flight: a rigid body under the thrust of four rotors, told their speeds.

    Its attitude is roll, pitch and yaw (first about z, then y, then x), which fail where the nose points straight up or
    down. Angular rates are about the axes of the body. Rotors reach their speed at once.

    In the world `pybullet` it is a body that can hit and be hit. Elsewhere the same equations are integrated; there the
    ground effect and downwash are left out.
    """

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

    class Parameters(Parameters):
        """What acts on it, and how it follows a velocity."""

        gravity: float = Field(9.81, gt=0, description="Acceleration of gravity [m/s^2]; that of the world.")
        drag: bool = Field(True, description="Whether the air brakes it.")
        ground_effect: bool = Field(
            False, description="Whether rotors push more near the height 0, in `pybullet` (Cheeseman and Bennett 1955)."
        )
        downwash: bool = Field(
            False, description="Whether those of its group that fly above push it down, in `pybullet`."
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

    @property
    def hover_speed(self) -> float:
        """The speed of each rotor at which it hovers [rad/s]."""
        return numbers.sqrt(MASS * self.parameters.gravity / (4.0 * THRUST))

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """From standstill to what lifts 2.25 times its weight on Earth."""
        return [0.0] * 4, [self.top_speed] * 4

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Newton's and Euler's equations of a rigid body."""
        roll, pitch, yaw = state[3], state[4], state[5]
        velocity, rate = (state[6], state[7], state[8]), (state[9], state[10], state[11])
        axes = body_axes(roll, pitch, yaw, math)
        thrust, torque = rotor_wrench(control_input)
        force: Vector = (0.0, 0.0, thrust)
        if self.parameters.drag:
            force = added(force, drag(axes, velocity, control_input))
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
        """The velocity in the state."""
        return state[:, 6:9].copy()

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Accelerate in proportion to what is missing to the wanted velocity, and keep the yaw."""
        wanted = self.parameters.velocity_gain * (velocity - state[:, 6:9])
        return self.accelerate(state, wanted, state[:, 5])

    def accelerate(self, state: Array, acceleration: Array, yaw: Array) -> Array:
        """Return the speeds of the rotors that tilt the vehicle towards an acceleration and push it there.

        Gravity and drag are made up for. The attitude is corrected on the group of rotations (T. Lee, M. Leok and N. H.
        McClamroch, Geometric Tracking Control of a Quadrotor UAV on SE(3), CDC 2010), without feeding forward how the
        wanted attitude turns.

        Args:
            state: Shape (n, 12).
            acceleration: What is wanted [m/s^2]; shape (n, 3).
            yaw: Where the nose is to point [rad]; shape (n,).

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
        # Never upside down, and never too far aside: height goes before way.
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
        return rows(_mixed(thrust, torque, self.top_speed), len(state))

    def vehicle(self) -> Vehicle:
        """Its body and rotors in the world `pybullet`."""
        return QuadrotorVehicle(self.parameters)


class QuadrotorVehicle(Vehicle):
    """The bodies and rotors of quadrotors in the world `pybullet`."""

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def description(self) -> Path:
        """Our own file."""
        return Path(__file__).parent / "assets" / "crazyflie.urdf"

    def pose(self, state: Array) -> tuple[Sequence[float], Sequence[float]]:
        """The centre of mass, turned by yaw, pitch and roll."""
        roll, pitch, yaw = (0.5 * float(angle) for angle in state[3:6])
        sine = [numbers.sin(half) for half in (roll, pitch, yaw)]
        cosine = [numbers.cos(half) for half in (roll, pitch, yaw)]
        orientation = (
            sine[0] * cosine[1] * cosine[2] - cosine[0] * sine[1] * sine[2],
            cosine[0] * sine[1] * cosine[2] + sine[0] * cosine[1] * sine[2],
            cosine[0] * cosine[1] * sine[2] - sine[0] * sine[1] * cosine[2],
            cosine[0] * cosine[1] * cosine[2] + sine[0] * sine[1] * sine[2],
        )
        return state[:3].tolist(), orientation

    def attach(self, engine: Any, client: int, bodies: Sequence[int], state: Array, step_time: float) -> None:
        """Set the bodies going.

        Raises:
            WorldError: The world has another gravity than the model, so that a hover would not hover.
        """
        self._engine, self._client, self._bodies = engine, client, tuple(bodies)
        self._fresh = False
        settings = engine.getPhysicsEngineParameters(client)
        gravity = [settings[f"gravityAcceleration{axis}"] for axis in "XYZ"]
        if not np.allclose(gravity, [0.0, 0.0, -self._parameters.gravity]):
            raise WorldError(
                f"the model has a `gravity` of {self._parameters.gravity:g}, and the world one of {gravity}"
            )
        values = columns(state)
        axes = body_axes(values[3], values[4], values[5], np)
        spins = np.stack(np.broadcast_arrays(*to_world(axes, (values[9], values[10], values[11]))), axis=1)
        for body, own, spin in zip(bodies, state, spins, strict=True):
            engine.changeDynamics(
                body, -1, linearDamping=0.0, angularDamping=0.0, localInertiaDiagonal=INERTIA, physicsClientId=client
            )
            engine.resetBaseVelocity(body, own[6:9].tolist(), spin.tolist(), client)
        self._yaws = state[:, 5].copy()
        self._inputs = np.zeros((len(bodies), 4))
        self._look()

    def actuate(self, control_input: Array) -> None:
        """Let the rotors turn at these speeds."""
        self._inputs = control_input
        self._rotors = columns(control_input)
        self._thrust, self._torque = rotor_wrench(self._rotors)

    def push(self) -> None:
        """Apply thrust, reaction and what the air does, at the centre of mass."""
        if not self._fresh:
            self._look()
        self._fresh = False
        axes, parameters = self._axes, self._parameters
        lift = self._thrust * self._near_ground() if parameters.ground_effect else self._thrust
        force: Vector = (np.zeros_like(lift), np.zeros_like(lift), lift)
        if parameters.drag:
            force = added(force, drag(axes, self._velocity, self._rotors))
        force, torque = to_world(axes, force), to_world(axes, self._torque)
        if parameters.downwash and len(self._bodies) > 1:
            force = (force[0], force[1], force[2] - self._washed_down())
        engine, client, frame = self._engine, self._client, self._engine.WORLD_FRAME
        forces, torques = np.stack(force, axis=1).tolist(), np.stack(torque, axis=1).tolist()
        for body, place, pushed, turned in zip(self._bodies, self._places, forces, torques, strict=True):
            engine.applyExternalForce(body, -1, pushed, place, frame, client)
            engine.applyExternalTorque(body, -1, turned, frame, client)

    def read(self) -> tuple[Array, Array]:
        """Read the poses and velocities of the bodies."""
        self._look()
        values = self._values
        axes = self._axes
        state = np.empty((len(values), 12))
        state[:, :3], state[:, 6:9] = values[:, :3], values[:, 7:10]
        state[:, 3] = np.arctan2(axes[1][2], axes[2][2])
        state[:, 4] = np.arcsin(np.clip(-axes[0][2], -1.0, 1.0))
        turned = np.arctan2(axes[0][1], axes[0][0])
        self._yaws = self._yaws + np.remainder(turned - self._yaws + np.pi, 2 * np.pi) - np.pi
        state[:, 5] = self._yaws
        spin = (values[:, 10], values[:, 11], values[:, 12])
        for axis in range(3):
            state[:, 9 + axis] = dot(axes[axis], spin)
        return state, values[:, 7:10].copy()

    def _look(self) -> None:
        """Read where everybody is and how it turns, until the next physics step."""
        engine, client = self._engine, self._client
        flat: list[float] = []
        self._places = []
        for body in self._bodies:
            position, orientation = engine.getBasePositionAndOrientation(body, client)
            velocity, spin = engine.getBaseVelocity(body, client)
            flat += position
            flat += orientation
            flat += velocity
            flat += spin
            self._places.append(position)
        values = self._values = np.array(flat).reshape(-1, 13)
        x, y, z, w = columns(values[:, 3:7])
        self._axes = (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        )
        velocity_x, velocity_y, velocity_z = columns(values[:, 7:10])
        self._velocity = (velocity_x, velocity_y, velocity_z)
        self._fresh = True

    def _near_ground(self) -> Array:
        """By how much more the rotors push above ground: 1 / (1 - (R / 4 z)^2), down to a height of R / 2."""
        share = PROPELLER / (4.0 * np.maximum(self._values[:, 2], 0.5 * PROPELLER))
        grown: Array = 1.0 / (1.0 - share * share)
        return grown

    def _washed_down(self) -> Array:
        """The force with which those who fly above push each down [N]; shape (n,)."""
        x, y, z = columns(self._values[:, :3])
        above = z[None, :] - z[:, None]
        below = above > 1e-3
        height = np.where(below, above, 1.0)
        strength = _DOWNWASH[0] * (PROPELLER / (4.0 * height)) ** 2
        width = _DOWNWASH[1] * height + _DOWNWASH[2]
        apart = (x[None, :] - x[:, None]) ** 2 + (y[None, :] - y[:, None]) ** 2
        pushed = strength * np.exp(-0.5 * apart / np.maximum(width * width, 1e-6))
        # Added up pair by pair, so that it does not matter how many there are.
        total = np.zeros(len(z))
        for other in range(len(z)):
            total += np.where(below[:, other] & (apart[:, other] < 100.0), pushed[:, other], 0.0)
        return total


def body_axes(roll: Any, pitch: Any, yaw: Any, math: Any) -> tuple[Vector, Vector, Vector]:
    """The axes of the body in the world's coordinates, which are the columns of its rotation matrix."""
    sine_r, cosine_r = math.sin(roll), math.cos(roll)
    sine_p, cosine_p = math.sin(pitch), math.cos(pitch)
    sine_y, cosine_y = math.sin(yaw), math.cos(yaw)
    return (
        (cosine_y * cosine_p, sine_y * cosine_p, -sine_p),
        (
            cosine_y * sine_p * sine_r - sine_y * cosine_r,
            sine_y * sine_p * sine_r + cosine_y * cosine_r,
            cosine_p * sine_r,
        ),
        (
            cosine_y * sine_p * cosine_r + sine_y * sine_r,
            sine_y * sine_p * cosine_r - cosine_y * sine_r,
            cosine_p * cosine_r,
        ),
    )


def rotor_wrench(speeds: Any) -> tuple[Any, Vector]:
    """The thrust of all rotors [N], and their torque about the axes of the body [N m]."""
    squares = [speeds[number] * speeds[number] for number in range(4)]
    thrust = THRUST * (squares[0] + squares[1] + squares[2] + squares[3])
    torque = tuple(
        sum(sign * square for sign, square in zip(signs, squares, strict=True)) * arm
        for signs, arm in (
            ([rotor[1] for rotor in ROTORS], THRUST * REACH),
            ([-rotor[0] for rotor in ROTORS], THRUST * REACH),
            ([rotor[2] for rotor in ROTORS], REACTION),
        )
    )
    return thrust, (torque[0], torque[1], torque[2])


def drag(axes: tuple[Vector, Vector, Vector], velocity: Vector, speeds: Any) -> Vector:
    """The force of the air, along the axes of the body [N]."""
    turning = speeds[0] + speeds[1] + speeds[2] + speeds[3]
    along = [-coefficient * turning * dot(axis, velocity) for coefficient, axis in zip(DRAG, axes, strict=True)]
    return along[0], along[1], along[2]


def dot(one: Vector, other: Vector) -> Any:
    """The scalar product."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def cross(one: Vector, other: Vector) -> Vector:
    """The vector product."""
    return (
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    )


def added(one: Vector, other: Vector) -> Vector:
    """The sum."""
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def to_world(axes: tuple[Vector, Vector, Vector], vector: Vector) -> Vector:
    """Turn a vector along the axes of the body into the world's coordinates."""
    x, y, z = axes
    turned = [vector[0] * x[axis] + vector[1] * y[axis] + vector[2] * z[axis] for axis in range(3)]
    return turned[0], turned[1], turned[2]


def _unit(vector: Vector) -> Vector:
    length = np.maximum(np.sqrt(dot(vector, vector)), 1e-9)
    return vector[0] / length, vector[1] / length, vector[2] / length


def _axes_towards(thrust: Vector, yaw: Array) -> tuple[Vector, Vector, Vector]:
    """The attitude whose z axis points along a thrust and whose nose points to a yaw."""
    upwards = _unit(thrust)
    left = _unit(cross(upwards, (np.cos(yaw), np.sin(yaw), np.zeros_like(yaw))))
    return cross(left, upwards), left, upwards


def _attitude_error(axes: tuple[Vector, Vector, Vector], wanted: tuple[Vector, Vector, Vector]) -> Vector:
    """Half of what is skew in the rotation from one attitude to another, about the axes of the body."""

    def element(row: int, column: int) -> Any:
        return dot(wanted[row], axes[column])

    return (
        0.5 * (element(2, 1) - element(1, 2)),
        0.5 * (element(0, 2) - element(2, 0)),
        0.5 * (element(1, 0) - element(0, 1)),
    )


def _mixed(thrust: Any, torque: Sequence[Any], top: float) -> list[Any]:
    """The speeds of the rotors for a thrust and a torque.

    Thrust gives way to what turns the vehicle over, and the yaw gives way to both, where the rotors cannot do all.
    """
    roll, pitch, yaw = (
        0.25 * torque[0] / (THRUST * REACH),
        0.25 * torque[1] / (THRUST * REACH),
        0.25 * torque[2] / REACTION,
    )
    most = top * top
    tilting = [rotor[1] * roll - rotor[0] * pitch for rotor in ROTORS]
    widest = np.abs(tilting[0])
    for each in tilting[1:]:
        widest = np.maximum(widest, np.abs(each))
    share = np.minimum(1.0, 0.5 * most / np.maximum(widest, 1e-9))
    widest = widest * share
    common = np.minimum(np.maximum(0.25 * thrust / THRUST, widest), most - widest)
    room = np.minimum(common - widest, most - common - widest)
    yaw = np.minimum(np.maximum(yaw, -room), room)
    return [
        np.sqrt(np.maximum(common + share * tilt + rotor[2] * yaw, 0.0))
        for tilt, rotor in zip(tilting, ROTORS, strict=True)
    ]
