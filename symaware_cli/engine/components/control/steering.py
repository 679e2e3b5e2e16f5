"""Base classes of controllers that choose a velocity for the model to follow, or change what others requested."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, GroupComponent, Model, Parameters, Quantity
from symaware_cli.geometry import Array, Mask, compiled, lengths
from symaware_cli.world import SECOND

#: Without axes, as an operation on few elements takes half as long again if it has to convert a `float`.
_SHORTEST, _ONE = np.array(1e-12), np.array(1.0)
#: Up to this number of vectors one operation on all elements is faster than one for each axis.
_FEW = 200


class Steering(GroupComponent):
    """A controller that chooses a velocity for each agent, which its model follows, and states an intent."""

    class Parameters(Parameters):
        """Extent of the intent."""

        horizon: float = Field(2.0, gt=0, description="How far ahead the intent reaches [s].")
        samples: int = Field(5, ge=2, le=1000, description="How many positions the intent has.")

    def check(self, group: AgentGroup) -> None:
        """Check that the model can follow a velocity."""
        group.model.follow_velocity(group.initial_state, np.zeros((len(group), len(group.model.position))))

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the intent as positions."""
        return {"intent": [group.model.state[index] for index in group.model.position]}

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the instants of the intent."""
        super().initialise_component(group)
        #: The times of the intent's positions, from now [s]; shape (h,).
        self._ahead = np.linspace(0.0, self.parameters.horizon, self.parameters.samples)
        self._offsets = np.round(self._ahead * SECOND).astype(np.int64)

    def _steer(self, control_input: Array, intent: Array) -> None:
        """Request control inputs (n, nu), and set the intent to the positions that follow (n, h, d)."""
        self._group.control_input = control_input
        self._group.awareness.intent.set(self.computed_at + self._offsets, intent)


class Approach(Steering):
    """A controller that brings agents to a position and stops them there.

    The desired speed is the cruise speed, and decreases in proportion to the distance near the position.
    """

    class Parameters(Steering.Parameters):
        """Speed, gain and tolerance of the approach."""

        speed: float = Field(1.0, gt=0, description="Cruise speed [m/s].")
        gain: float = Field(1.0, gt=0, description="Speed for each metre that remains, where that is less [1/s].")
        tolerance: float = Field(0.1, gt=0, description="Distance at which a place counts as reached [m].")

    def _slowing(self, distance: Array) -> Array:
        """Return the speed at a distance from the position to stop at [m/s]; shape (n,)."""
        speed: Array = np.minimum(self.parameters.speed, self.parameters.gain * distance)
        return speed


@compiled
def approach(goal: Array, position: Array, speed: float, gain: float) -> tuple[Array, Array, Array, Array]:
    """Choose the velocity straight to a goal, slower near it.

    Args:
        goal: Where to go [m]; shape (n, d).
        position: Where the agents are [m]; shape (n, d).
        speed: The cruise speed [m/s].
        gain: The speed for each metre that remains, where that is less [1/s].

    Returns:
        The remaining distance [m] and the speed [m/s], each of shape (n,); the direction, zero where nothing remains,
        and the velocity [m/s], each of shape (n, d).
    """
    way = differences(goal, position)
    distance = lengths(way)
    slow = np.minimum(speed, gain * distance)
    direction = directions(way, distance)
    return distance, slow, direction, scaled(direction, slow)


def differing(before: Array, now: Array) -> Mask:
    """Return which rows differ between two results of `AgentGroup.known` or `known_lists`; shape (n,)."""
    if now is before:
        return np.zeros(len(now), bool)
    if now.ndim > 2 and now.shape[2:] == before.shape[2:]:
        longest = max(now.shape[1], before.shape[1])
        before, now = (each[:, np.minimum(np.arange(longest), each.shape[1] - 1)] for each in (before, now))
    if now.shape != before.shape:
        return np.ones(len(now), bool)
    changed: Mask = (now != before).reshape(len(now), -1).any(axis=1)
    return changed


def along(position: Array, direction: Array, travelled: Array) -> Array:
    """Return positions at distances from a position in a direction; (n, d), (n, d) and (n, h) to (n, h, d)."""
    if travelled.size <= _FEW:
        places = position[:, None] + direction[:, None] * travelled[:, :, None]
    else:
        places = np.empty((*travelled.shape, position.shape[1]))
        for axis in range(position.shape[1]):
            np.add(position[:, axis, None], direction[:, axis, None] * travelled, out=places[:, :, axis])
    places.setflags(write=False)
    return places


def differences(vectors: Array, others: Array) -> Array:
    """Return vectors (n, d) minus others (n, d)."""
    if len(vectors) <= _FEW:
        return vectors - others
    apart = np.empty_like(vectors)
    for axis in range(vectors.shape[1]):
        np.subtract(vectors[:, axis], others[:, axis], out=apart[:, axis])
    return apart


def directions(vectors: Array, length: Array) -> Array:
    """Return unit vectors, from vectors (n, d) and their lengths (n,); zero for length zero."""
    return scaled(vectors, _ONE / np.maximum(length, _SHORTEST))


def scaled(vectors: Array, factor: Array) -> Array:
    """Return vectors (n, d) times factors (n,)."""
    if len(vectors) <= _FEW:
        return vectors * factor[:, None]
    product = np.empty_like(vectors)
    for axis in range(vectors.shape[1]):
        np.multiply(vectors[:, axis], factor, out=product[:, axis])
    return product


def slowest(model: Model, state: Array, control_input: Array) -> Array:
    """Return the control input that slows down as far as the model can, or the smallest allowed; shape (nu,)."""
    try:
        slow = model.slowed(state[None], control_input, np.zeros(1))
    except NotImplementedError:
        slow = np.zeros_like(control_input)
    limited: Array = model.limit(slow)[0]
    return limited


class RequestFilter(GroupComponent):
    """A component that replaces the control inputs that the preceding controller requested.

    If the controller takes fewer turns, each turn of the filter starts from its original request, not from the
    filtered one.
    """

    def initialise_component(self, group: AgentGroup) -> None:
        """Start without a request."""
        super().initialise_component(group)
        self._requested: Array | None = None
        self._written: int | None = None

    def _request(self) -> Array:
        """Return the control inputs that the controller requested last; shape (n, nu)."""
        if self._group.control_column.writes == self._written and self._requested is not None:
            return self._requested
        return self._group.control_input

    def _replace(self, requested: Array, control_input: Array) -> None:
        """Set the control inputs (n, nu) in place of the requested ones (n, nu)."""
        self._requested = requested
        self._group.control_input = control_input
        self._written = self._group.control_column.writes
