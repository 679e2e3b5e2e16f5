"""The racecar of pybullet_data: four wheels, two of them driven and two steered."""

from __future__ import annotations

import math as numbers
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.assets import Vehicle, VehicleBodies
from symaware_cli.core import Entity, Parameters, Polygon, Quantity, Shape
from symaware_cli.engine.models.heading import LaggedModel, SteeredModel, speeds_in_order
from symaware_cli.engine.models.noise import Deviation
from symaware_cli.geometry import Array, about, composed, continued, yaws

#: [m] From pybullet_data/racecar/racecar.urdf: the wheelbase, the distance between the wheels of an axle, the radius
#: of a wheel, and the height of the axles above the origin.
WHEELBASE, TRACK, WHEEL_RADIUS, AXLE_HEIGHT = 0.325, 0.245, 0.05, 0.05
#: [rad] The limit of the hinges.
_MOST_STEERED = 1.0
#: [N m] The greatest torque of the hinges.
_HINGE_TORQUE = 10.0
#: The joints: wheels with and without a motor, and the hinges that steer.
_DRIVEN = ("left_rear_wheel_joint", "right_rear_wheel_joint")
_ROLLING = ("left_front_wheel_joint", "right_front_wheel_joint")
_STEERED = ("left_steering_hinge_joint", "right_steering_hinge_joint")
#: The colour of the wheels.
_TYRE = (0.1, 0.1, 0.1, 1.0)


