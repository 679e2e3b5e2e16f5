"""Intents follow sent waypoints from the step after the message was sent; else they are straight flight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symaware_cli import open_log

if TYPE_CHECKING:
    from simulating import Command

    from tests.conftest import Flight, Fly

AVOIDANCE = "intent-avoidance.yaml"


def predicted(flight: Flight, scenario: int) -> dict[int, NDArray[np.float64]]:
    """Return the intruder's positions in a scenario of the fan, by the second of the prediction."""
    found = {}
    for message in flight.log.messages("/agents/ownship/uncertainty"):
        series = message.decode()
        found[message.time // 10**9] = np.asarray(series.values)[:, 2 * scenario : 2 * scenario + 2]
    return found


def test_a_sent_waypoint_is_known_in_the_next_step(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml")
    intents = predicted(flight, 27)
    # Before it is told, straight flight is assumed; then the prediction is what will come true.
    np.testing.assert_allclose(intents[0], [(-120 + 10 * k, 90) for k in range(31)], atol=1e-9)
    for k in (1, 20, 52):
        np.testing.assert_allclose(intents[k], flight.intruder[k : k + 31, :2], atol=1e-9)


def test_received_waypoints_become_recorded_knowledge(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml")
    messages = list(flight.log.messages("/agents/ownship/knowledge"))
    assert messages[-1].time == 10**9
    assert '"waypoints": {"intruder": [600.0, 450.0, 0.0]}' in messages[-1].decode().values[0]


def test_a_filed_flight_plan_is_known_from_the_start(fly: Fly) -> None:
    flight = fly("with-intent.yaml")
    np.testing.assert_allclose(predicted(flight, 0)[0], flight.intruder[:31, :2], atol=1e-6)


def test_without_intent_everybody_is_thought_to_fly_straight_on(fly: Fly) -> None:
    flight = fly("without-intent.yaml")
    intents = predicted(flight, 0)
    for k in (0, 5, 20):
        x, y, heading = flight.intruder[k]
        ahead = 10.0 * np.arange(31)
        straight = np.stack([x + ahead * np.cos(heading), y + ahead * np.sin(heading)], axis=1)
        np.testing.assert_allclose(intents[k], straight, atol=1e-9)


def test_the_waypoint_is_sent_again_periodically(fly: Fly) -> None:
    told = [each.time // 10**9 for each in fly("intent-avoidance.yaml").log.communications() if each.stage == "SENT"]
    assert told == list(range(0, 82, 10))


def test_waypoints_that_are_no_poses_are_refused_before_the_run(command: Command, scenarios: Path) -> None:
    for value, said in (
        ("[600, 450, 0]", "mapping from ids"),
        ("{intruder: [600, 450]}", "the waypoint of `intruder`"),
    ):
        done = command("validate", scenarios / AVOIDANCE, "--set", f"agents.ownship.knowledge.waypoints={value}")
        assert done.returncode == 2
        assert said in done.stderr


def test_a_waypoint_to_fly_to_must_be_a_pose(command: Command, scenarios: Path) -> None:
    done = command("validate", scenarios / AVOIDANCE, "--set", "agents.intruder.knowledge.waypoint=[600, 450]")
    assert done.returncode == 2
    assert done.stderr.count("`waypoint` must be x [m], y [m] and heading [rad]") == 2


def test_an_agent_with_only_a_perceived_motion_is_assumed_to_head_along_its_velocity(
    tmp_path: Path, command: Command, scenarios: Path
) -> None:
    done = command(
        *("run", scenarios / AVOIDANCE, "--output", tmp_path / "log.mcap", "--set", "run.duration=5"),
        *("--set", "agents.ownship.components.sense={use: perception.range, with: {range: 5000}}"),
    )
    assert done.returncode == 0, done.stderr
    log = open_log(tmp_path / "log.mcap")
    beliefs, truth = log.beliefs("ownship", "intruder"), log.series("intruder", "world")
    assert beliefs.columns == ("x", "y", "vx", "vy")
    steps = slice(1, len(beliefs.times) - 1)
    assert np.allclose(beliefs.values[steps, :2], truth.values[steps, :2])
    headings = np.arctan2(beliefs.values[steps, 3], beliefs.values[steps, 2])
    assert np.allclose(headings[1:], truth.values[steps, 2][1:], atol=0.1)
