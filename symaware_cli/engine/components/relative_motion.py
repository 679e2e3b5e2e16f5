"""Relative motion: positions and velocities of others relative to the agents that are aware of them."""

from __future__ import annotations

import numpy as np

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.geometry import Array


def bounding_radii(environment: Environment) -> Array:
    """Return the radius of the smallest circle around each agent's body by index in the roster [m]; shape (N,).

    The sizes of bodies are known to all agents; only positions are uncertain.
    """
    return np.concatenate([np.full(len(group), group.entity.radius) for group in environment.groups])


def own_velocity(group: AgentGroup) -> Array:
    """Return each agent's belief of its own velocity, under its last requested input [m/s]; shape (n, d)."""
    model = group.model
    return model.velocity(group.awareness.state, model.limit(group.control_input))


class RelativeMotion:
    """Relative positions and velocities, for each agent and each other within reach, in the order of `Tracks`.

    Vectors are stored in columns, (d, m), because all arithmetic on them runs along the rows.

    Attributes:
        tracks: The beliefs of the others.
        observers: The agent of each row, as a row of the group; shape (m,).
        apart: The vector from the agent to the other [m]; shape (d, m).
        closing: The velocity of the other minus the own one [m/s]; shape (d, m).
        velocity: The velocity of each agent of the group [m/s]; shape (n, d).
        radius: The sum of both radii [m]; shape (m,).
    """

    __slots__ = ("apart", "closing", "observers", "radius", "tracks", "velocity")

    def __init__(self, group: AgentGroup, reach: float, radii: Array, velocity: Array) -> None:
        """Compute the motion relative to all others within reach.

        Args:
            group: The agents.
            reach: The greatest distance of the others [m].
            radii: The radii, as returned by `bounding_radii`.
            velocity: The own velocities, as returned by `own_velocity`.
        """
        self.tracks = group.others(reach)
        self.observers = self.tracks.observers
        position = group.model.positions(group.awareness.state)
        self.apart = self._relative(position, self.tracks.positions)
        self.closing = self._relative(velocity, self.tracks.velocities)
        self.velocity = velocity
        self.radius = group.entity.radius + radii.take(self.tracks.others)

    def _relative(self, own: Array, others: Array) -> Array:
        """Subtract the own vectors from those of the others; planar agents are at height 0."""
        seen = np.array(others.T, order="C")
        for axis in range(min(own.shape[1], len(seen))):
            seen[axis] -= own[:, axis].take(self.observers)
        return seen


def dot(one: Array, other: Array) -> Array:
    """Return the inner products of vectors in columns; (d, m) and (d, m) to (m,).

    The sum is written out so that no bit of a row depends on the number of rows.
    """
    product: Array = one[0] * other[0]
    for axis in range(1, len(one)):
        product += one[axis] * other[axis]
    return product
