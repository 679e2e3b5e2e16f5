"""The racecar of pybullet_data: four wheels, two of them driven and two steered."""

from __future__ import annotations

import math as numbers
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.assets import Vehicle, place_body, read_bodies
from symaware_cli.core import Entity, Model, Parameters, Polygon, Quantity, Shape
from symaware_cli.engine.models.heading import SteeredModel, speeds_in_order
from symaware_cli.engine.models.noise import Deviation
from symaware_cli.geometry import Array, about, composed, continued, yaws

#: [m] From pybullet_data/racecar/racecar.urdf: the wheelbase, the distance between the wheels of an axle, and the
#: radius of a wheel, to which PyBullet adds a margin of 1 mm.
WHEELBASE, TRACK, WHEEL_RADIUS = 0.325, 0.245, 0.051
#: [rad] The limit of the hinges.
_MOST_STEERED = 1.0
#: The colour of the wheels.
_TYRE = (0.1, 0.1, 0.1, 1.0)


class Racecar(SteeredModel):
    """A model car of the scale 1:10 (MIT Racecar), with speed and steering angle as control input.

    In the world `pybullet` it is the car of racecar/racecar.urdf in pybullet_data. Motors turn the rear wheels and the
    front hinges with limited torque, and friction with the ground drives it. The inner wheels turn slower and steer
    more, as on a car (Ackermann).

    In other worlds, and for planning, it is a kinematic bicycle whose speed and steering angle follow their set points
    with a time constant each: x' = v cos(heading), y' = v sin(heading), heading' = v tan(s) / L, v' = (speed - v) /
    speed_time, s' = (steering_angle - s) / steering_time.

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
        speed_time: float = Field(0.2, gt=0, description="Time constant of the speed, outside of `pybullet` [s].")
        steering_time: float = Field(
            0.05, gt=0, description="Time constant of the steering angle, outside of `pybullet` [s]."
        )
        motor_torque: float = Field(0.5, gt=0, description="Greatest torque on each rear wheel, in `pybullet` [N m].")
        wheel_friction: float = Field(
            1.0, ge=0, description="Coefficient of friction of the tyres, in `pybullet`; times that of the ground."
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

    def successor(  # type: ignore[override]
        self, state: Any, control_input: Any, step: Any, math: Any
    ) -> None:
        """Return None: the model has no closed form."""
        return

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return the Jacobian by central differences."""
        return Model.jacobian(self, state, control_input)

    def velocity(self, state: Array, control_input: Array) -> Array:
        """Return the velocity along the heading, with the speed in the state."""
        heading, speed = state[:, 2].copy(), state[:, 3].copy()
        return np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=1)

    def vehicle(self) -> Vehicle:
        """Return its wheels and hinges in the world `pybullet`."""
        return RacecarVehicle(self.parameters)


