"""Components of single agents in plain Python, as the author of a paper would write them."""

from symaware_cli import Controller, PerceptionSystem, TimeSeries


class Perception(PerceptionSystem):
    """Perceives everybody."""

    def _compute(self):
        return self.environment.snapshot()


class ToGoal(Controller):
    """Heads for the goal."""

    def _compute(self):
        state = self._agent.self_state
        goal = self._agent.self_knowledge["goal"]
        return goal - state, TimeSeries()

    def _update(self, value):
        control_input, intent = value
        self._agent.model.control_input = control_input
        self._agent.self_awareness.intent = intent
