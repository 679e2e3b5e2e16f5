"""The planners for teams: their outputs, new plans and refusals."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from simulating import untyped

import symaware_cli as sa
from symaware_cli.language.problem import Problem, ScenarioError

HALL = """type octile
height 4
width 6
map
......
.@@.@.
......
@@@.@@
"""


@pytest.fixture
def team() -> dict[str, Any]:
    """Three robots in a hall with narrow places."""
    return {
        "symaware": 1,
        "name": "hall",
        "run": {"duration": 12.0, "until": "all(goals_reached)"},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "map": {"file": "hall.map"},
        "agents": {
            "robot": {
                "count": 3,
                "entity": {"shape": {"circle": {"radius": 0.3}}},
                "model": {"use": "single-integrator"},
                "state": [[0.5, 1.5], [5.5, 1.5], [3.5, 3.5]],
                "knowledge": {"goal": [[5.5, 1.5], [0.5, 1.5], [3.5, 0.5]], "closed": {"all": []}},
                "components": {
                    "sense": {"use": "perception.self"},
                    "plan": {"use": "planning.cbs", "with": {"resolution": 1.0}},
                    "steer": {"use": "control.timed-waypoints"},
                },
            }
        },
    }


@pytest.fixture
def written(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Write a scenario beside its map."""
    (tmp_path / "hall.map").write_text(HALL)

    def write(document: dict[str, Any]) -> Path:
        path = tmp_path / "hall.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return path

    return write


Writer = Callable[[dict[str, Any]], Path]


def run(path: Path) -> tuple[sa.Log, Any]:
    result = sa.load(path).run(output=path.with_suffix(".mcap"))
    return sa.open_log(path.with_suffix(".mcap")), result.summary


def names(log: sa.Log, agent: str) -> list[str]:
    return [event.name for event in log.events() if event.source.startswith(f"agents.{agent}.")]


def nearest(log: sa.Log) -> float:
    """The least distance between the centres of two robots [m]."""
    places = [log.series(f"robot.{row}", "world").values[:, :2] for row in range(3)]
    return min(
        float(np.linalg.norm(places[one] - places[other], axis=1).min()) for one, other in ((0, 1), (0, 2), (1, 2))
    )


@pytest.mark.parametrize("use", ["planning.cbs", "planning.prioritised"])
def test_robots_change_places_without_a_contact(use: str, written: Writer, team: dict[str, Any]) -> None:
    team["agents"]["robot"]["components"]["plan"]["use"] = use
    log, summary = run(written(team))
    assert summary.contacts == 0
    assert len(summary.goals_reached) == 3
    assert nearest(log) >= 0.5**0.5 - 1e-6
    assert names(log, "robot.0") == ["path-planned", "goal-reached"]


def test_agents_keep_to_their_schedule_at_each_time(written: Writer, team: dict[str, Any]) -> None:
    path = written(team)
    with sa.load(path).start() as simulation:
        simulation.step()
        known = untyped(simulation)._run.simulation.groups[0].knowledge[1]
    log, _ = run(path)
    timed = np.array(known["timed_waypoints"])
    series = log.series("robot.1", "world")
    where = np.stack([np.interp(series.times / 1e9, timed[:, 0], timed[:, axis]) for axis in (1, 2)], axis=1)
    assert np.abs(series.values[:, :2] - where).max() < 1e-6
    assert known["path_cost"] == pytest.approx(timed[-1, 0])
    assert [list(each) for each in known["waypoints"]][-1] == [0.5, 1.5]


def test_a_new_goal_in_motion_gives_a_new_plan_without_a_contact(written: Writer, team: dict[str, Any]) -> None:
    team["faults"] = {
        "sent": {"at": 2.35, "inform": {"of": "robot.0", "knowledge": {"goal": [5.5, 3.5]}}},
        "back": {"at": 4.0, "inform": {"of": "robot.2", "knowledge": {"goal": [0.5, 3.5]}}},
    }
    log, summary = run(written(team))
    assert summary.contacts == 0
    assert len(summary.goals_reached) == 3
    assert nearest(log) >= 0.5**0.5 - 1e-6
    assert names(log, "robot.1").count("path-planned") == 3
    assert log.series("robot.0", "world").values[-1, :2] == pytest.approx([5.5, 3.5], abs=1e-3)
    assert log.series("robot.2", "world").values[-1, :2] == pytest.approx([0.5, 3.5], abs=1e-3)


