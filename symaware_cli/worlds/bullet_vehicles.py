"""The bodies of vehicles in PyBullet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from symaware_cli.assets import VehicleBodies
from symaware_cli.geometry import Array
from symaware_cli.worlds.body_poses import read_bodies
from symaware_cli.worlds.bullet import engine

#: [m] The margin of the engine's collision shapes.
MARGIN = 0.001


class BulletVehicleBodies(VehicleBodies):
    """Bodies of one URDF file in a client of PyBullet."""

    margin = MARGIN

    def __init__(self, client: int, bodies: Sequence[int]) -> None:
        """Take over bodies.

        Args:
            client: The client's id.
            bodies: The engine's body of each row.
        """
        self.count, self._client, self._bodies = len(bodies), client, tuple(bodies)
        settings = engine.getPhysicsEngineParameters(client)
        self.gravity = [settings[f"gravityAcceleration{axis}"] for axis in "XYZ"]
        self._joints = {name: joint for joint, name in enumerate(joint_names(client, bodies[0]))} if bodies else {}
        self._motors: dict[str, tuple[str, float]] = {}

    def set_inertia(self, inertia: Sequence[float]) -> None:
        """Set moments of inertia without damping."""
        for body in self._bodies:
            engine.changeDynamics(
                body,
                -1,
                linearDamping=0.0,
                angularDamping=0.0,
                localInertiaDiagonal=inertia,
                physicsClientId=self._client,
            )

    def set_friction(self, friction: Mapping[str, float]) -> None:
        """Set the friction of the links that joints move."""
        for body in self._bodies:
            for joint in self._joints.values():
                engine.changeDynamics(
                    body,
                    joint,
                    lateralFriction=0.0,
                    linearDamping=0.0,
                    angularDamping=0.0,
                    physicsClientId=self._client,
                )
            for name, each in friction.items():
                engine.changeDynamics(body, self._joints[name], lateralFriction=each, physicsClientId=self._client)

    def release(self, joints: Sequence[str]) -> None:
        """Take away the motors that the engine gives to all joints."""
        for body in self._bodies:
            for name in joints:
                engine.setJointMotorControl2(
                    body, self._joints[name], engine.VELOCITY_CONTROL, force=0.0, physicsClientId=self._client
                )

    def add_motors(self, joints: Sequence[str], kind: Literal["rate", "angle"], torque: float) -> None:
        """Store kind and torque, which are passed to the engine with each target."""
        self._motors |= dict.fromkeys(joints, (kind, torque))

    def command(self, row: int, joints: Sequence[str], targets: Sequence[float]) -> None:
        """Set the targets of motors."""
        kind, torque = self._motors[joints[0]]
        mode, what = (
            (engine.VELOCITY_CONTROL, "targetVelocities")
            if kind == "rate"
            else (engine.POSITION_CONTROL, "targetPositions")
        )
        engine.setJointMotorControlArray(
            self._bodies[row],
            [self._joints[name] for name in joints],
            mode,
            forces=[torque] * len(joints),
            physicsClientId=self._client,
            **{what: list(targets)},
        )

    def push(self, forces: Array, torques: Array) -> None:
        """Apply forces and torques for one physics step."""
        client, frame = self._client, engine.WORLD_FRAME
        places = self._last[:, :3].tolist()
        for body, place, pushed, turned in zip(self._bodies, places, forces.tolist(), torques.tolist(), strict=True):
            engine.applyExternalForce(body, -1, pushed, place, frame, client)
            engine.applyExternalTorque(body, -1, turned, frame, client)

    def read(self) -> Array:
        """Read the centres of mass of the bases."""
        self._last = read_bodies(self._client, self._bodies)
        return self._last

    def place(self, row: int, values: Sequence[float]) -> None:
        """Set the pose and velocity of a body."""
        body, client = self._bodies[row], self._client
        engine.resetBasePositionAndOrientation(body, values[:3], values[3:7], client)
        engine.resetBaseVelocity(body, values[7:10], values[10:13], client)

    def set_velocity(self, row: int, velocity: Sequence[float], spin: Sequence[float]) -> None:
        """Set the velocity of a body."""
        engine.resetBaseVelocity(self._bodies[row], list(velocity), list(spin), self._client)

    def joint(self, row: int, joint: str) -> tuple[float, float]:
        """Return the position and the rate of a joint."""
        position, rate, *_ = engine.getJointState(self._bodies[row], self._joints[joint], self._client)
        return position, rate

    def set_joint(self, row: int, joint: str, position: float, rate: float) -> None:
        """Set the position and the rate of a joint."""
        engine.resetJointState(self._bodies[row], self._joints[joint], position, rate, self._client)


def joint_names(client: int, body: int) -> list[str]:
    """Return the names of all joints of a body, in the order of the engine."""
    return [engine.getJointInfo(body, joint, client)[1].decode() for joint in range(engine.getNumJoints(body, client))]
