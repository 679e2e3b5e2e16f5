"""Runs wait for the commands of a node in another process, and are repeated and verified without it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import symaware_cli as sa
from symaware_cli.bags import ros_messages
from symaware_cli.log.digest import digest

SCENARIO = Path(__file__).parents[1] / "examples" / "goals.yaml"
pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

HERE = Path(__file__).parent
DRIVE = "agents.robot.components.drive.with"


@contextmanager
def listening(*program: str) -> Iterator[str]:
    """Provide the URL of a program that listens."""
    with subprocess.Popen([sys.executable, *program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[-1]
        finally:
            process.kill()


@pytest.fixture(scope="module")
def peer() -> Iterator[str]:
    """The URL of a peer that drives to two goals, and answers within 5 ms."""
    ros_messages.typestore()  # reading it takes longer than most tests
    goals = ("--goal", "5", "-1", "--goal", "5", "1")
    with listening("-m", "symaware_ros.peer", "--port", "0", "--delay", "0.005", *goals) as url:
        yield url


@pytest.fixture(scope="module")
def faulty() -> Iterator[str]:
    """The beginning of the URL of a peer that misbehaves in the way named by the path."""
    with listening(str(HERE / "ros_peers.py")) as url:
        yield f"{url}/"


class Ended(NamedTuple):
    """The status and the failure of a run."""

    status: str
    failure: str = ""


def ran(url: str, log: Path, **changes: Any) -> Ended:
    """Run the example for a second."""
    timeout = {f"{DRIVE}.timeout": 20.0} if "timeout" not in changes else {}
    given = {f"{DRIVE}.{key}" if "." not in key else key: value for key, value in changes.items()}
    scenario = sa.load(SCENARIO, {"run.duration": 1.0, f"{DRIVE}.url": url, **timeout, **given})
    try:
        return Ended(scenario.run(output=log).status)
    except sa.RunFailedError as error:
        return Ended(error.run.status, str(error))


def test_two_runs_are_equal_regardless_of_the_delays_of_the_node(peer: str, tmp_path: Path) -> None:
    for name in ("one", "two"):
        ran(peer, tmp_path / f"{name}.mcap")
    one, two = (sa.open_log(tmp_path / f"{name}.mcap") for name in ("one", "two"))
    assert digest(one).combined == digest(two).combined
    assert len(one.inputs) == 20
    assert np.ptp(one.series("robot.0", "world").values[:, 0]) > 0.5, "it drives"


def test_the_log_is_verified_run_again_and_branched_without_the_node(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with listening("-m", "symaware_ros.peer", "--port", "0") as url:
        ran(url, log)
    # Nobody listens any more.
    result = sa.verify_log(log)
    assert result.is_equal
    assert result.is_whole
    again = sa.load(log).run(output=tmp_path / "again.mcap")
    assert again.status == "finished"
    assert sa.compare(log, tmp_path / "again.mcap").is_equal
    assert sa.branch(log, 0.5, output=tmp_path / "same.mcap").summary.status == "finished"
    alone = sa.branch(log, 0.5, [f"{DRIVE}.timeout=0.1"], tmp_path / "alone.mcap")
    assert "there is no rosbridge" in (alone.summary.failure or "")
    assert alone.summary.simulated_time == 0.5


def test_a_branch_continues_with_the_node(peer: str, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    ran(peer, log)
    one = sa.branch(log, 0.5, ["agents.robot[0].state=[1, -1, 0]"], tmp_path / "one.mcap")
    many = sa.branches(log, 0.5, [["agents.robot[0].state=[1, -1, 0]"]], tmp_path / "many", "capture")
    assert one.summary.status == "finished"
    assert [each.way for each in many] == ["capture"]
    assert sa.compare(tmp_path / "one.mcap", tmp_path / "many" / "0.mcap").is_equal
    assert sa.verify_log(tmp_path / "one.mcap").is_equal


def test_stamped_commands_answer_the_turn_of_their_stamp(peer: str, faulty: str, tmp_path: Path) -> None:
    ran(peer, tmp_path / "sound.mcap", stamped=True, settle=0.01)
    ran(f"{faulty}stale", tmp_path / "stale.mcap", stamped=True)
    sound, stale = (sa.open_log(tmp_path / f"{name}.mcap") for name in ("sound", "stale"))
    assert sound.inputs == stale.inputs
    assert len(sound.inputs) == 20


def test_a_holonomic_body_gets_the_linear_velocity(peer: str, tmp_path: Path) -> None:
    changes = {"agents.robot.model": {"use": "single-integrator"}, "agents.robot.state": [[0, -1], [0, 1]]}
    ran(peer, tmp_path / "run.mcap", **changes)
    assert np.ptp(sa.open_log(tmp_path / "run.mcap").series("robot.0", "world").values[:, 0]) > 0.5


FAULTS = {
    "silent": "no command on /robot_0/cmd_vel, /robot_1/cmd_vel within 0.5 s",
    "closing": "has closed the connection",
    "garbled": "sent a frame that violates its protocol",
    "nested": "sent a frame that violates its protocol",
    "binary": "sent a frame that violates its protocol",
    "huge": "sent a frame of more than 1,048,576 bytes",
    "error": "reports an error: no such type",
    "nan": "its linear.x is no finite number: nan",
    "null": "its linear.x is no finite number: None",
    "text": "it has no linear.x",
    "large": "its linear.x is no finite number",
    "flood": "commands on /robot_0/cmd_vel wait for their turns",
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_of_the_other_process_ends_the_run_with_its_log_finished(
    kind: str, faulty: str, tmp_path: Path
) -> None:
    log = tmp_path / "run.mcap"
    result = ran(f"{faulty}{kind}", log, **({"timeout": 0.5} if kind == "silent" else {}))
    assert result.status == "failed"
    read = sa.open_log(log)
    assert read.outcome is not None
    assert read.outcome["status"] == "failed"
    failed = next(event for event in read.events() if event.name == "failed")
    assert FAULTS[kind] in failed.text
    assert failed.source == "agents.robot.drive"
    assert sa.verify_log(log).is_equal


def test_a_process_that_dies_ends_the_run(tmp_path: Path) -> None:
    with listening(str(HERE / "ros_peers.py")) as url:
        result = ran(f"{url}/dead", tmp_path / "run.mcap")
    assert "has closed the connection" in result.failure
    assert sa.verify_log(tmp_path / "run.mcap").is_equal


def test_a_stamp_from_the_future_is_refused(faulty: str, tmp_path: Path) -> None:
    result = ran(f"{faulty}early", tmp_path / "run.mcap", stamped=True)
    assert "is stamped 1000 s, after the time that was published" in result.failure


def test_the_agents_continue_if_the_scenario_says_so(faulty: str, tmp_path: Path) -> None:
    changes = {"agents.robot.components.drive.on_failure": "isolate"}
    result = ran(f"{faulty}closing", tmp_path / "run.mcap", **changes)
    assert result.status == "finished"
    assert sa.verify_log(tmp_path / "run.mcap").is_equal


def test_without_lock_step_the_latest_command_counts(peer: str, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    changes = {"run.pace": 2.0}
    result = ran(peer, log, lock_step=False, **changes)
    assert result.status == "finished"
    answers = [answer[0]["answer"] for answer in sa.open_log(log).inputs.values()]
    assert len(answers) == 20
    assert any(answers), "some have come"
    assert sa.verify_log(log).is_equal


def test_without_lock_step_a_silent_node_ends_the_run(faulty: str, tmp_path: Path) -> None:
    changes = {"run.pace": 1.0}
    result = ran(f"{faulty}silent", tmp_path / "run.mcap", lock_step=False, timeout=0.3, **changes)
    assert "wall time (`timeout`)" in result.failure


def test_a_connected_run_is_not_captured(peer: str) -> None:
    scenario = sa.load(SCENARIO, {f"{DRIVE}.url": peer})
    with scenario.start() as simulation:
        simulation.step()
        with pytest.raises(sa.StateError, match=r"agents\.robot\.drive.*nodes of ROS are connected"):
            simulation.capture()


def test_an_absent_agent_gets_no_command(peer: str, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    ran(peer, log, **{"agents.robot.present": [{}, {"from": 0.5}]})
    answers = [list(answer[0]["answer"]) for answer in sa.open_log(log).inputs.values()]
    assert answers == [["robot.0"]] * 10 + [["robot.0", "robot.1"]] * 10


def test_a_stopped_agent_needs_no_command(peer: str, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    ran(peer, log, **{"faults.dead": {"at": 0.5, "stop": "robot.0"}})
    answers = [list(answer[0]["answer"]) for answer in sa.open_log(log).inputs.values()]
    assert answers == [["robot.0", "robot.1"]] * 10 + [["robot.1"]] * 10
    assert sa.verify_log(log).is_equal


def test_a_signal_ends_a_run_that_waits(faulty: str, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    line = [sys.executable, "-m", "symaware_cli", "run", str(SCENARIO), "--output", str(log), "--json"]
    process = subprocess.Popen([*line, "--set", f"{DRIVE}.url={faulty}silent", "--set", f"{DRIVE}.timeout=60"])
    while not (log.exists() and process.poll() is None and b"/inputs" in log.read_bytes()):
        time.sleep(0.05)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == 130
    assert (sa.open_log(log).outcome or {})["status"] == "interrupted"
