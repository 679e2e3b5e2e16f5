"""Disturbances of a published run, which was drawn with NumPy's global generator."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli import Agent, AgentGroup, AwarenessDatabase, Component, KnowledgeDatabase, Parameters


class RecordedDisturbance(Component):
    """Adds the disturbances of the robots of a published run to the control input.

    Put it after the controller. For a model x+ = x + u, with a limit of u that leaves room for it, that is the same as
    x+ = x + u + w. The disturbances are those that ``numpy.random.seed(seed)`` and then, for each robot in the order of
    the group, ``multivariate_normal([0, 0], deviation**2 * I, steps)`` yield; NumPy keeps that generator as it is.
    """

    class Parameters(Parameters):
        """The generator."""

        seed: int = Field(3, ge=0, lt=2**32, description="The seed of NumPy's legacy generator.")
        steps: int = Field(40, ge=1, le=100_000, description="Number of steps with disturbances of each robot.")
        deviation: float = Field(
            0.1,
            ge=0,
            description="Standard deviation of the disturbance along each axis [m]; robots that know a `variance` have "
            "the root of that one.",
        )

    def check(self, group: AgentGroup) -> None:
        """Check that the control input has two elements."""
        if len(group.model.control_input) != 2:
            raise ValueError("the disturbance has two elements, as the control input must have")

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Draw the disturbances of the agent."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        steps = self.parameters.steps
        drawn = np.random.RandomState(self.parameters.seed).standard_normal((len(agent.group), steps, 2))
        variance = agent.self_knowledge.get("variance")
        deviation = self.parameters.deviation if variance is None else math.sqrt(variance)
        self._disturbances = deviation * drawn[agent.row]

    def _compute(self) -> NDArray[np.float64]:
        step = self.now // self.environment.time_step
        wanted = self._agent.control_input
        return wanted + self._disturbances[step] if step < len(self._disturbances) else wanted

    def _update(self, value: NDArray[np.float64]) -> None:
        self._agent.model.control_input = value
