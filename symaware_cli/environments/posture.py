"""Postures: where bodies of PyBullet are in space, how they are turned, and how their joints stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.articulation import Articulation
from symaware_cli.environments.bullet import engine

Array = NDArray[np.float64]
Transform = tuple[Sequence[float], Sequence[float]]

#: What `getDynamicsInfo` calls a body of links.
_MULTIBODY = 2


class Postures:
    """Reads the postures of bodies when asked, a call or two for each; they cost nothing otherwise."""

    def __init__(self, client: int) -> None:
        """Take note of the world.

        Args:
            client: The engine's client.
        """
        self._client = client
        self._bases: dict[int, Transform | None] = {}
        #: The engine's numbers of the joints of a body.
        self._joints: dict[int, Sequence[int]] = {}

    def base(self, body: int) -> Transform | None:
        """The way from the centre of mass, which the engine tells, to the base; None where that is the same."""
        if body not in self._bases:
            dynamics = engine.getDynamicsInfo(body, -1, self._client)
            position, orientation = dynamics[3:5]
            # Of a body that is no multibody the engine says what happens to stand in its memory.
            apart = dynamics[10] == _MULTIBODY and (any(position) or any(orientation[:3]))
            self._bases[body] = engine.invertTransform(position, orientation) if apart else None
        return self._bases[body]

    def pose(self, body: int) -> Transform:
        """The position [m] and the quaternion (x, y, z, w) of a base."""
        pose: Transform = engine.getBasePositionAndOrientation(body, self._client)
        base = self.base(body)
        return engine.multiplyTransforms(*pose, *base) if base else pose

    def poses(self, bodies: Sequence[int]) -> Array:
        """The positions [m] and quaternions (x, y, z, w) of the bases; shape (n, 7)."""
        flat: list[float] = []
        for body in bodies:
            position, orientation = self.pose(body)
            flat += position
            flat += orientation
        return np.array(flat).reshape(len(bodies), 7)

    def joints(self, bodies: Sequence[int], articulation: Articulation) -> Array:
        """The positions of the joints that move, in the order of an articulation [rad] or [m]; shape (n, joints)."""
        flat: list[float] = []
        for body in bodies:
            numbers = self._numbers(body, articulation.joints)
            flat += [state[0] for state in engine.getJointStates(body, numbers, self._client)]
        return np.array(flat).reshape(len(bodies), len(articulation.joints))

    def put(self, bodies: Sequence[int], articulation: Articulation, positions: Array) -> None:
        """Let the joints stand as those of another world do, as `joints` told it."""
        for body, row in zip(bodies, positions.tolist(), strict=True):
            for number, position in zip(self._numbers(body, articulation.joints), row, strict=True):
                engine.resetJointState(body, number, position, physicsClientId=self._client)

    def _numbers(self, body: int, joints: Mapping[str, str]) -> Sequence[int]:
        if body not in self._joints:
            self._joints[body] = self._look_up(body, joints)
        return self._joints[body]

    def _look_up(self, body: int, joints: Mapping[str, str]) -> Sequence[int]:
        names = {
            engine.getJointInfo(body, number, self._client)[1].decode(): number
            for number in range(engine.getNumJoints(body, self._client))
        }
        return [names[joint] for joint in joints]
