"""Controllers that drive by what a lidar sees."""

from typing import Any

import numpy as np
import pytest

from symaware_cli import ScenarioError, scenario

VFH, WINDOW = "control.vector-field-histogram", "control.dynamic-window"
VELOCITY, BARRIER = "control.velocity-obstacle", "control.barrier-filter"


def document(steer: str, *more: tuple[str, Any], model: str = "unicycle", **options: Any) -> dict[str, Any]:
    """Two robots that change places past a crate and a pillar."""
    heading = [[0.0], [3.14]] if model == "unicycle" else [[], []]
    entities = {
        "crate": {"shape": {"box": {"length": 0.8, "width": 1.2}}, "position": [2.5, 0.3]},
        "pillar": {"shape": {"circle": {"radius": 0.4}}, "position": [4.5, -0.4]},
    }
    lidar = {"use": "perception.lidar", "with": {"range": 4.0, "rays": 90, "noise": 0.01}, "period": 0.2}
    components = {"sense": {"use": "perception.self"}, "lidar": lidar}
    if steer == BARRIER:
        components["lead"] = {"use": "control.go-to-goal", "with": {"speed": 0.8}}
    components["steer"] = {"use": steer, "with": {"scan": "lidar", **options}}
    return {
        "symaware": 1,
        "name": "seen",
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}, "entities": entities},
        "run": {"duration": 40.0, "until": "all(goals_reached)"},
        "agents": {
            "robot": {
                "count": 2,
                "entity": {"shape": {"circle": {"radius": 0.25}}},
                "model": {"use": model, "with": {"max_speed": 1.0}},
                "state": [[0.0, 0.0, *heading[0]], [7.0, 0.1, *heading[1]]],
                "knowledge": {"goal": [[7.0, 0.0], [0.0, 0.0]], **dict(more)},
                "components": components,
            }
        },
    }


@pytest.mark.parametrize(("steer", "model"), [(VFH, "unicycle"), (VFH, "single-integrator"), (WINDOW, "unicycle")])
def test_robots_reach_their_goals_past_seen_obstacles(steer: str, model: str) -> None:
    summary = scenario(document(steer, model=model, deviation=0.01)).run(record=False).summary
    assert summary.goals_reached == ("robot.0", "robot.1")
    assert summary.contacts == 0


@pytest.mark.parametrize("steer", [VELOCITY, BARRIER])
@pytest.mark.parametrize("model", ["unicycle", "single-integrator"])
def test_robots_that_see_nothing_but_their_scans_touch_nothing(steer: str, model: str) -> None:
    assert scenario(document(steer, model=model, deviation=0.01)).run(record=False, duration=20.0).summary.contacts == 0


def test_without_the_scan_the_obstacles_would_be_met() -> None:
    content = document("control.go-to-goal")
    content["agents"]["robot"]["components"]["steer"]["with"] = {}
    assert scenario(content).run(record=False).summary.contacts > 0


@pytest.mark.parametrize("steer", [VFH, WINDOW])
def test_waypoints_are_followed_and_may_lead_away_from_the_goal(steer: str) -> None:
    around = [[[0.0, 2.5], [7.0, 2.5], [7.0, 0.0]], [[7.0, -3.0], [0.0, -3.0], [0.0, 0.0]]]
    content = document(steer, ("waypoints", around))
    summary = scenario(content).run(record=False).summary
    assert len(summary.goals_reached) == 2
    assert summary.simulated_time > 11.0  # each way is 12 m long


@pytest.mark.parametrize(("limited", "least", "most"), [(True, 0.05, 0.16), (False, -0.1, 0.03)])
def test_a_robot_close_to_a_wall_turns_before_it_drives_along_it(limited: bool, least: float, most: float) -> None:
    content = document(VFH, limit_by_heading=limited)
    wall = {"shape": {"box": {"length": 0.4, "width": 8.0}}, "position": [0.61, 0.0]}
    content["environment"]["entities"] = {"wall": wall}
    robot = content["agents"]["robot"]
    robot["model"]["with"]["max_turn_rate"] = 0.5
    robot.update(count=1, state=[0.0, 0.0, 0.3], knowledge={"goal": [0.0, 3.0]})
    gaps = []
    with scenario(content).start() as simulation:
        for _ in range(60):
            simulation.step()
            gaps.append(0.41 - 0.25 - simulation.state("robot.0", "x")[0])
        assert simulation.state("robot.0", "y")[0] > 0.3
    assert least < min(gaps) < most


@pytest.mark.parametrize(("last_resort", "leaves"), [(0.3, True), (None, False)])
def test_a_robot_leaves_a_place_that_is_surrounded_at_a_distance(last_resort: float | None, leaves: bool) -> None:
    content = document(VFH, last_resort=last_resort)
    walls = {"back": (-0.6, 0, 0.2, 1.4), "left": (0.4, 0.6, 2.2, 0.2), "right": (0.4, -0.6, 2.2, 0.2)}
    content["environment"]["entities"] = {
        name: {"shape": {"box": {"length": length, "width": width}}, "position": [x, y]}
        for name, (x, y, length, width) in {**walls, "opposite": (3.0, 0, 0.2, 8.0)}.items()
    }
    content["agents"]["robot"].update(count=1, state=[0.0, 0.0, 0.0], knowledge={"goal": [2.2, 1.8]})
    summary = scenario(content).run(record=False, duration=12.0).summary
    assert len(summary.goals_reached) == leaves
    assert summary.contacts == 0


def test_an_agent_that_counts_the_unseen_as_occupied_does_not_start_without_a_scan() -> None:
    content = document(VFH, unseen="occupied")
    content["agents"]["robot"]["components"]["lidar"]["with"]["dropout"] = 1.0
    assert not scenario(content).run(record=False, duration=15.0).summary.goals_reached


@pytest.mark.parametrize("steer", [VFH, WINDOW, VELOCITY, BARRIER])
def test_a_scan_that_nobody_makes_is_refused_with_its_place(steer: str) -> None:
    content = document(steer)
    content["agents"]["robot"]["components"]["steer"]["with"]["scan"] = "lidor"
    with pytest.raises(ScenarioError, match="there is no component `lidor`"):
        scenario(content)


def test_the_dynamic_window_needs_a_speed_and_a_turn_rate() -> None:
    with pytest.raises(ScenarioError, match="a speed and a turn rate, such as `unicycle`"):
        scenario(document(WINDOW, model="single-integrator"))


def test_requests_of_the_dynamic_window_keep_to_its_accelerations() -> None:
    inputs: list[Any] = []
    simulated = scenario(document(WINDOW, window=0.1, acceleration=1.0)).start()
    with simulated:
        for _ in range(10):
            simulated.step()
            inputs.append(simulated.control("robot.0"))
    changes = np.diff([each[0] for each in inputs])
    assert np.abs(changes).max() <= 0.1 + 1e-9