class RacecarVehicle(Vehicle):
    """The wheels and hinges of racecars in the world `pybullet`."""

    #: URDF_USE_INERTIA_FROM_FILE: by default PyBullet derives inertia from collision shapes, and the chassis has none.
    flags = 2
    needs_ground = True

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def description(self) -> Path:
        """Return the file in pybullet_data."""
        import pybullet_data

        return Path(pybullet_data.getDataPath(), "racecar", "racecar.urdf")

    def pose(self, state: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return the pose of the base, which is the middle of the rear axle at the height of standing wheels."""
        half, height = 0.5 * float(state[2]), (self.ground or 0.0) + WHEEL_RADIUS - 0.05
        return (float(state[0]), float(state[1]), height), (0.0, 0.0, numbers.sin(half), numbers.cos(half))

    def dress(self, engine: Any, client: int, body: int) -> None:
        """Replace the textures of the wheels by a colour: they take 0.9 MB each, more than half of a car's memory."""
        for joint, name in enumerate(self._joints(engine, client, body)):
            if name.endswith("_wheel_joint"):
                engine.changeVisualShape(body, joint, textureUniqueId=-1, rgbaColor=_TYRE, physicsClientId=client)

    def attach(self, engine: Any, client: int, bodies: Sequence[int], state: Array, step_time: float) -> None:
        """Find the joints, and set the initial velocities."""
        self._engine, self._client, self._bodies = engine, client, tuple(bodies)
        names = {name: joint for joint, name in enumerate(self._joints(engine, client, bodies[0]))}
        self._driven = [names["left_rear_wheel_joint"], names["right_rear_wheel_joint"]]
        rolling = [names["left_front_wheel_joint"], names["right_front_wheel_joint"]]
        self._rolling = [*self._driven, *rolling]
        self._steered = [names["left_steering_hinge_joint"], names["right_steering_hinge_joint"]]
        self._headings = state[:, 2].copy()
        self._last_inputs: list[list[float]] = [[] for _ in bodies]
        for body, own in zip(bodies, state, strict=True):
            for joint in names.values():
                engine.changeDynamics(
                    body, joint, lateralFriction=0.0, linearDamping=0.0, angularDamping=0.0, physicsClientId=client
                )
            for joint in self._rolling:
                friction = self._parameters.wheel_friction
                engine.changeDynamics(body, joint, lateralFriction=friction, physicsClientId=client)
                engine.resetJointState(body, joint, 0.0, float(own[3]) / WHEEL_RADIUS, client)
            for joint in rolling:
                engine.setJointMotorControl2(body, joint, engine.VELOCITY_CONTROL, force=0.0, physicsClientId=client)
            for joint, angle in zip(self._steered, hinge_angles(float(own[4])), strict=True):
                engine.resetJointState(body, joint, angle, 0.0, client)
            heading, speed = float(own[2]), float(own[3])
            forwards = (speed * numbers.cos(heading), speed * numbers.sin(heading), 0.0)
            engine.resetBaseVelocity(body, forwards, (0.0, 0.0, speed * numbers.tan(own[4]) / WHEELBASE), client)

    def _joints(self, engine: Any, client: int, body: int) -> list[str]:
        """Return the names of all joints, in the order of the engine."""
        return [
            engine.getJointInfo(body, joint, client)[1].decode() for joint in range(engine.getNumJoints(body, client))
        ]

    def actuate(self, control_input: Array) -> None:
        """Set the motors of cars whose control input has changed."""
        engine, torque = self._engine, self._parameters.motor_torque
        for row, (body, requested) in enumerate(zip(self._bodies, control_input.tolist(), strict=True)):
            if requested == self._last_inputs[row]:
                continue
            self._last_inputs[row] = requested
            speed, angle = requested
            aside = 0.5 * TRACK * numbers.tan(angle) / WHEELBASE
            engine.setJointMotorControlArray(
                body,
                self._driven,
                engine.VELOCITY_CONTROL,
                targetVelocities=[speed * (1.0 - aside) / WHEEL_RADIUS, speed * (1.0 + aside) / WHEEL_RADIUS],
                forces=[torque, torque],
                physicsClientId=self._client,
            )
            engine.setJointMotorControlArray(
                body,
                self._steered,
                engine.POSITION_CONTROL,
                targetPositions=hinge_angles(angle),
                forces=[10.0, 10.0],
                physicsClientId=self._client,
            )

    def read(self) -> tuple[Array, Array]:
        """Read the pose and velocity of the base, and the hinges."""
        engine, client = self._engine, self._client
        values = read_bodies(engine, client, self._bodies)
        hinges = [engine.getJointState(body, self._steered[0], client)[0] for body in self._bodies]
        turned = yaws(values[:, 3:7])
        self._headings = continued(self._headings, turned)
        state = np.empty((len(self._bodies), 5))
        state[:, :2], state[:, 2] = values[:, :2], self._headings
        state[:, 3] = values[:, 7] * np.cos(turned) + values[:, 8] * np.sin(turned)
        tangent = np.tan(hinges)
        state[:, 4] = np.arctan(tangent / (1.0 + 0.5 * TRACK / WHEELBASE * tangent))
        return state, values[:, 7:10]

    def displace(self, rows: Sequence[int], change: Array) -> None:
        """Move the rear axle over the ground, and turn the car about it and its front wheels, without tilting."""
        engine, client = self._engine, self._client
        states = self.read()[0][list(rows)]
        values = read_bodies(engine, client, [self._bodies[row] for row in rows])
        for row, own, state, (x, y, heading, speed, angle) in zip(rows, values, states, change.tolist(), strict=True):
            own[:2] += x, y
            own[3:7] = composed(about((0.0, 0.0, 1.0), heading), own[3:7])
            cosine, sine = numbers.cos(heading), numbers.sin(heading)
            own[7:9] = cosine * own[7] - sine * own[8], sine * own[7] + cosine * own[8]
            towards = float(state[2]) + heading
            self._headings[row] += heading
            own[7:9] += speed * numbers.cos(towards), speed * numbers.sin(towards)
            place_body(engine, client, self._bodies[row], own.tolist())
            steered = min(max(float(state[4]) + angle, -_MOST_STEERED), _MOST_STEERED)
            for joint, turned in zip(self._steered, hinge_angles(steered), strict=True):
                engine.resetJointState(self._bodies[row], joint, turned, 0.0, client)
            for joint in self._rolling:
                turned, rate = engine.getJointState(self._bodies[row], joint, client)[:2]
                engine.resetJointState(self._bodies[row], joint, turned, rate + speed / WHEEL_RADIUS, client)


def hinge_angles(angle: float) -> list[float]:
    """Return the angles of the left and right hinge equivalent to a bicycle's steering angle [rad]."""
    tangent = numbers.tan(angle)
    aside = 0.5 * TRACK * tangent / WHEELBASE
    return [numbers.atan(tangent / (1.0 - aside)), numbers.atan(tangent / (1.0 + aside))]
