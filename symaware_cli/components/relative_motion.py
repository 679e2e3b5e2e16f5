"""Relative motion: how the others that agents are aware of stand and move as seen from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Environment

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def bounding_radii(environment: Environment) -> Array:
    """The radius of the smallest circle around each agent's body by index in the roster [m]; shape (N,).

    Bodies are known to all: what agents doubt is where the others are, not how big.
    """
    return np.concatenate([np.full(len(group), group.entity.radius) for group in environment.groups])


def own_velocity(group: AgentGroup) -> Array:
    """The velocity that each agent believes to have, under what it last requested [m/s]; shape (n, d)."""
    model = group.model
    return model.velocity(group.awareness.state, model.limit(group.control_input))


class RelativeMotion:
    """A row for each agent and each other within reach, in the order of `Tracks`.

    Vectors stand in columns, (d, m), because all arithmetic on them goes along the rows.

    Attributes:
        tracks: What is believed of the others.
        observers: The agent of each row, as a row of the group; shape (m,).
        apart: From the agent to the other [m]; shape (d, m).
        closing: The velocity of the other less one's own [m/s]; shape (d, m).
        velocity: The velocity of each agent of the group [m/s]; shape (n, d).
        radius: The sum of both radii [m]; shape (m,).
    """

    __slots__ = ("apart", "closing", "observers", "radius", "tracks", "velocity")

    def __init__(self, group: AgentGroup, reach: float, radii: Array, velocity: Array) -> None:
        """Look at everybody within reach.

        Args:
            group: The agents.
            reach: How far they look [m].
            radii: What `bounding_radii` returned.
            velocity: What `own_velocity` returned.
        """
        self.tracks = group.others(reach)
        self.observers = self.tracks.observers
        position = group.model.positions(group.awareness.state)
        self.apart = self._seen_from(position, self.tracks.positions)
        self.closing = self._seen_from(velocity, self.tracks.velocities)
        self.velocity = velocity
        self.radius = group.entity.radius + radii.take(self.tracks.others)

    def _seen_from(self, own: Array, others: Array) -> Array:
        """Subtract one's own vector from those of the others; who moves in the plane stands at height 0."""
        seen = np.array(others.T, order="C")
        for axis in range(min(own.shape[1], len(seen))):
            seen[axis] -= own[:, axis].take(self.observers)
        return seen


def dot(one: Array, other: Array) -> Array:
    """The inner products of vectors that stand in columns; (d, m) and (d, m) to (m,).

    Written out, so that no bit of a row depends on how many rows there are.
    """
    product: Array = one[0] * other[0]
    for axis in range(1, len(one)):
        product += one[axis] * other[axis]
    return product
