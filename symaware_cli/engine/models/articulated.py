"""Articulated robots: arms, grippers and other robots from files, whose input drives their joints.

Reasons: docs/decisions/0080-robots-as-agents.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, field_validator

from symaware_cli.assets import Mechanism, Motor, Placed, Posture, Postures
from symaware_cli.core import Entity, Model, Parameters, Quantity, WorldError
from symaware_cli.engine.models.robot_file import RobotFile
from symaware_cli.engine.models.robot_links import RobotLinks
from symaware_cli.geometry import Array, about, attitude, continued, yaws

_Positive = Annotated[float, Field(gt=0, le=1e9)]

_FIXED = (*(Quantity(axis, "m") for axis in "xyz"), Quantity("heading", "rad"))
_FREE = (
    *(Quantity(axis, "m") for axis in "xyz"),
    *(Quantity(angle, "rad") for angle in ("roll", "pitch", "yaw")),
    *(Quantity(f"velocity_{axis}", "m/s") for axis in "xyz"),
    *(Quantity(f"rate_{axis}", "rad/s") for axis in "xyz"),
)


class ArticulatedRobot(Model):
    """A robot from a URDF or MJCF file whose control input has an element for each of the joints that are named.

    The state has the pose of the base, and then the positions and the velocities of the joints. A fixed base stays
    where the initial state puts it: x, y, z, heading. A free one has x, y, z, roll, pitch, yaw, the velocity of its
    origin and its angular velocity in the world's coordinates. Other joints of the file move freely.

    The world `mujoco` moves links and joints with the masses, limits and efforts of the file. Without it, and for
    planning, joints of a fixed robot follow velocities and positions with a time constant, q'' = (v - q') / response.
    """

    uncaptured = ("_robot",)  # the file, which no run changes
    batchable = True

    class Parameters(Parameters):
        """Joints and their drives."""

        joints: tuple[str, ...] = Field(
            json_schema_extra={"minItems": 1},
            description="The joints that the control input drives, by their names in the file.",
        )
        drive: Literal["velocity", "position", "torque"] = Field(
            "velocity",
            description="What each element of the control input is: a joint's velocity [rad/s or m/s], position [rad "
            "or m], or torque [N m] or force [N]. All are limited as the file says.",
        )
        base: Literal["fixed", "free"] = Field(
            "fixed", description="fixed: the base stays where the initial state puts it; free: it falls and is pushed."
        )
        max_velocity: _Positive | None = Field(
            None, description="Greatest velocity of every joint, where the file has no smaller one [rad/s] or [m/s]."
        )
        max_effort: _Positive | None = Field(
            None,
            description="Greatest torque or force of every joint, where the file has no smaller one [N m] or [N].",
        )
        gain: _Positive = Field(
            10.0, description="Velocity for each radian or metre that is left to the position of a joint [1/s]."
        )
        response: _Positive = Field(
            0.05, description="Time constant of the joints' velocities where no motors move them [s]."
        )

        @field_validator("joints")
        @classmethod
        def _differ(cls, joints: tuple[str, ...]) -> tuple[str, ...]:
            if not joints:
                raise ValueError("name at least one joint")
            taken = {quantity.name for quantity in (*_FIXED, *_FREE)}
            for number, name in enumerate(joints):
                if name in joints[:number]:
                    raise ValueError(f"the joint `{name}` is named twice")
                if name in taken or f"{name}_velocity" in joints:
                    raise ValueError(f"a joint called `{name}` would have the name of another element of the state")
            return joints

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        self._robot: RobotFile | None = None
        self._limits: list[tuple[float, float, float, float]] = []
        self._declare([True] * len(self.parameters.joints))
        self._is_free = self.parameters.base == "free"
        if self._is_free:
            self.velocities = (6, 7, 8)
        self.needs = ("mechanisms",) if self._is_free or self.parameters.drive == "torque" else ()

    def _declare(self, turns: Sequence[bool]) -> None:
        names, base = self.parameters.joints, _FREE if self.parameters.base == "free" else _FIXED
        units = ["rad" if each else "m" for each in turns]
        rates = [Quantity(f"{name}_velocity", f"{unit}/s") for name, unit in zip(names, units, strict=True)]
        self.state = (*base, *map(Quantity, names, units), *rates)
        forces = ["N m" if each else "N" for each in turns]
        wanted = {"velocity": [rate.unit for rate in rates], "position": units, "torque": forces}
        self.control_input = tuple(map(Quantity, names, wanted[self.parameters.drive]))
        self.position = (0, 1, 2)
        self.heading = 5 if base is _FREE else 3
        self.angles = tuple(number for number, quantity in enumerate(self.state) if quantity.unit == "rad")

    def fit(self, entity: Entity, folders: Any, *where: str) -> None:
        """Read the joints and their limits from the file of the body."""
        robot = self._robot = RobotFile.of(entity, folders, *where)
        given = self.parameters
        joints = [
            robot.joint(name, *where, "model", "with", "joints", number) for number, name in enumerate(given.joints)
        ]
        self._declare([joint.turns for joint in joints])
        self._limits = [
            (
                *(joint.lower, joint.upper),
                min(joint.velocity, given.max_velocity or np.inf),
                min(joint.effort, given.max_effort or np.inf),
            )
            for joint in joints
        ]
        self.links = RobotLinks(robot.tree, self.mechanism(), len(self.position))

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of the joints, as the drive needs them."""
        if not self._limits:
            return super().input_bounds()
        lower, upper, velocity, effort = zip(*self._limits, strict=True)
        if self.parameters.drive == "position":
            return lower, upper
        most = velocity if self.parameters.drive == "velocity" else effort
        return [-each for each in most], most

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the rates of a robot with a fixed base whose joints have a lag.

        Raises:
            NotImplementedError: The base is free, or the drive a torque: only an engine knows its motion.
        """
        if self.needs:
            raise NotImplementedError("a robot with a free base, or driven by torques, moves in worlds with mechanisms")
        given, count, base = self.parameters, len(self.parameters.joints), len(_FIXED)
        rates = [state[base + count + number] for number in range(count)]
        changes = []
        for number, rate in enumerate(rates):
            wanted = control_input[number]
            if given.drive == "position":
                wanted = given.gain * (wanted - state[base + number])
            changes.append((wanted - rate) / given.response)
        return (*(0.0 * state[number] for number in range(base)), *rates, *changes)

    def velocity(self, state: Array, control_input: Array) -> Array:
        """Return the velocity of the base."""
        return state[:, 6:9].copy() if self._is_free else np.zeros((len(state), 3))

    def turn_rate(self, state: Array, control_input: Array) -> Array:
        """Return the turn rate of the base about the vertical."""
        return state[:, 11].copy() if self._is_free else np.zeros(len(state))

    def mechanism(self) -> Mechanism:
        """Return its joints and motors."""
        if self._robot is None:
            raise WorldError("`ArticulatedRobot.fit` tells the model its body first", "agents")
        return JointMechanism(self.parameters, self._limits)


class JointMechanism(Mechanism):
    """The joints and motors of articulated robots."""

    def __init__(self, parameters: Any, limits: Sequence[tuple[float, float, float, float]]) -> None:
        self.joints = parameters.joints
        self.is_fixed = parameters.base == "fixed"
        self.motors = [
            Motor(name, parameters.drive, effort, velocity, parameters.gain)
            for name, (_, _, velocity, effort) in zip(parameters.joints, limits, strict=True)
        ]

    def posture(self, state: Array) -> Posture:
        """Return the posture that the state has."""
        count, base = len(self.joints), len(_FIXED if self.is_fixed else _FREE)
        values = state.tolist()
        joints, rates = values[base : base + count], values[base + count :]
        if self.is_fixed:
            orientation = about((0.0, 0.0, 1.0), values[3]).tolist()
            return Posture(values[:3], orientation, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), joints, rates)
        return Posture(values[:3], attitude(*values[3:6]).tolist(), values[6:9], values[9:12], joints, rates)

    def placed(self, states: Array) -> Placed:
        """Return the poses of bases and the positions of joints that states have."""
        base = len(_FIXED if self.is_fixed else _FREE)
        if self.is_fixed:
            orientations = about((0.0, 0.0, 1.0), states[:, 3])
        else:
            orientations = attitude(states[:, 3], states[:, 4], states[:, 5])
        return Placed(states[:, :3], orientations, states[:, base : base + len(self.joints)])

    def commands(self, control_input: Array) -> Array:
        """Return the control inputs."""
        return control_input

    def states(self, postures: Postures, before: Array) -> Array:
        """Return the poses of bases with the positions and velocities of joints."""
        moving = [postures.joints, postures.joint_velocities]
        if self.is_fixed:
            return np.column_stack([before[:, :4], *moving])
        x, y, z, w = postures.orientations.T
        roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
        heading = continued(before[:, 5], yaws(postures.orientations))
        return np.column_stack([postures.positions, roll, pitch, heading, postures.velocities, postures.rates, *moving])
