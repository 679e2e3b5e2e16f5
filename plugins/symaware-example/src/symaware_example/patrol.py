"""A controller that patrols its waypoints."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli import Agent, AgentGroup, AwarenessDatabase, Controller, KnowledgeDatabase, Parameters, TimeSeries

Array = NDArray[np.float64]


class Patrol(Controller):
    """Moves from waypoint to waypoint at a constant speed, and starts again after the last one."""

    knowledge: ClassVar = {"waypoints": "where to go round, as a list of positions [m]"}
    events: ClassVar = {"waypoint-reached": "The agent came within the tolerance of the waypoint it was heading for."}

    class Parameters(Parameters):
        """Speed and tolerance of the patrol."""

        speed: float = Field(1.0, gt=0, description="Speed [m/s].")
        tolerance: float = Field(0.2, gt=0, description="Distance at which a waypoint counts as reached [m].")

    def check(self, group: AgentGroup) -> None:
        """Check that every agent has two waypoints or more, and that the model can follow a velocity."""
        dimensions = len(group.model.position)
        for knowledge in group.knowledge:
            waypoints = np.asarray(knowledge["waypoints"], float)
            if waypoints.ndim != 2 or len(waypoints) < 2 or waypoints.shape[1] != dimensions:
                raise ValueError(f"`waypoints` must be two or more positions of {dimensions} numbers")
        group.model.follow_velocity(group.initial_state, np.zeros((len(group), dimensions)))

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start with the first waypoint."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._waypoints = np.asarray(agent.self_knowledge["waypoints"], float)
        self._next = 0

    def _compute(self) -> tuple[Array, TimeSeries, Array, int]:
        waypoints = np.asarray(self.agent.self_knowledge["waypoints"], float)
        # The waypoints may have changed since the last turn.
        number = self._next if np.array_equal(waypoints, self._waypoints) else 0
        state = self.agent.self_state
        position = state[list(self.agent.model.position)]
        waypoint = waypoints[number]
        distance = float(np.hypot(*(waypoint - position)[:2]))
        velocity = self.parameters.speed * (waypoint - position) / max(distance, 1e-12)
        control_input = self.agent.model.follow_velocity(state[None], velocity[None])[0]
        intent = TimeSeries({self.time: position, self.time + max(distance, 1e-3) / self.parameters.speed: waypoint})
        return control_input, intent, waypoints, number

    def _update(self, value: tuple[Array, TimeSeries, Array, int]) -> None:
        control_input, intent, self._waypoints, self._next = value
        super()._update((control_input, intent))
        position = self.agent.self_state[list(self.agent.model.position)]
        if np.linalg.norm(self._waypoints[self._next] - position) <= self.parameters.tolerance:
            self.emit("waypoint-reached", f"reached waypoint {self._next}", waypoint=self._next)
            self._next = (self._next + 1) % len(self._waypoints)
