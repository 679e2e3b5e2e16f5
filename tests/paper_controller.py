"""The controller that the paper shows, letter by letter as in DESIGN.md section 3, and so without types."""

from symaware_cli import Controller, TimeSeries


# fmt: off
class MyController(Controller):
    def _compute(self):
        state = self._agent.self_state
        goal = self._agent.self_knowledge["goal"]
        return goal - state, TimeSeries()
    def _update(self, value):
        control_input, intent = value
        self._agent.model.control_input = control_input
        self._agent.self_awareness.intent = intent
