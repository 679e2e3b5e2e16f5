"""A scenario with a controller in a file beside it."""

from pathlib import Path

CONTROLLER = '''\
from symaware_cli import Controller, TimeSeries


class Go(Controller):
    """Heads for the goal."""

    def _compute(self):
        return self._agent.self_knowledge["goal"] - self._agent.self_state, TimeSeries()
'''

SCENARIO = """\
symaware: 1
name: own
plugins: [mine.py]
run: {duration: 0.5}
environment: {use: kinematic, with: {time_step: 0.05}}
agents:
  robot:
    count: 2
    model: {use: single-integrator}
    knowledge: {goal: [[5, 0], [0, 5]]}
    components: {steer: {use: mine.Go}}
specifications: {near: {each: robot, formula: "always position[0] < 9"}}
"""


def written(folder: Path, controller: str = CONTROLLER, scenario: str = SCENARIO) -> Path:
    """Write the scenario and its controller; returns the scenario."""
    (folder / "mine.py").write_text(controller)
    path = folder / "own.yaml"
    path.write_text(scenario)
    return path
