"""The bodies of vehicles in MuJoCo: free bodies with joints, whose motors are actuators.

Reasons: docs/decisions/0081-vehicles-and-cameras.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from symaware_cli.assets import AssetFolders, VehicleBodies
from symaware_cli.core import EntityGroup, Urdf, WorldError
from symaware_cli.geometry import Array, Mask, rotated
from symaware_mujoco.robot import read_robot
from symaware_mujoco.scene import Scene, Surface

#: The part of the way to its target by which a motor turns a joint in a physics step.
_SHARE = 0.1

#: The elements x, y, z, x, y, whose slices are the factors of cross products.
_CYCLIC = np.array([0, 1, 2, 0, 1])


def read_vehicle(file: Path, *where: str) -> Any:
    """Return the specification of a vehicle from a file of an installed package.

    Args:
        file: The file.
        where: The path of the model, for messages.

    Raises:
        WorldError: The file is damaged, or describes something that this world does not move.
    """
    folder = file.parent
    try:
        return read_robot(Urdf(file=f"{folder.name}/{file.name}", radius=1.0), AssetFolders(folder.parent), *where)
    except WorldError as error:
        raise WorldError(str(error), *where) from error


def add_vehicle(scene: Scene, name: str, robot: Any, surface: Surface) -> None:
    """Add a copy of a vehicle: a free body, with an idle actuator for each of its joints.

    Args:
        scene: The scene.
        name: The id of the agent.
        robot: The specification from `read_vehicle`.
        surface: The surface of all its links.
    """
    base = scene.attach(name, robot.copy(), surface)
    for joint in base.find_all(mujoco.mjtObj.mjOBJ_JOINT):
        if joint.type != mujoco.mjtJoint.mjJNT_FREE:
            scene.add_clutch(joint.name)


class MujocoVehicleBodies(VehicleBodies):
    """The bodies of a group of vehicles in a model of MuJoCo."""

    def __init__(self, model: Any, data: Any, group: EntityGroup, frictions: Array) -> None:
        """Find the bodies of a group.

        Args:
            model: The engine's model.
            data: The engine's data.
            group: The group.
            frictions: The friction of each geometry, which `set_friction` changes.
        """
        self.count, self.gravity = len(group), model.opt.gravity.tolist()
        self._model, self._data, self._group, self._frictions = model, data, group, frictions
        joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{id}/free") for id in group.ids]
        self._places = model.jnt_qposadr[joints][:, None] + np.arange(7)
        self._rates = model.jnt_dofadr[joints][:, None] + np.arange(6)
        self._bases = model.jnt_bodyid[joints]
        #: The centre of mass of each base in its own frame [m].
        self._middles = model.body_ipos[self._bases].copy()
        self._are_apart = bool(self._middles.any())
        self._joints: list[dict[str, int]] = [{} for _ in group.ids]
        roots = {int(model.body_rootid[base]): row for row, base in enumerate(self._bases.tolist())}
        for joint in range(model.njnt):
            row = roots.get(int(model.body_rootid[model.jnt_bodyid[joint]]))
            if row is not None and model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
                name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
                self._joints[row][name.removeprefix(f"{group.ids[row]}/")] = joint
        #: The row and name of each motor, and the indices of its joint, its rotor and its rotor's rate in the engine's
        #: state.
        self._motors: dict[tuple[int, str], int] = {}
        self._motors_at = np.empty((0, 3), np.intp)
        self._is_rate, self._targets = np.empty(0, bool), np.empty(0)
        self._geometries = [np.flatnonzero(model.body_rootid[model.geom_bodyid] == root) for root in roots]

    @property
    def present(self) -> Mask | None:
        """Whether each agent is in the world, by row; None if all are."""
        return self._group.present

    def captured(self) -> Array:
        """Return the targets of the motors; the world captures all else with the engine."""
        return self._targets.copy()

    def restored(self, state: Array) -> None:
        """Set the targets of the motors."""
        self._targets = state.copy()

    # -- once

    def set_inertia(self, inertia: Sequence[float]) -> None:
        """Set moments of inertia."""
        self._model.body_inertia[self._bases] = inertia
        self._model.body_iquat[self._bases] = [1.0, 0.0, 0.0, 0.0]
        mujoco.mj_setConst(self._model, mujoco.MjData(self._model))

    def set_friction(self, friction: Mapping[str, float]) -> None:
        """Set the friction of the links that joints move, and remove the damping of the joints."""
        model = self._model
        for joints, geometries in zip(self._joints, self._geometries, strict=True):
            links = {int(model.jnt_bodyid[joint]): name for name, joint in joints.items()}
            for geometry in geometries.tolist():
                self._frictions[geometry] = friction.get(links.get(int(model.geom_bodyid[geometry]), ""), 0.0)
            model.dof_damping[model.jnt_dofadr[list(joints.values())]] = 0.0

    def release(self, joints: Sequence[str]) -> None:
        """Do nothing: joints without a motor move freely."""

    def add_motors(self, joints: Sequence[str], kind: Literal["rate", "angle"], torque: float) -> None:
        """Set the torques of the clutches of joints."""
        model = self._model
        for row, own in enumerate(self._joints):
            for name in joints:
                full = f"{self._group.ids[row]}/{name}"
                clutch = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, f"{full}/clutch")
                rotor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{full}/rotor")
                model.tendon_frictionloss[clutch] = torque
                self._motors[row, name] = len(self._motors)
                places = [model.jnt_qposadr[own[name]], model.jnt_qposadr[rotor], model.jnt_dofadr[rotor]]
                self._motors_at = np.vstack([self._motors_at, places])
                self._is_rate = np.append(self._is_rate, kind == "rate")
        self._targets = np.zeros(len(self._motors))

    # -- in a run

    def command(self, row: int, joints: Sequence[str], targets: Sequence[float]) -> None:
        """Set the targets of motors."""
        for name, target in zip(joints, targets, strict=True):
            self._targets[self._motors[row, name]] = target

    def turn_rotors(self) -> None:
        """Set the rates to which the clutches of motors bring their joints in the next physics step."""
        if self._motors:
            joints, rotors, rates = self._motors_at.T
            towards = _SHARE * (self._targets - self._data.qpos[joints]) / self._model.opt.timestep
            self._data.qpos[rotors] = 0.0
            self._data.qvel[rates] = np.where(self._is_rate, self._targets, towards)

    def push(self, forces: Array, torques: Array) -> None:
        """Apply forces and torques for one physics step."""
        self._data.xfrc_applied[self._bases, :3] = forces
        self._data.xfrc_applied[self._bases, 3:] = torques

    def read(self) -> Array:
        """Read the centres of mass of the bases."""
        poses, motion = self._data.qpos[self._places], self._data.qvel[self._rates]
        values = np.empty((self.count, 13))
        values[:, :3], values[:, 3:6], values[:, 6] = poses[:, :3], poses[:, 4:], poses[:, 3]
        values[:, 7:10], values[:, 10:13] = motion[:, :3], _turned(values[:, 3:7], motion[:, 3:])
        if self._are_apart:
            arms = rotated(values[:, 3:7], self._middles)
            values[:, :3] += arms
            values[:, 7:10] += np.cross(values[:, 10:13], arms)
        return values

    def place(self, row: int, values: Sequence[float]) -> None:
        """Set the pose and velocity of a body."""
        orientation = np.array(values[3:7])
        arm = rotated(orientation, self._middles[row])
        place = self._places[row]
        self._data.qpos[place[:3]] = np.array(values[:3]) - arm
        self._data.qpos[place[3:]] = np.roll(orientation, 1)
        self.set_velocity(row, values[7:10], values[10:13])

    def set_velocity(self, row: int, velocity: Sequence[float], spin: Sequence[float]) -> None:
        """Set the velocity of a body."""
        orientation, spun = np.roll(self._data.qpos[self._places[row, 3:]], -1), np.array(spin, float)
        arm = rotated(orientation, self._middles[row])
        own = self._rates[row]
        self._data.qvel[own[:3]] = np.array(velocity, float) - np.cross(spun, arm)
        self._data.qvel[own[3:]] = rotated(orientation * [-1.0, -1.0, -1.0, 1.0], spun)

    def put(self, row: int, position: Sequence[float], orientation: Sequence[float]) -> None:
        """Put a body at rest to a pose, with all joints at 0.

        Args:
            row: The row of the agent.
            position: The origin of its base [m].
            orientation: A quaternion (x, y, z, w).
        """
        x, y, z, w = orientation
        self._data.qpos[self._places[row]] = [*position, w, x, y, z]
        self._data.qvel[self._rates[row]] = 0.0
        for joint in self._joints[row]:
            self.set_joint(row, joint, 0.0, 0.0)

    def poses(self) -> Array:
        """Return the poses of the bases, with quaternions (x, y, z, w); shape (n, 7)."""
        found = self._data.qpos[self._places]
        return np.column_stack([found[:, :3], np.roll(found[:, 3:], -1, axis=1)])

    def joint(self, row: int, joint: str) -> tuple[float, float]:
        """Return the position and the rate of a joint."""
        number = self._joints[row][joint]
        at, rate = self._model.jnt_qposadr[number], self._model.jnt_dofadr[number]
        return float(self._data.qpos[at]), float(self._data.qvel[rate])

    def set_joint(self, row: int, joint: str, position: float, rate: float) -> None:
        """Set the position and the rate of a joint."""
        number = self._joints[row][joint]
        self._data.qpos[self._model.jnt_qposadr[number]] = position
        self._data.qvel[self._model.jnt_dofadr[number]] = rate


def _turned(orientations: Array, vectors: Array) -> Array:
    """Rotate vectors (n, 3) by quaternions (n, 4); for a few bodies four times as fast as with NumPy's `cross`."""
    turns, given = orientations.T[_CYCLIC], vectors.T[_CYCLIC]
    doubled = turns[1:4] * given[2:] - turns[2:] * given[1:4]
    doubled *= 2.0
    turned: Array = orientations[:, 3] * doubled
    turned += given[:3]
    around = doubled[_CYCLIC]
    turned += turns[1:4] * around[2:]
    turned -= turns[2:] * around[1:4]
    return turned.T
