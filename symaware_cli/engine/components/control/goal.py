"""Controllers that bring agents to a goal."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup
from symaware_cli.engine.components.control.steering import (
    Approach,
    along,
    approach,
    differing,
)
from symaware_cli.geometry import Array


class GoalSeeking(Approach):
    """A controller that brings each agent to the position in its knowledge ``goal``, read at each turn."""

    knowledge: ClassVar = {"goal": "where to go, as a position [m]"}
    events: ClassVar = {
        "goal-reached": "An agent came within the tolerance of its goal, for the first time.",
        "goal-changed": "An agent that had reached its goal has another one, which counts as not reached.",
    }

    class Parameters(Approach.Parameters):
        """How to approach the goal."""

    def check(self, group: AgentGroup) -> None:
        """Check that the goal is a position, and that the model can follow a velocity."""
        self._goals(group)
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Start with no goal reached."""
        super().initialise_component(group)
        self._goal = self._goals(group)
        self._reached = np.zeros(len(group), bool)

    def _goals(self, group: AgentGroup) -> Array:
        """Return the present goal of each agent; shape (n, d)."""
        goal, dimensions = group.known("goal"), len(group.model.position)
        if goal.shape != (len(group), dimensions):
            raise ValueError(f"the knowledge `goal` of each agent must be a position of {dimensions} numbers")
        return goal

    def _emit_arrivals(self, goal: Array, distance: Array) -> None:
        """Emit events for goals that are reached or changed, from goals (n, d) and remaining distances (n,) [m]."""
        if goal is not self._goal:
            changed = differing(self._goal, goal)
            self._goal = goal
            for row in np.flatnonzero(changed & self._reached).tolist():
                self.emit_for(row, "goal-changed", "has another goal than the one it reached")
            self._reached = self._reached & ~changed
        near = distance <= self.parameters.tolerance
        # `count_nonzero` is several times as fast as `any` for few agents.
        if np.count_nonzero(near) and np.count_nonzero(arrived := near & ~self._reached):
            self._reached = self._reached | arrived
            for row in np.flatnonzero(arrived).tolist():
                self.emit_for(row, "goal-reached", "reached its goal", distance=float(distance[row]))


class GoToGoal(GoalSeeking):
    """Moves straight to the position ``goal`` and stops there.

    The desired speed is the cruise speed, and decreases in proportion to the distance near the goal. The intent is the
    straight path ahead over the horizon.
    """

    batchable = True

    def _compute(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        model, state, goal = self._group.model, self._group.awareness.state, self._goals(self._group)
        position = model.positions(state)
        given = self.parameters
        distance, speed, direction, velocity = approach(goal, position, given.speed, given.gain)
        return model.follow_velocity(state, velocity), position, direction, speed, goal, distance

    def _update(self, value: tuple[Array, Array, Array, Array, Array, Array]) -> None:
        control_input, position, direction, speed, goal, distance = value
        self._group.control_input = control_input
        intent = partial(self._intent, self.computed_at, position, direction, speed, distance)
        self._group.awareness.intent.defer(intent)
        self._emit_arrivals(goal, distance)

    def _intent(
        self, now: int, position: Array, direction: Array, speed: Array, distance: Array
    ) -> tuple[NDArray[np.int64], Array]:
        """Return the instants ahead [ns], and the positions of each agent on its straight path then."""
        travelled = np.minimum(speed[:, None] * self._ahead, distance[:, None])
        return now + self._offsets, along(position, direction, travelled)
