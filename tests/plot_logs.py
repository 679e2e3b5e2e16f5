"""Logs to plot, of scenarios that are run."""

from pathlib import Path

from symaware_cli import open_log
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.log.reader import Log

SCENARIOS = Path(__file__).parents[1] / "scenarios"

YARD = """\
symaware: 1
name: yard
run: {duration: 3.0}
environment:
  use: kinematic
  entities:
    pillar: {shape: {circle: {radius: 0.5}}, position: [0, 2]}
    fence: {shape: {wall: {points: [[-3, -2], [3, -2], [3, 4]], thickness: 0.2}}}
    gate:
      shape: {box: {length: 1.0, width: 0.2}}
      path: {times: [0, 3], positions: [[-2, 3], [2, 3]], headings: [0, 3]}
agents:
  cart:
    count: 2
    entity: {shape: {box: {length: 0.8, width: 0.4}}}
    model: {use: unicycle}
    state: [[-2, 0, 0], [2, 0.3, 3.14]]
    knowledge: {goal: [[2, 0], [-2, 0.3]]}
    components:
      sense: {use: perception.omniscient}
      risk: {use: risk.time-to-collision}
      steer: {use: control.go-to-goal}
  guard:
    entity: {shape: {polygon: {vertices: [[-0.3, -0.3], [0.4, 0], [-0.3, 0.3]]}}}
    model: {use: single-integrator, with: {max_speed: 1.0}}
    state: [1, -1]
    knowledge: {waypoints: [[-1, -1], [1, -1]]}
    components: {sense: {use: perception.self}, steer: {use: control.waypoints}}
"""

AIRCRAFT = """\
symaware: 1
name: aircraft
run: {duration: 4.0}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  plane:
    count: 2
    entity: {shape: {circle: {radius: 5}}}
    model: {use: dubins-aircraft, with: {dimensions: 3, min_speed: 15, max_speed: 30, max_turn_rate: 0.3}}
    state: [[0, 0, 100, 0], [100, 0, 112, 3.1415927]]
    knowledge: {goal: [[500, 0, 100], [-500, 0, 112]]}
    components: {sense: {use: perception.self}, steer: {use: control.go-to-goal, with: {speed: 20}}}
"""


def log_of(folder: Path, scenario: str, *overrides: str) -> Log:
    """Run a scenario, given by its text or by the name of an example, and open its log."""
    path = SCENARIOS / scenario
    if "\n" in scenario:
        path = folder / "scenario.yaml"
        path.write_text(scenario, encoding="utf-8")
    log = folder / f"{path.stem}-{len(list(folder.iterdir()))}.mcap"
    execute(open_scenario(path, overrides), log)
    return open_log(log)
