"""Wheeled robots from files: a differential drive, and a car with steered wheels.

Reasons: docs/decisions/0080-robots-as-agents.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, field_validator, model_validator

from symaware_cli.assets import Mechanism, Motor, Placed, Posture, Postures
from symaware_cli.core import Entity, Model, Parameters, Quantity, WorldError
from symaware_cli.engine.models.heading import LaggedModel, SteeredModel, TurningModel, speeds_in_order
from symaware_cli.engine.models.robot_file import RobotFile, Wheel
from symaware_cli.engine.models.robot_links import RobotLinks
from symaware_cli.geometry import Array, about, continued, rotated, yaws

_Positive = Annotated[float, Field(gt=0, le=1e9)]
_Joints = Annotated[
    tuple[str, ...], Field(json_schema_extra={"minItems": 1}, description="The joints of these wheels in the file.")
]

_POSE = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"), Quantity("speed", "m/s"))


class WheelLimits(Parameters):
    """Limits of a robot on wheels, and what its file does not say."""

    min_speed: float = Field(-1.0, description="Least speed [m/s]; negative to drive backwards.")
    max_speed: _Positive = Field(1.0, description="Greatest speed, where the wheels can turn as fast [m/s].")
    steering_gain: _Positive = Field(
        4.0, description="Turn rate for each radian between the heading and the wanted direction [1/s]."
    )
    wheel_radius: _Positive | None = Field(
        None, description="Radius of the wheels [m]; by default that of the round shape with which they collide."
    )
    max_effort: _Positive | None = Field(
        None, description="Greatest torque on each wheel, where that of the file is not less [N m]."
    )
    response: _Positive = Field(0.1, description="Time constant of the speed where no motors turn the wheels [s].")

    _speeds_in_order = model_validator(mode="after")(speeds_in_order)


class WheeledModel(LaggedModel):
    """A robot on wheels: the common base of the differential drive and the car.

    Its parameters are `WheelLimits`. The state begins with x, y, heading and speed. The position is the middle of the
    axle, and the wheels stand on the ground.
    """

    state: tuple[Quantity, ...] = _POSE

    def __init__(self, parameters: BaseModel | None = None) -> None:
        Model.__init__(self, parameters)
        self._fastest = np.inf

    def noise_deviation(self, step: float) -> None:
        """Return None: it has no process noise."""

    def _speeds(self) -> tuple[float, float]:
        """Return the least and the greatest speed, as the wheels allow them [m/s]."""
        limits = self.parameters
        return max(limits.min_speed, -self._fastest), min(limits.max_speed, self._fastest)


class DifferentialDrive(WheeledModel, TurningModel):
    """A robot from a file whose left and right wheels turn at different speeds, driven as a unicycle is.

    Control inputs are the speed v and the turn rate w. Motors turn the wheels at (v -+ w T / 2) / r, where the track T
    and the radius r are those of the file. In worlds without motors, and for planning, speed and turn rate follow
    their set points with a time constant: x' = v cos(heading), y' = v sin(heading), heading' = w, v' = (speed - v) /
    response.

    Several wheels on each side slip sideways where it turns: it then turns slower than it should.
    """

    batchable = True

    state = (*_POSE, Quantity("turn_rate", "rad/s"))

    class Parameters(WheelLimits):
        """Wheels and limits."""

        left: _Joints
        right: _Joints
        max_turn_rate: _Positive = Field(2.0, description="Greatest turn rate to either side [rad/s].")
        track: _Positive | None = Field(
            None, description="Distance between left and right wheels [m]; by default that in the file."
        )

        @field_validator("left", "right")
        @classmethod
        def _has_some(cls, joints: tuple[str, ...]) -> tuple[str, ...]:
            if not joints:
                raise ValueError("name at least one wheel")
            return joints

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        self._wheels: tuple[Wheel, ...] = ()

    def fit(self, entity: Entity, folders: Any, *where: str) -> None:
        """Read the wheels from the file of the body."""
        robot, given = RobotFile.of(entity, folders, *where), self.parameters
        sides = {
            side: [
                robot.wheel(name, given.wheel_radius, *where, "model", "with", side, number)
                for number, name in enumerate(getattr(given, side))
            ]
            for side in ("left", "right")
        }
        for number, wheel in enumerate(sides["left"]):
            if wheel.y <= max(each.y for each in sides["right"]):
                said = f"the wheel of `{wheel.joint}` in `{robot.name}` is not to the left of those on the right"
                raise WorldError(said, *where, "model", "with", "left", number)
        self._wheels = (*sides["left"], *sides["right"])
        self._fastest = min(each.velocity * each.radius for each in self._wheels)
        self.links = RobotLinks(robot.tree, self.mechanism(), len(self.position))

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the rates of a unicycle with first-order lags of speed and turn rate."""
        heading, speed, turn_rate = state[2], state[3], state[4]
        lag = self.parameters.response
        return (
            speed * math.cos(heading),
            speed * math.sin(heading),
            turn_rate,
            (control_input[0] - speed) / lag,
            (control_input[1] - turn_rate) / lag,
        )

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of speed and turn rate."""
        low, high = self._speeds()
        most = self.parameters.max_turn_rate
        return [low, -most], [high, most]

    def mechanism(self) -> Mechanism:
        """Return its wheels and their motors."""
        if not self._wheels:
            raise WorldError("`DifferentialDrive.fit` tells the model its body first", "agents")
        return DifferentialMechanism(self._wheels, self.parameters)


class AckermannDrive(WheeledModel, SteeredModel):
    """A car from a file: motors turn driven wheels, and hinges steer the front ones as on a car (Ackermann).

    Control inputs are the speed v at the middle of the rear axle and the steering angle s of a bicycle with the same
    wheelbase L. The hinge of a front wheel that is y to the left turns by atan(L tan(s) / (L - y tan(s))), and a driven
    wheel rolls at the speed of its place on the curve. In worlds without motors, and for planning, it is a bicycle
    whose speed and steering angle follow their set points with a time constant: heading' = v tan(s) / L.
    """

    batchable = True

    state = (*_POSE, Quantity("steering_angle", "rad"))
    control_input = (Quantity("speed", "m/s"), Quantity("steering_angle", "rad"))
    angles: tuple[int, ...] = (2, 4)

    class Parameters(WheelLimits):
        """Wheels and limits."""

        driven: _Joints
        steered: tuple[str, str] = Field(description="The hinges that steer the left and the right front wheel.")
        rear: tuple[str, str] | None = Field(
            None, description="The wheels of the rear axle, if they are not those that are driven."
        )
        max_steering_angle: float = Field(
            0.4, gt=0, lt=1.5, description="Greatest steering angle to either side [rad]."
        )

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        self._wheels: tuple[Wheel, ...] = ()
        self._hinges: tuple[Wheel, ...] = ()
        self._axle = self._wheelbase = 1.0

    @property
    def wheelbase(self) -> float:
        """The distance between the axles, as in the file [m]; 1 before `fit`."""
        return self._wheelbase

    def fit(self, entity: Entity, folders: Any, *where: str) -> None:
        """Read wheels and hinges from the file of the body."""
        robot, given = RobotFile.of(entity, folders, *where), self.parameters
        at = (*where, "model", "with")
        self._wheels = tuple(
            robot.wheel(name, given.wheel_radius, *at, "driven", number) for number, name in enumerate(given.driven)
        )
        self._hinges = tuple(robot.hinge(name, *at, "steered", number) for number, name in enumerate(given.steered))
        rear = given.rear or [each.joint for each in self._wheels]
        named = "rear" if given.rear else "driven"
        wheels = [robot.wheel(name, given.wheel_radius, *at, named, number) for number, name in enumerate(rear)]
        self._axle = sum(each.x for each in wheels) / len(wheels)
        self._wheelbase = sum(each.x for each in self._hinges) / len(self._hinges) - self._axle
        if self._wheelbase <= 1e-3:
            raise WorldError(f"the hinges of `{robot.name}` are not ahead of its rear axle", *at, "steered")
        self._fastest = min(each.velocity * each.radius for each in self._wheels)
        self.links = RobotLinks(robot.tree, self.mechanism(), len(self.position))

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the rates of a bicycle with first-order lags of speed and steering angle."""
        heading, speed, angle = state[2], state[3], state[4]
        lag = self.parameters.response
        return (
            speed * math.cos(heading),
            speed * math.sin(heading),
            speed * math.tan(angle) / self.wheelbase,
            (control_input[0] - speed) / lag,
            (control_input[1] - angle) / lag,
        )

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of speed and steering angle."""
        low, high = self._speeds()
        most = self.parameters.max_steering_angle
        return [low, -most], [high, most]

    def mechanism(self) -> Mechanism:
        """Return its wheels and hinges with their motors."""
        if not self._wheels:
            raise WorldError("`AckermannDrive.fit` tells the model its body first", "agents")
        return AckermannMechanism(self._wheels, self._hinges, self._axle, self._wheelbase, self.parameters)


class _WheeledMechanism(Mechanism):
    """Stands on the ground, and reads the pose of the middle of an axle."""

    stands = True

    def __init__(self, ahead: float, aside: float) -> None:
        #: Where the middle of the axle is, in the frame of the base [m].
        self._middle = np.array([ahead, aside, 0.0])

    def _standing(self, state: Array, joints: Sequence[float], rates: Sequence[float], turn_rate: float) -> Posture:
        x, y, heading, speed = state[:4].tolist()
        orientation = about((0.0, 0.0, 1.0), heading)
        back = rotated(orientation, self._middle)
        forwards = speed * rotated(orientation, np.array([1.0, 0.0, 0.0])) - np.cross([0.0, 0.0, turn_rate], back)
        place = (x - float(back[0]), y - float(back[1]), 0.0)
        return Posture(place, orientation.tolist(), forwards.tolist(), (0.0, 0.0, turn_rate), joints, rates)

    def _placed(self, states: Array, joints: Array) -> Placed:
        """Return the robots upright on the ground."""
        orientations = about((0.0, 0.0, 1.0), states[:, 2])
        back = rotated(orientations, self._middle)
        positions = np.zeros((len(states), 3))
        positions[:, :2] = states[:, :2] - back[:, :2]
        return Placed(positions, orientations, joints)

    def _poses(self, postures: Postures, before: Array) -> list[Array]:
        """Return x, y, heading and speed of each."""
        middle = rotated(postures.orientations, np.broadcast_to(self._middle, postures.positions.shape))
        turned = yaws(postures.orientations)
        velocity = postures.velocities + np.cross(postures.rates, middle)
        speed = velocity[:, 0] * np.cos(turned) + velocity[:, 1] * np.sin(turned)
        place = postures.positions + middle
        return [place[:, 0], place[:, 1], continued(before[:, 2], turned), speed]


class DifferentialMechanism(_WheeledMechanism):
    """The wheels of a differential drive."""

    def __init__(self, wheels: Sequence[Wheel], parameters: Any) -> None:
        ahead, aside = (
            sum(values) / len(wheels) for values in zip(*((each.x, each.y) for each in wheels), strict=True)
        )
        super().__init__(ahead, aside)
        self.joints = [each.joint for each in wheels]
        self.known = ()
        most = parameters.max_effort or np.inf
        self.motors = [Motor(each.joint, "velocity", min(each.effort, most)) for each in wheels]
        across = np.array([each.y - aside for each in wheels])
        if parameters.track is not None:
            across = np.sign(across) * 0.5 * parameters.track
        scale = np.array([each.sign / each.radius for each in wheels])
        #: The velocity of each wheel for a speed, and for a turn rate.
        self._forwards, self._turning = scale, -across * scale

    def posture(self, state: Array) -> Posture:
        """Return the robot on the ground, with wheels that roll."""
        speed, turn_rate = state[3:5].tolist()
        rates = self._forwards * speed + self._turning * turn_rate
        return self._standing(state, [0.0] * len(self.joints), rates.tolist(), turn_rate)

    def placed(self, states: Array) -> Placed:
        """Return the robots on the ground."""
        return self._placed(states, np.zeros((len(states), len(self.joints))))

    def commands(self, control_input: Array) -> Array:
        """Return the velocities of the wheels."""
        speed, turn_rate = control_input[:, :1], control_input[:, 1:]
        wanted: Array = speed * self._forwards + turn_rate * self._turning
        return wanted

    def states(self, postures: Postures, before: Array) -> Array:
        """Return the poses of the robots, with speeds and turn rates."""
        return np.column_stack([*self._poses(postures, before), postures.rates[:, 2]])


class AckermannMechanism(_WheeledMechanism):
    """The driven wheels and the hinges of a car."""

    def __init__(
        self, wheels: Sequence[Wheel], hinges: Sequence[Wheel], axle: float, wheelbase: float, parameters: Any
    ) -> None:
        aside = sum(each.y for each in hinges) / len(hinges)
        super().__init__(axle, aside)
        self._wheelbase = wheelbase
        self._ahead = np.array([each.x - axle for each in wheels])
        self._aside = np.array([each.y - aside for each in wheels])
        self._scale = np.array([each.sign / each.radius for each in wheels])
        self._hinge = np.array([each.y - aside for each in hinges])
        self._signs = np.array([each.sign for each in hinges])
        self.joints = [each.joint for each in (*wheels, *hinges)]
        self.known = [each.joint for each in hinges]
        most = parameters.max_effort or np.inf
        self.motors = [
            *(Motor(each.joint, "velocity", min(each.effort, most)) for each in wheels),
            *(Motor(each.joint, "position", each.effort, each.velocity, 50.0) for each in hinges),
        ]

    def _turned(self, angle: Array) -> Array:
        """Return the positions of the hinges for steering angles; (n, 1) to (n, 2)."""
        tangent = np.tan(angle)
        turned: Array = self._signs * np.arctan(tangent / (1.0 - self._hinge * tangent / self._wheelbase))
        return turned

    def _rolled(self, speed: Array, angle: Array) -> Array:
        """Return the velocities of the wheels; (n, 1) to (n, wheels)."""
        curvature = np.tan(angle) / self._wheelbase
        # The wheels ahead of the rear axle roll along the direction in which they are steered.
        along = np.sqrt((1.0 - self._aside * curvature) ** 2 + (self._ahead * curvature) ** 2)
        rolled: Array = speed * along * self._scale
        return rolled

    def posture(self, state: Array) -> Posture:
        """Return the car on the ground, with wheels that roll and are steered."""
        speed, angle = state[3:4][None], state[4:5][None]
        turned = self._turned(angle)[0]
        joints = [*[0.0] * len(self._scale), *turned.tolist()]
        rates = [*self._rolled(speed, angle)[0].tolist(), *[0.0] * len(turned)]
        return self._standing(state, joints, rates, float(state[3] * np.tan(state[4]) / self._wheelbase))

    def placed(self, states: Array) -> Placed:
        """Return the cars on the ground, with wheels that are steered."""
        turned = self._turned(states[:, 4:5])
        return self._placed(states, np.concatenate([np.zeros((len(states), len(self._scale))), turned], axis=1))

    def commands(self, control_input: Array) -> Array:
        """Return the velocities of the wheels and the positions of the hinges."""
        speed, angle = control_input[:, :1], control_input[:, 1:]
        return np.concatenate([self._rolled(speed, angle), self._turned(angle)], axis=1)

    def states(self, postures: Postures, before: Array) -> Array:
        """Return the poses of the cars, with speeds and steering angles."""
        tangents = np.tan(self._signs * postures.joints[:, len(self._scale) :])
        angles = np.arctan(tangents / (1.0 + self._hinge * tangents / self._wheelbase)).mean(axis=1)
        return np.column_stack([*self._poses(postures, before), angles])
