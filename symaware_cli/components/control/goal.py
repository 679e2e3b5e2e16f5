"""Controllers of single goals."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.control.steering import Approach, along, directions, lengths, scaled
from symaware_cli.core import AgentGroup

Array = NDArray[np.float64]


class GoalSeeking(Approach):
    """A controller that brings each agent to the position it knows as ``goal``."""

    knowledge: ClassVar = {"goal": "where to go, as a position [m]"}
    events: ClassVar = {"goal-reached": "An agent came within the tolerance of its goal, for the first time."}

    class Parameters(Approach.Parameters):
        """How to approach the goal."""

    def check(self, group: AgentGroup) -> None:
        """The goal is a position, and the model can be steered by a velocity."""
        dimensions = len(group.model.position)
        if group.known("goal").shape != (len(group), dimensions):
            raise ValueError(f"the knowledge `goal` of each agent must be a position of {dimensions} numbers")
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Read each agent's goal from its knowledge."""
        super().initialise_component(group)
        self._goal = group.known("goal")
        self._reached = np.zeros(len(group), bool)

    def _arrive(self, distance: Array) -> None:
        """Tell who came to its goal, from the distances that remain [m]; shape (n,)."""
        arrived = (distance <= self.parameters.tolerance) & ~self._reached
        if arrived.any():
            self._reached |= arrived
            for row in np.flatnonzero(arrived).tolist():
                self.emit_for(row, "goal-reached", "reached its goal", distance=float(distance[row]))


class GoToGoal(GoalSeeking):
    """Heads straight for the position known as ``goal`` and stops there.

    The wanted speed is the cruise speed, and falls in proportion to the distance near the goal. The intent is the
    straight way ahead over the horizon.
    """

    def _compute(self) -> tuple[Array, Array, Array]:
        model, state = self._group.model, self._group.awareness.state
        position = model.positions(state)
        way = self._goal - position
        distance = lengths(way)
        speed = self._slowing(distance)
        direction = directions(way, distance)
        travelled = np.minimum(speed[:, None] * self._ahead, distance[:, None])
        intent = along(position, direction, travelled)
        return model.follow_velocity(state, scaled(direction, speed)), intent, distance

    def _update(self, value: tuple[Array, Array, Array]) -> None:
        control_input, intent, distance = value
        self._steer(control_input, intent)
        self._arrive(distance)
