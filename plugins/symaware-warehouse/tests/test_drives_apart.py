"""Robots that send each other their plans stay apart."""

from __future__ import annotations

import numpy as np
import pytest
from simulating import in_process as command
from symaware_warehouse.told_tube import ToldTube
from warehouse_runs import SCENARIOS, run

from symaware_cli import Log, TimeSeries

SECOND = 1_000_000_000


def least_distance(log: Log) -> float:
    """The least distance of the centres of the two robots [m]."""
    one, other = (log.series(agent, "world").values[:, :2] for agent in ("robot.0", "robot.1"))
    return float(np.linalg.norm(one - other, axis=1).min())


def test_the_second_robot_stays_apart_from_the_first_and_both_satisfy_their_specifications() -> None:
    log = run("drives-apart.yaml")
    assert {each.name: each.verdict for each in log.outcomes} == dict.fromkeys(
        ("safe", "fetch_2", "fetch_3", "apart"), "satisfied"
    )
    assert least_distance(log) > 1.5
    assert "contact" not in {event.name for event in log.events()}


@pytest.mark.slow
def test_without_a_separation_they_come_closer_than_that() -> None:
    log = run("drives-apart.yaml", "agents.robot.components.plan.with.separation=null")
    assert {each.name: each.verdict for each in log.outcomes}["apart"] == "violated"
    assert least_distance(log) < 1.0


def test_a_separation_is_no_negative_number() -> None:
    done = command(
        "validate", "--set", "agents.robot.components.plan.with.separation=-1", SCENARIOS / "drives-apart.yaml"
    )
    assert done.returncode == 2
    assert "separation" in done.stderr


def told(times: list[int], radii: list[float]) -> ToldTube | None:
    steps = np.array([0, 1, 2], np.int64) * SECOND
    positions = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    tube = np.column_stack([np.zeros((len(radii), 4)), radii])
    uncertainty = TimeSeries.sampled(np.array(times, np.int64) * SECOND, tube)
    return ToldTube.of("robot.0", TimeSeries.sampled(steps + 3 * SECOND, positions), uncertainty, SECOND, 0)


def test_received_plans_count_from_the_present_step_on() -> None:
    tube = told([3, 4, 5], [0.0, 0.4, 0.5])
    assert tube is not None
    positions, radii = tube.rest(4)
    assert positions.tolist() == [[1.0, 0.0], [2.0, 0.0]]
    assert radii.tolist() == [0.4, 0.5]
    assert [len(each) for each in (*tube.rest(2), *tube.rest(9))] == [0, 0, 0, 0]


def test_an_uncertainty_that_is_not_of_the_intent_is_no_tube() -> None:
    assert told([3], [0.4]) is None
