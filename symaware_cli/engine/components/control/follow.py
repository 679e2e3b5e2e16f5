"""A controller that follows another agent at an offset."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.engine.components.control.steering import Steering
from symaware_cli.geometry import Array, Mask, lengths

#: The number of standard deviations by which an estimated velocity must differ from zero to have a direction.
_SIGNIFICANT = 3.0


class Follow(Steering):
    """Keeps the position ``offset`` relative to another agent, from the agent's own belief about it.

    The desired velocity is the believed velocity of the leader, plus the gain times the vector to the offset position.
    The component does not communicate: an agent stops while it has no belief about the leader. If the leader stands, or
    may stand according to its covariance, offsets keep their last direction. The intent is the approach to the offset
    position if the leader kept its velocity.
    """

    bodies: ClassVar = {"leader": "agent"}
    knowledge: ClassVar = {"offset": "where to be relative to the leader, as a vector [m]"}
    events: ClassVar = {
        "leader-lost": "An agent has no belief about its leader any more, or none from the start.",
        "leader-found": "An agent is aware of its leader again.",
    }

    class Parameters(Steering.Parameters):
        """Which agent to follow, and how."""

        leader: str = Field(description="The id of the agent to follow, such as robot.0.")
        frame: Literal["motion", "world"] = Field(
            "motion",
            description="What the offset refers to: the leader's direction of motion (ahead, to the left), or the axes"
            " of the world.",
        )
        standing: float = Field(
            0.1,
            gt=0,
            description="Speed below which the leader's direction of motion is taken to be the last one [m/s].",
        )
        gain: float = Field(1.0, gt=0, description="Speed for each metre away from one's place [1/s].")
        speed: float = Field(1.5, gt=0, description="Greatest speed [m/s].")

    def check(self, group: AgentGroup) -> None:
        """Check that the leader is another agent, the offset a vector, and the model can follow a velocity."""
        if self.parameters.leader in group.ids:
            raise ValueError(f"{self.parameters.leader} cannot follow itself: put the leader into a group of its own")
        self._offsets_of(group)
        super().check(group)

    def _offsets_of(self, group: AgentGroup) -> Array:
        """Return the present offset of each agent; shape (n, d)."""
        offset, dimensions = group.known("offset"), len(group.model.position)
        if offset.shape != (len(group), dimensions):
            raise ValueError(f"the knowledge `offset` of each agent must be a vector of {dimensions} numbers")
        return offset

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the leader."""
        super().initialise_component(group)
        if self.parameters.leader not in self.environment.roster:
            raise ValueError(f"`leader` names `{self.parameters.leader}`, which is no agent")
        self._leader = self.environment.roster.index(self.parameters.leader)
        self._direction = np.zeros((len(group), 2))
        self._direction[:, 0] = 1.0
        self._aware = np.ones(len(group), bool)

    def _compute(self) -> tuple[Array, Array, Array, Mask]:
        model, state = self._group.model, self._group.awareness.state
        position = model.positions(state)
        aware, led, speed, least = self._belief(position)
        direction = self._direction_of(speed, aware, least)
        way = np.where(aware[:, None], led + self._turned(self._offsets_of(self._group), direction) - position, 0.0)
        velocity = speed + self.parameters.gain * way
        fast = lengths(velocity)
        velocity *= np.minimum(1.0, self.parameters.speed / np.maximum(fast, 1e-12))[:, None]
        left = np.exp(-self.parameters.gain * self._ahead)[None, :, None]
        ahead = self._ahead[None, :, None]
        intent = position[:, None] + speed[:, None] * ahead + way[:, None] * (1.0 - left)
        return model.follow_velocity(state, velocity), intent, direction, aware

    def _update(self, value: tuple[Array, Array, Array, Mask]) -> None:
        control_input, intent, self._direction, aware = value
        self._steer(control_input, intent)
        for row in np.flatnonzero(aware != self._aware).tolist():
            name, text = ("leader-found", "is aware of") if aware[row] else ("leader-lost", "is not aware of")
            self.emit_for(row, name, f"{text} {self.parameters.leader}")
        self._aware = aware

    def _belief(self, position: Array) -> tuple[Mask, Array, Array, Array]:
        """Return the agents' beliefs about the leader.

        Returns:
            Which agents are aware of it, shape (n,), its position and velocity, (n, d) each, and the speed from which
            on its velocity has a direction, (n,).
        """
        awareness, dimensions = self._group.awareness, position.shape[1]
        aware, led, speed = np.zeros(len(position), bool), position.copy(), np.zeros_like(position)
        least = np.full(len(position), self.parameters.standing)
        tracks, world = awareness.tracks, awareness.world
        if tracks is not None:
            rows = np.flatnonzero(tracks.others == self._leader)
            observers = tracks.observers[rows]
            aware[observers] = True
            led[observers] = tracks.positions[rows, :dimensions]
            speed[observers] = tracks.velocities[rows, :dimensions]
            if tracks.covariances is not None:
                first = tracks.covariances.shape[1] // 2
                variance = tracks.covariances[rows, first, first] + tracks.covariances[rows, first + 1, first + 1]
                least[observers] = np.maximum(least[observers], _SIGNIFICANT * np.sqrt(variance))
        elif world is not None:
            if world.present is not None and not world.present[self._leader]:
                return aware, led, speed, least
            aware[:] = True
            led[:] = world.positions[self._leader, :dimensions]
            speed[:] = world.velocities[self._leader, :dimensions]
        return aware, led, speed, least

    def _direction_of(self, speed: Array, aware: Mask, least: Array) -> Array:
        """Return the leader's direction of motion in the plane as unit vectors, the last one if it stands; (n, 2)."""
        plane = speed[:, :2]
        fast = lengths(plane)
        moving = aware & (fast > least)
        return np.where(moving[:, None], plane / np.where(moving, fast, 1.0)[:, None], self._direction)

    def _turned(self, offset: Array, direction: Array) -> Array:
        """Return the offsets in the axes of the world; shape (n, d)."""
        if self.parameters.frame == "world":
            return offset
        turned = offset.copy()
        turned[:, 0] = direction[:, 0] * offset[:, 0] - direction[:, 1] * offset[:, 1]
        turned[:, 1] = direction[:, 1] * offset[:, 0] + direction[:, 0] * offset[:, 1]
        return turned
