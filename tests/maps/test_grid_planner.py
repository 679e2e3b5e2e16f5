"""The planner on a grid: its outputs, new plans and refusals."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planned_runs import check_capture, names, run
from simulating import untyped

import symaware_cli as sa
from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem


@pytest.fixture
def planned(scenario: dict[str, Any]) -> dict[str, Any]:
    """Two robots that plan around the pillar of a room."""
    scenario["run"] = {"duration": 12.0}
    robot = scenario["agents"]["robot"]
    robot |= {
        "count": 2,
        "state": [[0.6, 1.0, 0.0], [2.2, 1.5, 0.0]],
        "knowledge": {"goal": [[2.2, 0.9], [0.6, 0.5]], "closed": {"all": []}},
        "components": {
            "sense": {"use": "perception.self"},
            "plan": {"use": "planning.grid", "with": {"margin": 0.05}},
            "steer": {"use": "control.waypoints", "with": {"tolerance": 0.1}},
        },
    }
    return scenario


def test_robots_reach_their_goals_without_a_contact(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    building()
    log = run(room)
    for agent, goal in (("robot.0", (2.2, 0.9)), ("robot.1", (0.6, 0.5))):
        assert names(log, agent) == ["path-planned", "goal-reached"]
        assert log.series(agent, "world").values[-1, :2] == pytest.approx(goal, abs=0.11)


def test_new_goals_and_closed_regions_cause_a_new_plan(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planned["regions"] = {"north": {"box": [1.2, 1.6, 1.2, 1.8]}, "south": {"box": [1.2, 1.6, 0.2, 0.8]}}
    planned["faults"] = {
        "sent": {"at": 5.0, "inform": {"of": "robot.0", "knowledge": {"goal": [0.6, 1.5]}}},
        "closed": {"at": 1.0, "inform": {"of": "robot.1", "knowledge": {"closed": ["north"]}}},
        "shut": {"at": 1.5, "inform": {"of": "robot.1", "knowledge": {"closed": ["north", "south"]}}},
        "open": {"at": 3.0, "inform": {"of": "robot.1", "knowledge": {"closed": []}}},
    }
    planned["run"]["duration"] = 16.0
    building()
    log = run(room)
    assert names(log, "robot.0") == ["path-planned", "goal-reached", "path-planned", "goal-changed", "goal-reached"]
    found = names(log, "robot.1")
    assert found[:3] == ["path-planned", "path-planned", "goal-unreachable"]
    assert found.count("path-planned") == 3
    assert found[-1] == "goal-reached"
    standing = log.series("robot.1", "world")
    still = standing.values[(standing.times > 2_000_000_000) & (standing.times < 2_900_000_000), :2]
    assert np.ptp(still, axis=0).max() < 0.05, "it stays where it is"


def held_up(planned: dict[str, Any]) -> dict[str, Any]:
    """A robot with a lidar on whose way another one stands, which the map does not have."""
    planned["agents"]["robot"] |= {
        "count": 1,
        "state": [0.6, 0.55, 0.0],
        "knowledge": {"goal": [2.2, 0.55], "waypoints": {"all": [[0, 0]]}},
        "components": {
            "sense": {"use": "perception.self"},
            "lidar": {"use": "perception.lidar", "with": {"rays": 60, "range": 2.0}},
            "plan": {"use": "planning.grid", "with": {"margin": 0.1, "scan": "lidar", "patience": 2.0}},
            "steer": {
                "use": "control.vector-field-histogram",
                "with": {"scan": "lidar", "margin": 0.05, "lookahead": 0.4},
            },
        },
    }
    planned["agents"]["parked"] = {
        "entity": {"shape": {"circle": {"radius": 0.15}}},
        "model": {"use": "unicycle"},
        "state": [1.5, 0.45, 0.0],
    }
    return planned


def test_a_robot_that_is_held_up_plans_around_what_its_lidar_sees(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    held_up(planned)["run"]["duration"] = 13.0
    building()
    log = run(room)
    assert names(log, "robot.0") == ["path-planned", "path-planned", "goal-reached"]
    again = [each.time for each in log.events() if each.name == "path-planned"][1]
    assert again >= 2_000_000_000
    passed = log.series("robot.0", "world").values[:, :2]
    assert passed[:, 1].max() > 1.3, "it takes the other side of the pillar"
    assert not list(log.contacts())


def test_a_robot_that_is_held_up_without_another_way_keeps_its_path(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    held_up(planned)["run"]["duration"] = 5.0
    planned["agents"]["parked"] |= {"count": 2, "state": [[1.5, 0.45, 0.0], [1.5, 1.55, 0.0]]}
    building()
    log = run(room)
    assert names(log, "robot.0") == ["path-planned"]


def test_the_cost_is_written_beside_the_waypoints(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planned["agents"]["robot"]["knowledge"]["goal"] = [[2.2, 0.9], [1.4, 1.0]]  # in the pillar
    building()
    with sa.load(room / "scenario.yaml").start() as simulation:
        simulation.step()
        known = untyped(simulation)._run.simulation.groups[0].knowledge
        assert known[0]["path_cost"] > 1.6
        assert tuple(known[0]["waypoints"][-1]) == (2.2, 0.9)
        assert known[1]["path_cost"] == -1.0
        assert known[1]["waypoints"] == ()


def test_an_agent_without_a_path_has_not_reached_its_goal(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planned["agents"]["robot"]["knowledge"]["goal"] = [[2.2, 0.9], [1.4, 1.0]]  # in the pillar
    planned["run"]["until"] = "all(goals_reached)"
    building()
    result = sa.load(room / "scenario.yaml").run(output=room / "log.mcap")
    assert "robot.1" not in result.summary.goals_reached
    assert names(sa.open_log(room / "log.mcap"), "robot.1") == ["goal-unreachable"], "what steers it lets it wait"


def test_the_planner_works_without_a_map_in_a_declared_area(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    del planned["map"]
    planned["environment"]["entities"] = {"post": {"shape": {"circle": {"radius": 0.3}}, "position": [1.4, 0.95]}}
    planned["agents"]["robot"]["components"]["plan"]["with"] |= {"resolution": 0.1, "within": [0.0, 3.0, 0.0, 2.0]}
    building()
    log = run(room)
    assert names(log, "robot.0") == ["path-planned", "goal-reached"]


def test_a_run_continues_from_its_captured_state(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    building()
    check_capture(room, 60)


@pytest.mark.parametrize(
    ("changes", "knowledge", "said"),
    [
        ({"resolution": 1e-4}, {}, "may have 1,000,000"),
        ({"within": [0.0, 0.0, 1.0, 2.0]}, {}, "the least of a coordinate is not below its greatest"),
        ({"margin": -0.1}, {}, "margin` is -0.1"),
        ({"most_cells": 0}, {}, "most_cells` is 0"),
        ({}, {"goal": {"all": [1.0]}}, "a position of 2 numbers"),
        ({}, {"closed": {"all": ["attic"]}}, "there is no region `attic` to be closed; there are: free, occupied"),
        ({}, {"closed": {"all": "free"}}, "is a list of names of regions"),
    ],
)
def test_invalid_settings_are_refused_before_the_run(
    changes: dict[str, Any],
    knowledge: dict[str, Any],
    said: str,
    problems: Callable[..., list[Problem]],
    planned: dict[str, Any],
) -> None:
    planned["agents"]["robot"]["components"]["plan"]["with"] |= changes
    planned["agents"]["robot"]["knowledge"] |= knowledge
    (problem,) = problems()
    assert said in problem.message
    assert problem.path.startswith("agents.robot")


@pytest.mark.parametrize(
    ("given", "said"),
    [({}, "the side of the cells is needed"), ({"resolution": 0.1}, "the area to plan in is needed")],
)
def test_without_a_map_the_grid_has_to_be_declared(
    given: dict[str, Any], said: str, problems: Callable[..., list[Problem]], planned: dict[str, Any]
) -> None:
    del planned["map"]
    planned["agents"]["robot"]["components"]["plan"]["with"] = given
    (problem,) = problems()
    assert said in problem.message


def test_cars_follow_a_path_by_pure_pursuit(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planned["run"]["duration"] = 20.0
    robot = planned["agents"]["robot"]
    robot |= {"count": 1, "entity": {"shape": {"circle": {"radius": 0.1}}}, "state": [[0.6, 1.0, math.pi / 2]]}
    robot["model"] = {"use": "bicycle", "with": {"wheelbase": 0.1}}
    robot["knowledge"] = {"goal": {"all": [2.2, 0.9]}}
    robot["components"]["plan"]["with"] = {"margin": 0.1}
    robot["components"]["steer"] = {
        "use": "control.pure-pursuit",
        "with": {"lookahead": 0.1, "lookahead_time": 0.1, "speed": 0.3},
    }
    building()
    log = run(room)
    assert names(log, "robot.0") == ["path-planned", "goal-reached"]


def test_a_car_without_a_path_stands_still_until_it_has_one(
    building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planned["run"]["duration"] = 20.0
    robot = planned["agents"]["robot"]
    robot |= {"count": 1, "entity": {"shape": {"circle": {"radius": 0.1}}}, "state": [[0.6, 1.0, math.pi / 2]]}
    robot["model"] = {"use": "bicycle", "with": {"wheelbase": 0.1}}
    robot["knowledge"] = {"goal": {"all": [1.4, 1.0]}}  # in the pillar
    robot["components"]["steer"] = {
        "use": "control.pure-pursuit",
        "with": {"lookahead": 0.1, "lookahead_time": 0.1, "speed": 0.3},
    }
    planned["faults"] = {"sent": {"at": 3.0, "inform": {"of": "robot.0", "knowledge": {"goal": [2.2, 0.9]}}}}
    building()
    log = run(room)
    assert names(log, "robot.0") == ["goal-unreachable", "path-planned", "goal-reached"]
    driven = log.series("robot.0", "world")
    assert np.ptp(driven.values[driven.times < 3_000_000_000, :2], axis=0).max() == 0.0