class Racecar(LaggedModel, SteeredModel):
    """A model car of the scale 1:10 (MIT Racecar), with speed and steering angle as control input.

    In the world `pybullet` it is the car of racecar/racecar.urdf in pybullet_data, in `mujoco` one of the same lengths
    and masses. Motors turn the rear wheels and the front hinges with limited torque, and friction with the ground
    drives it. The inner wheels turn slower and steer more, as on a car (Ackermann).

    In worlds without vehicles, and for planning, it is a kinematic bicycle whose speed and steering angle follow their
    set points with a time constant each: x' = v cos(heading), y' = v sin(heading), heading' = v tan(s) / L,
    v' = (speed - v) / speed_time, s' = (steering_angle - s) / steering_time.

    The position is the middle of the rear axle, and the wheels stand on the ground.
    """

    batchable = True

    state = (
        Quantity("x", "m"),
        Quantity("y", "m"),
        Quantity("heading", "rad"),
        Quantity("speed", "m/s"),
        Quantity("steering_angle", "rad"),
    )
    angles = (2, 4)
    wheelbase = WHEELBASE
    # The outline of the file's collision shapes, around the middle of the rear axle, and its total mass.
    body = Entity(
        shape=Shape(polygon=Polygon(vertices=((-0.06, -0.15), (0.41, -0.15), (0.41, 0.15), (-0.06, 0.15)))), mass=5.89
    )

    class Parameters(Parameters):
        """Limits, time constants and tyres of the racecar."""

        min_speed: float = Field(-1.0, description="Least speed [m/s]; negative to drive backwards.")
        max_speed: float = Field(3.0, gt=0, description="Greatest speed [m/s].")
        max_steering_angle: float = Field(
            0.5, gt=0, lt=1.0, description="Greatest steering angle to either side [rad]."
        )
        steering_gain: float = Field(
            4.0, gt=0, description="Turn rate for each radian between the heading and the wanted direction [1/s]."
        )
        speed_time: float = Field(0.2, gt=0, description="Time constant of the speed, in worlds without vehicles [s].")
        steering_time: float = Field(
            0.05, gt=0, description="Time constant of the steering angle, in worlds without vehicles [s]."
        )
        motor_torque: float = Field(
            0.5, gt=0, description="Greatest torque on each rear wheel, in worlds with vehicles [N m]."
        )
        wheel_friction: float = Field(
            1.0,
            ge=0,
            description="Coefficient of friction of the tyres, in worlds with vehicles; times that of the ground.",
        )
        process_noise: Deviation = None

        _speeds_in_order = model_validator(mode="after")(speeds_in_order)

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the rates of a bicycle with first-order lags of speed and steering angle."""
        heading, speed, angle = state[2], state[3], state[4]
        return (
            speed * math.cos(heading),
            speed * math.sin(heading),
            speed * math.tan(angle) / WHEELBASE,
            (control_input[0] - speed) / self.parameters.speed_time,
            (control_input[1] - angle) / self.parameters.steering_time,
        )

    def vehicle(self) -> Vehicle:
        """Return its wheels and hinges in worlds with vehicles."""
        return RacecarVehicle(self.parameters)


class RacecarVehicle(Vehicle):
    """The wheels and hinges of racecars in worlds with vehicles."""

    # The chassis has no collision shape that it could be derived from.
    inertia_from_file = True
    needs_ground = True
    #: Textures of wheels take 0.9 MB each, more than half of a car's memory.
    colours: ClassVar[Mapping[str, tuple[float, float, float, float]]] = dict.fromkeys((*_DRIVEN, *_ROLLING), _TYRE)

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def description(self) -> Path:
        """Return the file in pybullet_data."""
        import pybullet_data

        return Path(pybullet_data.getDataPath(), "racecar", "racecar.urdf")

    def portable_description(self) -> Path:
        """Return the URDF file that comes with this package, which has the same links and joints."""
        return Path(__file__).parent / "assets" / "racecar.urdf"

    def pose(self, state: Array, margin: float = 0.0) -> tuple[Sequence[float], Sequence[float]]:
        """Return the pose of the base, which is the middle of the rear axle at the height of standing wheels."""
        half, height = 0.5 * float(state[2]), (self.ground or 0.0) + _radius(margin) - AXLE_HEIGHT
        return (float(state[0]), float(state[1]), height), (0.0, 0.0, numbers.sin(half), numbers.cos(half))

    def attach(self, bodies: VehicleBodies, state: Array) -> None:
        """Set the tyres' friction, and add the motors."""
        self._bodies = bodies
        self._radius = _radius(bodies.margin)
        self._headings = state[:, 2].copy()
        self._last_inputs: list[list[float]] = [[] for _ in range(bodies.count)]
        bodies.set_friction(dict.fromkeys((*_DRIVEN, *_ROLLING), self._parameters.wheel_friction))
        bodies.release(_ROLLING)
        bodies.add_motors(_DRIVEN, "rate", self._parameters.motor_torque)
        bodies.add_motors(_STEERED, "angle", _HINGE_TORQUE)

    def start(self, rows: Sequence[int], state: Array) -> None:
        """Set the initial velocities, and the angles of the hinges."""
        for row, own in zip(rows, state, strict=True):
            for joint in (*_DRIVEN, *_ROLLING):
                self._bodies.set_joint(row, joint, 0.0, float(own[3]) / self._radius)
            for joint, angle in zip(_STEERED, hinge_angles(float(own[4])), strict=True):
                self._bodies.set_joint(row, joint, angle, 0.0)
            heading, speed = float(own[2]), float(own[3])
            forwards = (speed * numbers.cos(heading), speed * numbers.sin(heading), 0.0)
            self._bodies.set_velocity(row, forwards, (0.0, 0.0, speed * numbers.tan(own[4]) / WHEELBASE))
            self._headings[row] = own[2]

    def actuate(self, control_input: Array) -> None:
        """Set the motors of cars whose control input has changed."""
        for row, requested in enumerate(control_input.tolist()):
            if requested == self._last_inputs[row]:
                continue
            self._last_inputs[row] = requested
            speed, angle = requested
            aside = 0.5 * TRACK * numbers.tan(angle) / WHEELBASE
            rates = [speed * (1.0 - aside) / self._radius, speed * (1.0 + aside) / self._radius]
            self._bodies.command(row, _DRIVEN, rates)
            self._bodies.command(row, _STEERED, hinge_angles(angle))

    def read(self) -> tuple[Array, Array]:
        """Read the pose and velocity of the base, and the hinges."""
        values = self._bodies.read()
        hinges = [self._bodies.joint(row, _STEERED[0])[0] for row in range(len(values))]
        turned = yaws(values[:, 3:7])
        self._headings = continued(self._headings, turned)
        state = np.empty((len(values), 5))
        state[:, :2], state[:, 2] = values[:, :2], self._headings
        state[:, 3] = values[:, 7] * np.cos(turned) + values[:, 8] * np.sin(turned)
        tangent = np.tan(hinges)
        state[:, 4] = np.arctan(tangent / (1.0 + 0.5 * TRACK / WHEELBASE * tangent))
        return state, values[:, 7:10]

    def displace(self, rows: Sequence[int], change: Array) -> None:
        """Move the rear axle over the ground, and turn the car about it and its front wheels, without tilting."""
        states = self.read()[0][list(rows)]
        values = self._bodies.read()[list(rows)]
        for row, own, state, (x, y, heading, speed, angle) in zip(rows, values, states, change.tolist(), strict=True):
            own[:2] += x, y
            own[3:7] = composed(about((0.0, 0.0, 1.0), heading), own[3:7])
            cosine, sine = numbers.cos(heading), numbers.sin(heading)
            own[7:9] = cosine * own[7] - sine * own[8], sine * own[7] + cosine * own[8]
            towards = float(state[2]) + heading
            self._headings[row] += heading
            own[7:9] += speed * numbers.cos(towards), speed * numbers.sin(towards)
            self._bodies.place(row, own.tolist())
            steered = min(max(float(state[4]) + angle, -_MOST_STEERED), _MOST_STEERED)
            for joint, turned in zip(_STEERED, hinge_angles(steered), strict=True):
                self._bodies.set_joint(row, joint, turned, 0.0)
            for joint in (*_DRIVEN, *_ROLLING):
                turned, rate = self._bodies.joint(row, joint)
                self._bodies.set_joint(row, joint, turned, rate + speed / self._radius)


def _radius(margin: float) -> float:
    """Return the distance of the axles from the ground on which the wheels stand [m]."""
    return round(WHEEL_RADIUS + margin, 9)


def hinge_angles(angle: float) -> list[float]:
    """Return the angles of the left and right hinge equivalent to a bicycle's steering angle [rad]."""
    tangent = numbers.tan(angle)
    aside = 0.5 * TRACK * tangent / WHEELBASE
    return [numbers.atan(tangent / (1.0 - aside)), numbers.atan(tangent / (1.0 + aside))]
