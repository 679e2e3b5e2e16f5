"""Controllers of single goals."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import AgentGroup, GroupComponent, Parameters
from symaware_cli.core.time import SECOND

Array = NDArray[np.float64]


class GoToGoal(GroupComponent):
    """Heads straight for the position known as ``goal`` and stops there.

    The wanted speed is the cruise speed, and falls in proportion to the distance near the goal. The intent is the
    straight way ahead over the horizon.
    """

    knowledge: ClassVar = {"goal": "where to go, as a position [m]"}
    events: ClassVar = {"goal-reached": "An agent came within the tolerance of its goal, for the first time."}

    class Parameters(Parameters):
        """How to approach the goal."""

        speed: float = Field(1.0, gt=0, description="Cruise speed [m/s].")
        gain: float = Field(1.0, gt=0, description="Speed for each metre that remains, where that is less [1/s].")
        tolerance: float = Field(0.1, gt=0, description="Distance at which the goal counts as reached [m].")
        horizon: float = Field(2.0, gt=0, description="How far ahead the intent reaches [s].")
        samples: int = Field(5, ge=2, le=1000, description="How many positions the intent has.")

    def check(self, group: AgentGroup) -> None:
        """The goal is a position, and the model can be steered by a velocity."""
        dimensions = len(group.model.position)
        if group.known("goal").shape != (len(group), dimensions):
            raise ValueError(f"the knowledge `goal` of each agent must be a position of {dimensions} numbers")
        group.model.follow_velocity(group.initial_state, np.zeros((len(group), dimensions)))

    def initialise_component(self, group: AgentGroup) -> None:
        """Read each agent's goal from its knowledge."""
        super().initialise_component(group)
        self._goal = group.known("goal")
        self._reached = np.zeros(len(group), bool)
        offsets = np.linspace(0.0, self.parameters.horizon, self.parameters.samples)
        self._offsets = np.round(offsets * SECOND).astype(np.int64)
        self._ahead = offsets[None, :, None]

    def _compute(self) -> tuple[Array, Array, Array]:
        model, state = self._group.model, self._group.awareness.state
        position = model.positions(state)
        way = self._goal - position
        distance = np.sqrt(np.einsum("ij,ij->i", way, way))
        speed = np.minimum(self.parameters.speed, self.parameters.gain * distance)
        velocity = way * (speed / np.maximum(distance, 1e-12))[:, None]
        travelled = np.minimum(speed[:, None, None] * self._ahead, distance[:, None, None])
        intent = position[:, None, :] + (way / np.maximum(distance, 1e-12)[:, None])[:, None, :] * travelled
        return model.follow_velocity(state, velocity), intent, distance

    def _update(self, value: tuple[Array, Array, Array]) -> None:
        control_input, intent, distance = value
        self._group.control_input = control_input
        self._group.awareness.intent.set(self.now + self._offsets, intent)
        arrived = (distance <= self.parameters.tolerance) & ~self._reached
        if arrived.any():
            self._reached |= arrived
            for row in np.flatnonzero(arrived).tolist():
                self.emit_for(row, "goal-reached", "reached its goal", distance=float(distance[row]))
