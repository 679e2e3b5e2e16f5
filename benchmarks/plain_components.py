"""Components of single agents in plain Python, as in a typical research implementation."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli import Controller, PerceptionSystem, Snapshot, TimeSeries

Array = NDArray[np.float64]


class Perception(PerceptionSystem):
    """Perceives all agents, as one shared snapshot."""

    def _compute(self) -> Snapshot:
        return self.environment.snapshot()


class DictionaryPerception(PerceptionSystem):
    """Perceives all agents by id, as in the original framework. The mapping is backed by the world's arrays."""

    def _compute(self) -> Mapping[str, Array]:
        return self.environment.snapshot().states_by_id


class OwnDictionaryPerception(PerceptionSystem):
    """Perceives all agents, as a new dictionary for each agent."""

    def _compute(self) -> dict[str, Array]:
        return dict(self.environment.snapshot().states_by_id)


class ToGoal(Controller):
    """Steers to the goal."""

    def _compute(self) -> tuple[Array, TimeSeries]:
        state = self._agent.self_state
        goal = self._agent.self_knowledge["goal"]
        return goal - state, TimeSeries()

    def _update(self, value: tuple[Any, ...]) -> None:
        control_input, intent = value
        self._agent.model.control_input = control_input
        self._agent.self_awareness.intent = intent


class AwareToGoal(ToGoal):
    """Reads its beliefs about every other agent, and steers to its goal."""

    def _compute(self) -> tuple[Array, TimeSeries]:
        own = self._agent.id
        others = [vector.state for other, vector in self._agent.awareness_database.items() if other != own]
        assert others
        return super()._compute()


class Dash(Controller):
    """Steers a unicycle to its goal, with a speed by the cosine of the heading error, as IR-SIM's ``dash``."""

    def _compute(self) -> tuple[Array, TimeSeries]:
        x, y, heading = self._agent.self_state.tolist()
        goal_x, goal_y = self._agent.self_knowledge["goal"].tolist()
        error = math.remainder(math.atan2(goal_y - y, goal_x - x) - heading, math.tau)
        speed = max(math.cos(error), 0.0)
        turn = min(max(error / 0.05, -1.0), 1.0)
        return np.array([speed, turn]), TimeSeries()

    def _update(self, value: tuple[Any, ...]) -> None:
        control_input, intent = value
        self._agent.model.control_input = control_input
        self._agent.self_awareness.intent = intent
