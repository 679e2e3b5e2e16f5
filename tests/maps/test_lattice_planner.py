"""The planner for cars: cars follow its paths without contact; and its refusals."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planned_runs import check_capture, run

import symaware_cli as sa
from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem


@pytest.fixture
def yard(scenario: dict[str, Any]) -> dict[str, Any]:
    """Three cars between containers, which head away from their goals."""
    del scenario["map"]
    container = {"shape": {"box": {"length": 3.0, "width": 0.8}}}
    scenario["run"] = {"duration": 40.0, "until": "all(goals_reached)"}
    scenario["environment"]["with"]["time_step"] = 0.05
    scenario["environment"]["entities"] = {
        "north": container | {"position": [4.0, 6.0]},
        "middle": container | {"position": [6.5, 4.0], "heading": 1.2},
        "south": container | {"position": [3.5, 2.2], "heading": -0.3},
        "post": {"shape": {"circle": {"radius": 0.3}}, "position": [8.3, 2.0]},
    }
    scenario["agents"]["robot"] |= {
        "count": 3,
        "entity": {"shape": {"circle": {"radius": 0.2}}},
        "model": {"use": "bicycle", "with": {"wheelbase": 0.3}},
        "state": [[1.0, 1.0, 3.1], [9.0, 7.0, 0.5], [1.0, 4.2, -1.5]],
        "knowledge": {"goal": [[9.0, 4.5], [1.2, 7.0], [9.2, 1.0]], "closed": {"all": []}},
        "components": {
            "sense": {"use": "perception.self"},
            "plan": {"use": "planning.lattice", "with": {"within": [0.0, 10.0, 0.0, 8.0], "margin": 0.1}},
            "steer": {
                "use": "control.pure-pursuit",
                "with": {"speed": 0.8, "lookahead": 0.2, "lookahead_time": 0.2, "tolerance": 0.1},
            },
        },
    }
    return scenario


def names(log: sa.Log, agent: str) -> list[str]:
    return [event.name for event in log.events() if event.source.startswith(f"agents.{agent}.")]


def test_cars_follow_their_paths_by_pure_pursuit_without_a_contact(
    building: Callable[..., Built], room: Path, yard: dict[str, Any]
) -> None:
    building()
    log = run(room)
    for agent in ("robot.0", "robot.1", "robot.2"):
        assert names(log, agent) == ["path-planned", "goal-reached"]
    assert [event.name for event in log.events() if event.name == "contact"] == []


def test_a_car_keeps_to_its_path(building: Callable[..., Built], room: Path, yard: dict[str, Any]) -> None:
    import shapely
    from simulating import untyped

    building()
    with sa.load(room / "scenario.yaml").start() as simulation:
        simulation.step()
        known = untyped(simulation)._run.simulation.groups[0].knowledge
        paths = [shapely.LineString(np.array(each["waypoints"])) for each in known]
    log = run(room)
    for row, path in enumerate(paths):
        driven = log.series(f"robot.{row}", "world").values[:, :2]
        assert shapely.distance(path, shapely.points(driven)).max() < 0.08


def test_a_car_plans_again_from_its_pose_when_regions_are_closed(
    building: Callable[..., Built], room: Path, yard: dict[str, Any]
) -> None:
    yard["regions"] = {"gate": {"box": [4.5, 5.5, 2.5, 5.5]}}
    yard["faults"] = {"locked": {"at": 1.0, "inform": {"of": "robot.0", "knowledge": {"closed": ["gate"]}}}}
    building()
    log = run(room)
    assert names(log, "robot.0") == ["path-planned", "path-planned", "goal-reached"]
    driven = log.series("robot.0", "world").values[:, :2]
    inside = (driven[:, 0] > 4.5) & (driven[:, 0] < 5.5) & (driven[:, 1] > 2.5) & (driven[:, 1] < 5.5)
    assert not inside.any()


def test_a_goal_that_no_car_can_reach_is_reported(
    building: Callable[..., Built], room: Path, yard: dict[str, Any]
) -> None:
    yard["run"] = {"duration": 0.2}
    yard["agents"]["robot"]["knowledge"]["goal"] = [[4.0, 6.0], [30.0, 1.0], [9.2, 1.0]]
    yard["agents"]["robot"]["components"]["plan"]["with"]["most_nodes"] = 300
    building()
    log = run(room)
    found = [event for event in log.events() if event.name == "goal-unreachable"]
    assert [event.source for event in found] == ["agents.robot.0.plan", "agents.robot.1.plan"]
    assert "was found within 300 states" in found[0].text
    assert "exists after 0 states" in found[1].text


def test_a_run_continues_from_its_captured_state(
    building: Callable[..., Built], room: Path, yard: dict[str, Any]
) -> None:
    yard["faults"] = {"sent": {"at": 1.5, "inform": {"of": "robot.0", "knowledge": {"goal": [5.0, 1.0]}}}}
    building()
    check_capture(room, 40)


@pytest.mark.parametrize(
    ("model", "changes", "said"),
    [
        ({"use": "bicycle"}, {"turning_radius": 0.5}, "its turning radius is 0.7308 m"),
        ({"use": "unicycle"}, {}, "the turning radius is needed, as the model is no car"),
        ({"use": "bicycle"}, {"turning_radius": -1.0}, "turning_radius` is -1"),
        ({"use": "bicycle"}, {"most_nodes": 0}, "most_nodes` is 0"),
        ({"use": "bicycle"}, {"resolution": 0.001}, "the cells are too small for turns of 0.877 m: at least 0.01754 m"),
    ],
)
def test_invalid_settings_are_refused_before_the_run(
    model: dict[str, Any],
    changes: dict[str, Any],
    said: str,
    problems: Callable[..., list[Problem]],
    yard: dict[str, Any],
) -> None:
    robot = yard["agents"]["robot"]
    robot["model"] = model
    robot["components"]["plan"]["with"] |= changes
    if model["use"] == "unicycle":
        robot["components"]["steer"] = {"use": "control.waypoints"}
    (problem,) = problems()
    assert said in problem.message


def test_models_without_a_heading_are_refused(problems: Callable[..., list[Problem]], yard: dict[str, Any]) -> None:
    robot = yard["agents"]["robot"]
    robot["model"] = {"use": "single-integrator"}
    robot["state"] = [state[:2] for state in robot["state"]]
    robot["components"]["steer"] = {"use": "control.waypoints"}
    (problem,) = problems()
    assert "it plans for agents with a heading" in problem.message
