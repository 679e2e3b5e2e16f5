"""Steering: what controllers that choose a velocity have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import AgentGroup, GroupComponent, Parameters, Quantity
from symaware_cli.world.time import SECOND

Array = NDArray[np.float64]


class Steering(GroupComponent):
    """A controller that chooses a velocity for each agent, which its model follows, and where that leads."""

    class Parameters(Parameters):
        """How far ahead the intent goes."""

        horizon: float = Field(2.0, gt=0, description="How far ahead the intent reaches [s].")
        samples: int = Field(5, ge=2, le=1000, description="How many positions the intent has.")

    def check(self, group: AgentGroup) -> None:
        """The model can be steered by a velocity."""
        group.model.follow_velocity(group.initial_state, np.zeros((len(group), len(group.model.position))))

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """The intent consists of positions."""
        return {"intent": [group.model.state[index] for index in group.model.position]}

    def initialise_component(self, group: AgentGroup) -> None:
        """Lay out the instants of the intent."""
        super().initialise_component(group)
        #: When the positions of the intent are, from now [s]; shape (h,).
        self._ahead = np.linspace(0.0, self.parameters.horizon, self.parameters.samples)
        self._offsets = np.round(self._ahead * SECOND).astype(np.int64)

    def _steer(self, control_input: Array, intent: Array) -> None:
        """Request control inputs (n, nu) and state the positions that they lead to (n, h, d)."""
        self._group.control_input = control_input
        self._group.awareness.intent.set(self.computed_at + self._offsets, intent)


class Approach(Steering):
    """A controller that brings agents to a place and stops them there.

    The wanted speed is the cruise speed, and falls in proportion to the distance near the place.
    """

    class Parameters(Steering.Parameters):
        """How to approach a place."""

        speed: float = Field(1.0, gt=0, description="Cruise speed [m/s].")
        gain: float = Field(1.0, gt=0, description="Speed for each metre that remains, where that is less [1/s].")
        tolerance: float = Field(0.1, gt=0, description="Distance at which a place counts as reached [m].")

    def _slowing(self, distance: Array) -> Array:
        """The speed at a distance from where to stop [m/s]; shape (n,)."""
        speed: Array = np.minimum(self.parameters.speed, self.parameters.gain * distance)
        return speed


def differing(before: Array, now: Array) -> NDArray[np.bool_]:
    """Which agents know something else than before, from what `AgentGroup.known` or `known_lists` returned; (n,)."""
    if now is before:
        return np.zeros(len(now), bool)
    if now.ndim > 2 and now.shape[2:] == before.shape[2:]:
        longest = max(now.shape[1], before.shape[1])
        before, now = (each[:, np.minimum(np.arange(longest), each.shape[1] - 1)] for each in (before, now))
    if now.shape != before.shape:
        return np.ones(len(now), bool)
    changed: NDArray[np.bool_] = (now != before).reshape(len(now), -1).any(axis=1)
    return changed


def along(position: Array, direction: Array, travelled: Array) -> Array:
    """The places that lie some ways from a position in a direction; (n, d), (n, d) and (n, h) to (n, h, d)."""
    places = np.empty((*travelled.shape, position.shape[1]))
    # Axis by axis: broadcasting along an axis of two elements is many times as slow.
    for axis in range(position.shape[1]):
        np.add(position[:, axis, None], direction[:, axis, None] * travelled, out=places[:, :, axis])
    places.flags.writeable = False
    return places


def lengths(vectors: Array) -> Array:
    """The length of each of some vectors; (n, d) to (n,)."""
    square = vectors[:, 0] * vectors[:, 0]
    for axis in range(1, vectors.shape[1]):
        square += vectors[:, axis] * vectors[:, axis]
    return np.sqrt(square)


def directions(vectors: Array, length: Array) -> Array:
    """Unit vectors, from vectors (n, d) and their lengths (n,); zero where the length is."""
    return scaled(vectors, 1.0 / np.maximum(length, 1e-12))


def scaled(vectors: Array, factor: Array) -> Array:
    """Each of some vectors (n, d) times its factor (n,)."""
    product = np.empty_like(vectors)
    for axis in range(vectors.shape[1]):
        np.multiply(vectors[:, axis], factor, out=product[:, axis])
    return product
