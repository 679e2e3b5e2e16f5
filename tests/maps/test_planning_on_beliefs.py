"""Planning on beliefs about the map: plans avoid obstacles once they are seen, and are renewed only when necessary."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planned_runs import check_capture, run

import symaware_cli as sa
from symaware_cli.language.build import Built
from symaware_cli.language.problem import Problem
from symaware_cli.maps.believed_floor import BelievedFloor, rest_of_path


@pytest.fixture
def exploring(scenario: dict[str, Any]) -> dict[str, Any]:
    """A robot whose way is blocked by a wall with a gap, which it does not know."""
    del scenario["map"]
    wall = {"shape": {"box": {"length": 0.2, "width": 3.0}}}
    scenario["run"] = {"duration": 40.0, "until": "all(goals_reached)"}
    scenario["environment"]["entities"] = {
        "wall": wall | {"position": [3.0, 2.0]},
        "shelf": {"shape": {"box": {"length": 2.0, "width": 0.4}}, "position": [4.5, 5.0]},
    }
    scenario["agents"]["robot"] |= {
        "model": {"use": "single-integrator"},
        "state": [1.0, 2.0],
        "knowledge": {"goal": [5.0, 2.0]},
        "components": {
            "sense": {"use": "perception.self"},
            "lidar": {"use": "perception.lidar", "with": {"rays": 90, "range": 1.6}, "period": 0.2},
            "belief": {
                "use": "perception.map",
                "with": {"scan": "lidar", "resolution": 0.1, "within": [0.0, 6.0, 0.0, 6.0], "record": 0.4},
            },
            "plan": {
                "use": "planning.grid",
                "with": {"on": "belief", "resolution": 0.1, "within": [0.0, 6.0, 0.0, 6.0], "margin": 0.15},
            },
            "steer": {"use": "control.waypoints", "with": {"tolerance": 0.1}},
        },
    }
    return scenario


def planned(log: sa.Log) -> list[Any]:
    return [event for event in log.events() if event.name in ("path-planned", "goal-unreachable")]


def test_a_robot_plans_through_an_unknown_wall_and_around_it_once_it_is_seen(
    building: Callable[..., Built], room: Path, exploring: dict[str, Any]
) -> None:
    building()
    log = run(room)
    found = planned(log)
    assert found[0].name == "path-planned"
    assert found[0].data["length"] == pytest.approx(4.0, abs=0.1)
    assert 2 <= len(found) <= 12
    assert found[1].data["length"] > 4.3
    names = [event.name for event in log.events()]
    assert "goal-reached" in names
    assert "contact" not in names


def test_plans_are_the_same_in_a_separate_process(
    building: Callable[..., Built], room: Path, exploring: dict[str, Any]
) -> None:
    exploring["run"]["duration"] = 8.0
    building()
    one = [event.data for event in planned(run(room))]
    exploring["agents"]["robot"]["components"]["plan"]["run_in"] = "process"
    building()
    assert [event.data for event in planned(run(room))] == one


def test_a_belief_that_changes_beside_the_path_is_no_reason_to_plan_again(
    building: Callable[..., Built], room: Path, exploring: dict[str, Any]
) -> None:
    exploring["agents"]["robot"]["knowledge"]["goal"] = [1.0, 5.0]
    building()
    log = run(room)
    assert [event.name for event in planned(log)] == ["path-planned"]
    assert "goal-reached" in [event.name for event in log.events()]


def test_a_walled_in_robot_reports_it_once(
    building: Callable[..., Built], room: Path, exploring: dict[str, Any]
) -> None:
    for number, (x, y) in enumerate([(1.0, 1.0), (1.0, 3.0), (0.2, 2.0), (2.0, 2.0)]):
        size = {"length": 2.4, "width": 0.2} if number < 2 else {"length": 0.2, "width": 2.4}
        exploring["environment"]["entities"][f"cell_{number}"] = {"shape": {"box": size}, "position": [x, y]}
    exploring["agents"]["robot"]["components"]["lidar"]["with"]["noise"] = 0.03
    exploring["run"]["duration"] = 8.0
    building()
    assert [event.name for event in planned(run(room))] == ["goal-unreachable"]


def test_unknown_areas_can_be_closed(building: Callable[..., Built], room: Path, exploring: dict[str, Any]) -> None:
    exploring["agents"]["robot"]["components"]["plan"]["with"]["through_unknown"] = False
    exploring["agents"]["robot"]["knowledge"]["goal"] = [2.0, 2.0]
    building()
    found = planned(run(room))
    assert [event.name for event in found] == ["goal-unreachable", "path-planned"], "after the first scan it has one"


def test_a_run_continues_from_its_captured_state(
    building: Callable[..., Built], room: Path, exploring: dict[str, Any]
) -> None:
    building()
    check_capture(room, 60)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("beleif", "there is no component `beleif`"),
        ("lidar", "`lidar` is no belief about the map, but a"),
    ],
)
def test_components_without_a_belief_about_the_map_are_refused(
    name: str, said: str, problems: Callable[..., list[Problem]], exploring: dict[str, Any]
) -> None:
    exploring["agents"]["robot"]["components"]["plan"]["with"]["on"] = name
    (problem,) = problems()
    assert said in problem.message
    assert problem.path == "agents.robot.components.plan.with.on"


def test_the_areas_of_a_belief_are_bodies_and_free_space() -> None:
    believed = BelievedFloor(np.array([[0.0, 2.0, 0.0, 1.0, 0.0], [2.0, 3.0, 0.0, 1.0, 1.0]]))
    (body,) = believed.obstacles().values()
    assert body.position == (2.5, 0.5)
    points = np.array([[1.0, 0.5], [2.5, 0.5], [5.0, 0.5]])
    assert believed.is_free(points).tolist() == [True, False, False]


def test_the_rest_of_a_path_begins_at_the_nearest_leg() -> None:
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    assert rest_of_path(path, np.array([1.9, 1.0])).tolist() == [[1.9, 1.0], [2.0, 2.0], [0.0, 2.0]]
    assert rest_of_path(path[:1], np.array([1.0, 1.0])).tolist() == [[1.0, 1.0], [0.0, 0.0]]
