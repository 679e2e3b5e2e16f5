"""Planners without a grid: their outputs, new plans, random draws and refusals."""

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

#: The planners, with parameters that suit a small room.
PLANNERS: dict[str, dict[str, Any]] = {
    "planning.roadmap": {"margin": 0.05, "samples": 300},
    "planning.rrt-star": {"margin": 0.05, "iterations": 400},
}

each_planner = pytest.mark.parametrize("use", PLANNERS)


@pytest.fixture
def planned(scenario: dict[str, Any]) -> dict[str, Any]:
    """Two robots that plan around the pillar of a room."""
    scenario["run"] = {"duration": 12.0}
    scenario["agents"]["robot"] |= {
        "count": 2,
        "model": {"use": "single-integrator"},
        "state": [[0.6, 1.0], [2.2, 1.5]],
        "knowledge": {"goal": [[2.2, 0.9], [0.6, 0.5]], "closed": {"all": []}},
        "components": {
            "sense": {"use": "perception.self"},
            "steer": {"use": "control.waypoints", "with": {"tolerance": 0.08}},
        },
    }
    return scenario


def planner(document: dict[str, Any], use: str, **changes: Any) -> None:
    """Add a planner to the robots, before the component that steers."""
    components = document["agents"]["robot"]["components"]
    components["plan"] = {"use": use, "with": PLANNERS[use] | changes}
    components["steer"] = components.pop("steer")


def costs(log: sa.Log) -> list[float]:
    return [event.data["cost"] for event in log.events() if event.name == "path-planned"]


@each_planner
def test_robots_reach_their_goals_without_a_contact(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planner(planned, use)
    planned["agents"]["robot"]["knowledge"]["goal"][1] = [0.6, 1.6]
    building()
    log = run(room)
    for agent in ("robot.0", "robot.1"):
        assert names(log, agent) == ["path-planned", "goal-reached"]
    assert [event.name for event in log.events() if event.name == "contact"] == []


@each_planner
def test_agents_plan_again_when_regions_are_closed_and_wait_without_a_path(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planner(planned, use)
    planned["regions"] = {"north": {"box": [1.3, 1.5, 1.2, 2.0]}, "south": {"box": [1.3, 1.5, 0.0, 0.8]}}
    inform = {"of": "robot.1", "knowledge": {"closed": ["north", "south"]}}
    planned["faults"] = {
        "locked": {"at": 0.5, "inform": inform},
        "unlocked": {"at": 4.0, "inform": {"of": "robot.1", "knowledge": {"closed": ["north"]}}},
    }
    planned["run"]["duration"] = 16.0
    building()
    log = run(room)
    assert names(log, "robot.0") == ["path-planned", "goal-reached"]
    assert names(log, "robot.1") == ["path-planned", "goal-unreachable", "path-planned", "goal-reached"]
    moved = log.series("robot.1", "world")
    standing = moved.values[(moved.times > 1_500_000_000) & (moved.times < 3_900_000_000), :2]
    assert np.ptp(standing, axis=0).max() < 0.05, "it stays where it is"
    crossing = moved.values[(moved.values[:, 0] > 1.3) & (moved.values[:, 0] < 1.5), 1]
    assert (crossing < 0.85).all(), "it keeps out of the region that is closed"


@each_planner
def test_a_seed_repeats_its_paths_and_another_one_has_others(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planner(planned, use)
    planned["run"]["duration"] = 0.2
    found = []
    for seed in (1, 1, 2):
        building(planned | {"seed": seed})
        found.append(costs(run(room)))
    assert found[0] == found[1]
    assert found[0] != found[2]


@each_planner
def test_draws_of_one_agent_do_not_affect_another(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planner(planned, use)
    planned["run"]["duration"] = 0.2
    building()
    both = costs(run(room))
    robot = planned["agents"]["robot"]
    robot |= {"count": 1, "state": robot["state"][:1]}
    robot["knowledge"]["goal"] = robot["knowledge"]["goal"][:1]
    building()
    assert costs(run(room)) == both[:1]


@each_planner
def test_a_goal_in_an_obstacle_or_beyond_the_area_has_no_path(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planner(planned, use)
    planned["run"]["duration"] = 0.2
    planned["agents"]["robot"]["knowledge"]["goal"] = [[1.4, 1.0], [30.0, 1.0]]
    building()
    with sa.load(room / "scenario.yaml").start() as simulation:
        simulation.step()
        for known in untyped(simulation)._run.simulation.groups[0].knowledge:
            assert (known["path_cost"], known["waypoints"]) == (-1.0, ())


@each_planner
def test_unknown_cells_are_obstacles_unless_paths_may_lead_through(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planned["run"]["duration"] = 0.2
    planned["agents"]["robot"]["knowledge"]["goal"] = [[0.3, 0.3], [0.3, 0.3]]  # in the unknown cell
    found = []
    for through in (False, True):
        planner(planned, use, through_unknown=through, margin=0.0)
        planned["agents"]["robot"]["entity"]["shape"]["circle"]["radius"] = 0.05
        building()
        found.append(names(run(room), "robot.0"))
    assert found == [["goal-unreachable"], ["path-planned"]]


@each_planner
def test_planners_work_without_a_map_in_a_declared_area(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    del planned["map"]
    planned["environment"]["entities"] = {"post": {"shape": {"circle": {"radius": 0.3}}, "position": [1.4, 0.95]}}
    planner(planned, use, within=[0.0, 3.0, 0.0, 2.0])
    building()
    assert names(run(room), "robot.0") == ["path-planned", "goal-reached"]


@each_planner
def test_a_run_continues_from_its_captured_state(
    use: str, building: Callable[..., Built], room: Path, planned: dict[str, Any]
) -> None:
    planner(planned, use)
    planned["faults"] = {"sent": {"at": 3.0, "inform": {"of": "robot.0", "knowledge": {"goal": [0.5, 1.6]}}}}
    building()
    check_capture(room, 40)


@each_planner
@pytest.mark.parametrize(
    ("changes", "knowledge", "said"),
    [
        ({"within": [0.0, 0.0, 1.0, 2.0]}, {}, "the least of a coordinate is not below its greatest"),
        ({"margin": -0.1}, {}, "margin` is -0.1"),
        ({}, {"goal": {"all": [1.0]}}, "a position of 2 numbers"),
        ({}, {"closed": {"all": ["attic"]}}, "there is no region `attic` to be closed; there are: free, occupied"),
    ],
)
def test_invalid_settings_are_refused_before_the_run(
    use: str,
    changes: dict[str, Any],
    knowledge: dict[str, Any],
    said: str,
    problems: Callable[..., list[Problem]],
    planned: dict[str, Any],
) -> None:
    planner(planned, use, **changes)
    planned["agents"]["robot"]["knowledge"] |= knowledge
    (problem,) = problems()
    assert said in problem.message
    assert problem.path.startswith("agents.robot")


@each_planner
def test_without_a_map_the_area_has_to_be_declared(
    use: str, problems: Callable[..., list[Problem]], planned: dict[str, Any]
) -> None:
    del planned["map"]
    planner(planned, use)
    (problem,) = problems()
    assert "the area to plan in is needed" in problem.message
