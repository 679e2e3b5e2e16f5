"""The plugins work, refuse unsuitable groups, and are repeatable. Run with the package installed."""

import subprocess
import sys
from pathlib import Path

from symaware_cli import open_log
from symaware_cli.testing import assert_repeatable

SCENARIO = Path(__file__).parent.parent / "scenarios" / "rounds.yaml"


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-P", "-m", "symaware_cli", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)


def test_guards_patrol_their_waypoints_with_events(tmp_path: Path) -> None:
    done = run("run", SCENARIO, "--output", tmp_path / "rounds.mcap")
    assert done.returncode == 0, done.stderr
    log = open_log(tmp_path / "rounds.mcap")
    reached = [event for event in log.events() if event.name == "waypoint-reached" and "guard.0" in event.source]
    # 30 s at 1.5 m/s around a square of 8 m: five corners, each cut by no more than the tolerance.
    assert [event.data["waypoint"] for event in reached] == [0, 1, 2, 3, 0]


def test_guards_know_the_received_states_and_intents_of_each_other(tmp_path: Path) -> None:
    done = run("run", SCENARIO, "--output", tmp_path / "rounds.mcap", "--set", "run.duration=2")
    assert done.returncode == 0, done.stderr
    log = open_log(tmp_path / "rounds.mcap")
    told = [each for each in log.communications() if each.stage == "DELIVERED"]
    assert {(each.sender, each.receiver) for each in told} == {
        (f"guard.{one}", f"guard.{other}") for one in range(3) for other in range(3) if one != other
    }
    assert len([each for each in told if each.receiver == "guard.0"]) == 2 * 4
    assert log.channels["/agents/guard/awareness"].count == 4


def test_a_patrol_without_two_waypoints_is_refused_before_the_run() -> None:
    done = run("validate", SCENARIO, "--set", "agents.guard.knowledge.waypoints={all: [[1, 2]]}")
    assert done.returncode == 2
    assert "two or more positions of 2 numbers" in done.stderr


def test_the_rounds_can_be_repeated() -> None:
    assert_repeatable(SCENARIO, ["run.duration=5"])