def test_positions_that_are_no_centres_are_left_and_reached_in_an_additional_step(
    written: Writer, team: dict[str, Any]
) -> None:
    robot = team["agents"]["robot"]
    robot["state"] = [[0.6, 1.55], [5.4, 1.4], [3.5, 3.6]]
    robot["knowledge"]["goal"] = [[5.55, 1.45], [0.4, 1.5], [3.5, 0.5]]
    log, summary = run(written(team))
    assert (summary.contacts, len(summary.goals_reached)) == (0, 3)
    assert log.series("robot.0", "world").values[-1, :2] == pytest.approx([5.55, 1.45], abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"goal": [[5.5, 1.5], [5.4, 1.6], [3.5, 0.5]]}, "robot.1 is to go at (5.4, 1.6), in the same cell as robot.0"),
        (
            {"goal": [[1.5, 2.5], [0.5, 1.5], [3.5, 0.5]]},
            "robot.0 is to go at (1.5, 2.5), where its body fits in no cell",
        ),
        ({"closed": {"all": ["door"]}}, "no path leads robot.2 to its goal, wherever the others are"),
    ],
)
def test_without_a_plan_all_wait_and_a_warning_gives_the_reason(
    changes: dict[str, Any], said: str, written: Writer, team: dict[str, Any]
) -> None:
    team["regions"] = {"door": {"box": [3.0, 4.0, 0.0, 1.0]}}
    team["run"]["duration"] = 8.0
    team["agents"]["robot"]["knowledge"] |= changes
    log, summary = run(written(team))
    assert not summary.goals_reached
    texts = {event.text for event in log.events() if event.name == "goal-unreachable"}
    assert texts == {said}
    assert np.ptp(log.series("robot.1", "world").values[:, :2], axis=0).max() == 0.0


def test_without_a_new_plan_robots_stop_at_the_end_of_their_step(written: Writer, team: dict[str, Any]) -> None:
    team["faults"] = {"sent": {"at": 2.35, "inform": {"of": "robot.0", "knowledge": {"goal": [1.5, 2.5]}}}}
    team["run"] = {"duration": 5.0}
    log, summary = run(written(team))
    assert (summary.contacts, len(summary.goals_reached)) == (0, 0)
    for row in range(3):
        assert np.abs(log.series(f"robot.{row}", "world").values[-1, :2] % 1.0 - 0.5).max() < 1e-6
    assert names(log, "robot.0") == ["path-planned", "goal-unreachable"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"resolution": 0.9}, "cells of 0.9 m are too small for these bodies, which need 0.9899 m around corners"),
        ({"speed": 0.0}, "speed"),
        ({"within": [0.0, 0.0, 1.0, 2.0]}, "the least of a coordinate is not below its greatest"),
        ({"within": [0.0, 400.0, 0.0, 400.0], "resolution": 1.0}, "may have 100,000 for a team"),
    ],
)
def test_invalid_settings_are_refused_before_the_run(
    given: dict[str, Any], said: str, written: Writer, team: dict[str, Any]
) -> None:
    team["agents"]["robot"]["components"]["plan"]["with"] = given
    with pytest.raises(ScenarioError) as caught:
        sa.load(written(team)).run()
    found: list[Problem] = list(caught.value.problems)
    assert any(said in problem.message for problem in found)


@pytest.mark.parametrize("latency", [0.35, 1.2])
def test_a_plan_that_takes_time_begins_where_the_robots_are_then(
    latency: float, written: Writer, team: dict[str, Any]
) -> None:
    team["agents"]["robot"]["components"]["plan"] |= {"latency": latency}
    team["faults"] = {"sent": {"at": 2.35, "inform": {"of": "robot.0", "knowledge": {"goal": [5.5, 3.5]}}}}
    team["run"]["duration"] = 20.0
    log, summary = run(written(team))
    assert (summary.contacts, len(summary.goals_reached)) == (0, 3)
    assert nearest(log) >= 0.5**0.5 - 1e-6


def test_a_run_continues_from_its_captured_state(written: Writer, team: dict[str, Any]) -> None:
    team["faults"] = {"sent": {"at": 2.35, "inform": {"of": "robot.0", "knowledge": {"goal": [5.5, 3.5]}}}}
    scenario = sa.load(written(team))
    with scenario.start() as simulation:
        simulation.step(20)
        state = simulation.capture()
        simulation.step(50)
        end = simulation.state("robot")
    with scenario.start() as simulation:
        simulation.restore(state)
        simulation.step(50)
        assert np.array_equal(simulation.state("robot"), end)
