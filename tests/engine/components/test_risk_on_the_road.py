"""Cars on a road that slow down for risk: those in their lanes drive on, those whose way is crossed do not."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

CAR = """
    count: {count}
    model: {{use: bicycle, with: {{wheelbase: 2.7, max_speed: 20.0, process_noise: {noise}}}}}
    entity: {{shape: {{box: {{length: 4.5, width: 1.8}}}}}}
    components:
      sense: {{use: {sense}}}
      {estimate}
      risk: {{use: {risk}, with: {{horizon: 3.0, reach: 50.0, margin: 0.5}}}}
      steer: {{use: control.go-to-goal, with: {{speed: 10.0}}}}
      dare: {{use: control.risk-aware}}
"""


def road(
    tmp_path: Path,
    groups: Mapping[str, Any],
    sense: str = "perception.omniscient",
    risk: str = "risk.time-to-collision",
    estimate: str = "",
    entities: str = "",
) -> RunSummary:
    text = f"symaware: 1\nname: road\nrun: {{duration: 20.0}}\nenvironment: {{use: kinematic{entities}}}\nagents:\n"
    for name, (states, goals) in groups.items():
        car = CAR.format(count=len(states), noise="null", sense=sense, risk=risk, estimate=estimate)
        text += f"  {name}:{car}    state: {states}\n    knowledge: {{goal: {goals}}}\n"
    path = tmp_path / "road.yaml"
    path.write_text(text)
    return execute(build(path), None)


EAST = [[-20.0 * row, -1.75, 0.0] for row in range(4)]
WEST = [[60.0 + 20.0 * row, 1.75, 3.14159265] for row in range(4)]
LANES = {
    "east": (EAST, [[x + 120, y] for x, y, _ in EAST]),
    "west": (WEST, [[x - 135, y] for x, y, _ in WEST]),
}
WALLS = ", entities: {wall: {shape: {wall: {points: [[-100, -4], [200, -4]]}}}}"
SEEING = {"sense": "perception.range, with: {range: 60, position_noise: 0.05, velocity_noise: 0.05}"}
TRACKING = "estimate: {use: uncertainty.gaussian, with: {acceleration_noise: 0.05}}"


@pytest.mark.parametrize("risk", ["risk.time-to-collision", "risk.collision"])
def test_eight_cars_in_their_lanes_drive_on(tmp_path: Path, risk: str) -> None:
    summary = road(tmp_path, LANES, risk=risk, entities=WALLS)
    assert len(summary.goals_reached) == 8
    assert summary.contacts == 0
    assert summary.highest_risk is not None
    assert summary.highest_risk.value < 0.01


def test_cars_that_see_a_little_wrong_drive_on_too(tmp_path: Path) -> None:
    summary = road(tmp_path, LANES, risk="risk.collision", estimate=TRACKING, **SEEING)
    assert len(summary.goals_reached) == 8
    assert summary.contacts == 0
    # Before the filters settle, any velocity may be believed: of seeds 0 to 7, one fears the worst then.
    assert summary.highest_risk is not None
    assert summary.highest_risk.time < 0.5


@pytest.mark.parametrize("risk", ["risk.time-to-collision", "risk.collision"])
def test_cars_brake_for_one_that_crosses_their_lane(tmp_path: Path, risk: str) -> None:
    crossing = {"side": ([[40.0, -41.0, 1.5707963]], [[40.0, 60.0]])}
    summary = road(tmp_path, {**LANES, **crossing}, risk=risk)
    assert summary.highest_risk is not None
    assert summary.highest_risk.value > 0.7
    # Of those who know everything the probability is 0 or 1: that brake is abrupt, and lets go too early.
    assert summary.contacts == 0 or risk == "risk.collision"


def test_a_car_brakes_for_a_wall_across_its_lane_but_not_for_the_one_beside_it(tmp_path: Path) -> None:
    ahead = ", entities: {wall: {shape: {wall: {points: [[60, -4], [60, 0]]}}}}"
    east = {"east": (EAST[:1], [[90, -1.75]])}
    assert road(tmp_path, east, entities=WALLS).goals_reached == ("east.0",)
    stopped = road(tmp_path, east, entities=ahead)
    assert (stopped.contacts, stopped.goals_reached) == (0, ())
