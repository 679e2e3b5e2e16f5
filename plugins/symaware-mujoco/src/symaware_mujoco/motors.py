"""Motors: drive the joints of agents that are robots from files, within their efforts.

Reasons: docs/decisions/0080-robots-as-agents.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from symaware_cli.assets import Mechanism, Postures
from symaware_cli.core import EntityGroup
from symaware_cli.geometry import Array

#: The effort in the solver of motors without a limit [N m] or [N].
_MOST_EFFORT = 1e6

#: The part of the motion that the constraint of a motor determines.
_IMPEDANCE = 0.9999


class Motors:
    """The robots of a group, and the motors of their joints.

    A motor with a velocity is a constraint like dry friction: the solver finds the torque, within the effort, that
    gives the joint this velocity at the end of the physics step, together with all contacts. The engine's own joint
    friction brings a joint to rest; here its reference is shifted by the commanded velocity.

    Attributes:
        number: The number of the group in the environment.
        heights: The height of each fixed base [m].
    """

    def __init__(self, model: Any, group: EntityGroup, number: int, mechanism: Mechanism, step: float) -> None:
        """Find the joints.

        Args:
            model: The engine's model; motors become a part of it.
            group: The group.
            number: The number of the group in the environment.
            mechanism: The joints and motors of the robots.
            step: The physics step [s].
        """
        self.group, self.number, self._mechanism = group, number, mechanism

        def joint(id: str, name: str) -> int:
            found: int = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{id}/{name}")
            return found

        shape = len(group), len(mechanism.joints)
        joints = np.array([[joint(id, name) for name in mechanism.joints] for id in group.ids], np.intp).reshape(shape)
        #: The indices of joints in the engine's positions and velocities, and those of free bases.
        self._joints_at, self._rates_at = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        if not mechanism.is_fixed:
            bases = np.array([joint(id, "base") for id in group.ids], np.intp)
            self._base_at = model.jnt_qposadr[bases][:, None] + np.arange(7)
            self._motion_at = model.jnt_dofadr[bases][:, None] + np.arange(6)
        order = [list(mechanism.joints).index(motor.joint) for motor in mechanism.motors]
        self._places, self._motors_at = self._joints_at[:, order], self._rates_at[:, order]
        kinds = np.array([motor.drive for motor in mechanism.motors])
        self._of_velocity, self._of_position, self._of_torque = (
            np.flatnonzero(kinds == kind) for kind in ("velocity", "position", "torque")
        )
        self._gains = np.array([motor.gain for motor in mechanism.motors])
        self._velocities = np.array([motor.velocity for motor in mechanism.motors])
        efforts = np.array([min(motor.effort, _MOST_EFFORT) for motor in mechanism.motors])
        self._efforts = efforts
        servos = np.flatnonzero(kinds != "torque")
        places = self._motors_at[:, servos]
        model.dof_frictionloss[places] = efforts[servos]
        model.dof_solref[places.ravel()] = (2.0 * step, 1.0)
        model.dof_solimp[places.ravel()] = (_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0)
        self._is_servo = bool(len(servos))
        self._given = np.zeros((len(group), len(mechanism.motors)))

    def place(self, data: Any, states: Array) -> None:
        """Put the robots in the postures of their states; standing robots keep their heights."""
        for row, state in enumerate(states):
            posture = self._mechanism.posture(state)
            data.qpos[self._joints_at[row]], data.qvel[self._rates_at[row]] = posture.joints, posture.joint_velocities
            if self._mechanism.is_fixed:
                continue
            x, y, z, w = posture.orientation
            where, motion = self._base_at[row], self._motion_at[row]
            data.qpos[where[:2]], data.qpos[where[3:]] = posture.position[:2], (w, x, y, z)
            if not self._mechanism.stands:
                data.qpos[where[2]] = posture.position[2]
            data.qvel[motion[:3]] = posture.velocity
            mujoco.mju_rotVecQuat(turned := np.empty(3), np.array(posture.rate, float), np.array([w, -x, -y, -z]))
            data.qvel[motion[3:]] = turned

    def command(self, control_input: Array) -> None:
        """Command the motors by the saturated control inputs of a time step; shape (n, nu)."""
        self._given = self._mechanism.commands(control_input)

    def apply(self, data: Any) -> None:
        """Drive the joints in a physics step, after its constraints are set up and before they are solved."""
        given = self._given
        if len(self._of_torque):
            most, columns = self._efforts[self._of_torque], self._of_torque
            data.qfrc_applied[self._motors_at[:, columns]] = np.clip(given[:, columns], -most, most)
        if not self._is_servo:
            return
        wanted = np.zeros(len(data.qvel))
        wanted[self._motors_at[:, self._of_velocity]] = given[:, self._of_velocity]
        if len(self._of_position):
            columns = self._of_position
            left = given[:, columns] - data.qpos[self._places[:, columns]]
            most = self._velocities[columns]
            wanted[self._motors_at[:, columns]] = np.clip(self._gains[columns] * left, -most, most)
        rows = np.flatnonzero(data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF))
        damping = data.efc_KBIP.reshape(-1, 4)[rows, 1]
        data.efc_aref[rows] += damping * wanted[data.efc_id[rows]]

    def states(self, data: Any, before: Array) -> tuple[Array, Array]:
        """Return the states, shape (n, nx), and the velocities of the bases [m/s], shape (n, 3).

        Args:
            data: The engine's state.
            before: The states before the step.
        """
        count = len(self.group)
        joints, rates = data.qpos[self._joints_at], data.qvel[self._rates_at]
        if self._mechanism.is_fixed:
            still = np.zeros((count, 3))
            upright = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
            return self._mechanism.states(Postures(still, upright, still, still, joints, rates), before), still
        poses, motion = data.qpos[self._base_at], data.qvel[self._motion_at]
        turning = np.empty((count, 3))
        for row in range(count):
            mujoco.mju_rotVecQuat(turning[row], motion[row, 3:], poses[row, 3:])
        postures = Postures(poses[:, :3], np.roll(poses[:, 3:], -1, axis=1), motion[:, :3], turning, joints, rates)
        return self._mechanism.states(postures, before), motion[:, :3]

    def poses(self, data: Any) -> Array | None:
        """Return the poses of the bases, position [m] and quaternion (x, y, z, w); None if they are fixed."""
        if self._mechanism.is_fixed:
            return None
        poses = data.qpos[self._base_at]
        return np.concatenate([poses[:, :3], np.roll(poses[:, 3:], -1, axis=1)], axis=1)

    def joint_positions(self, model: Any, data: Any, names: Sequence[str]) -> Array:
        """Return the positions of joints by name, of all robots [rad] or [m]; shape (n, joints)."""
        found = [
            [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{id}/{name}") for name in names]
            for id in self.group.ids
        ]
        positions: Array = data.qpos[model.jnt_qposadr[np.array(found, np.intp)]]
        return positions
