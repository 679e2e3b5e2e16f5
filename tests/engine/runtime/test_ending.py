"""How runs end: at their duration, when a condition holds, or when their time is over."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from simulating import COMMAND, Command, Team, execute, present, simulate, simulation

from symaware_cli import Component, Log, open_log
from symaware_cli.api.scenario import Mode
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.engine.runtime.scope import WORLD_NAMES
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute as execute_built
from symaware_cli.specification.expression import Expression

MODES = pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])


def until(text: str) -> Expression:
    return Expression(text, WORLD_NAMES)


@pytest.fixture
def ran(tmp_path: Path) -> Callable[..., tuple[RunSummary, Log]]:
    """Run two robots to their goals, one of which is nearer, until something holds."""

    def run(text: str, mode: Mode = "synchronous", duration: float = 10.0) -> tuple[RunSummary, Log]:
        document = {
            "symaware": 1,
            "name": "until",
            "run": {"mode": mode, "duration": duration, "until": text},
            "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
            "agents": {
                "robot": {
                    "count": 2,
                    "model": {"use": "single-integrator"},
                    "state": [[0, 0], [0, 1]],
                    "knowledge": {"goal": [[2, 0], [4, 1]]},
                    "components": {
                        "see": {"use": "perception.omniscient"},
                        "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0, "tolerance": 0.1}},
                    },
                },
                "rock": {"model": {"use": "single-integrator"}, "state": [9, 9]},
            },
        }
        (tmp_path / "until.yaml").write_text(yaml.safe_dump(document))
        summary = execute_built(build(tmp_path / "until.yaml"), tmp_path / "until.mcap")
        return summary, open_log(tmp_path / "until.mcap")

    return run


@MODES
@pytest.mark.parametrize(
    ("text", "least", "most"),
    [
        ("any(goals_reached)", 1.9, 3.6),
        ("all(goals_reached)", 3.8, 5.5),
        ("time >= 2", 2.0, 2.0),
        ('position["robot.1"][0] > 1.49', 1.5, 1.5),
        ('distance(position["robot.0"], position["rock"]) < 12', 0.8, 1.5),
        ("min_separation > 1.5", 2.0, 4.0),
        ("count(goals_reached) == 1 and agents == 3", 1.9, 3.6),
    ],
)
def test_a_run_ends_with_the_first_step_after_whose_turns_the_condition_holds(
    text: str, least: float, most: float, mode: Mode, ran: Callable[..., tuple[RunSummary, Log]]
) -> None:
    summary, log = ran(text, mode)
    assert summary.status == "finished"
    assert least - 1e-9 <= summary.simulated_time <= most + 1e-9
    assert log.outcome == {
        "status": "finished",
        "steps": summary.steps,
        "time": round(summary.simulated_time * 1e9),
        "specifications": [],
    }
    last = list(log.events())[-1]
    assert last.name == "finished"
    assert text in last.text
    assert log.series("robot", "world").times[-1] == last.time


def test_a_condition_that_never_holds_lets_the_run_go_to_its_end_and_says_so(
    ran: Callable[..., tuple[RunSummary, Log]],
) -> None:
    summary, log = ran("contacts > 3", duration=1.0)
    assert (summary.status, summary.steps) == ("finished", 20)
    assert list(log.events())[-1].text == "20 steps made; never contacts > 3"


def test_a_condition_without_a_value_is_a_failure_of_the_run(ran: Callable[..., tuple[RunSummary, Log]]) -> None:
    summary, _ = ran('position["robot.1"][7] > 1')
    assert summary.status == "failed"
    assert "run.until" in present(summary.failure)
    assert "there is no element 7 in a vector of 2" in present(summary.failure)


class Dawdles(Component):
    def _compute(self) -> None:
        time.sleep(0.02)

    def _update(self, value: Any) -> None:
        pass


@MODES
def test_a_run_whose_time_is_over_is_interrupted_with_its_log_finished(mode: Mode, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    summary = simulate({"a": Team({"it": Dawdles})}, 10**6, log, RunOptions(mode=mode, timeout=0.3))
    assert summary.status == "interrupted"
    assert 0.3 <= summary.wall_time < 30
    recorded = open_log(log)
    assert recorded.verify() is None
    assert list(recorded.events())[-1].text == "ended by the time-out of 0.3 s"


@MODES
def test_a_component_that_sleeps_or_waits_for_ever_is_interrupted_by_a_time_out(mode: Mode, tmp_path: Path) -> None:
    class Hangs(Component):
        def _compute(self) -> None:
            time.sleep(1000)

        def _update(self, value: Any) -> None:
            pass

    summary = simulate({"a": Team({"it": Hangs})}, 5, tmp_path / "run.mcap", RunOptions(mode=mode, timeout=0.2))
    assert summary.status == "interrupted"


def test_alarms_of_the_process_are_left_as_they_were() -> None:
    before = signal.getsignal(signal.SIGALRM)
    execute(simulation({"a": Team()}), 3, options=RunOptions(timeout=100.0, turn_limit=100.0))
    assert signal.getsignal(signal.SIGALRM) == before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


SCENARIO = """
symaware: 1
name: long
run: {mode: asynchronous, duration: 1000000.0}
environment: {use: kinematic}
agents:
  robot:
    count: 3
    model: {use: single-integrator}
    components:
      see: {use: perception.omniscient}
      progress: {use: doubles.progress, period: 0.01}
      MORE
"""


def test_the_command_has_a_time_out(
    doubles: Path, process: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PROGRESS", str(tmp_path / "progress"))
    (tmp_path / "long.yaml").write_text(SCENARIO.replace("MORE", ""))
    done = process("run", "long.yaml", "--timeout", "0.5")
    assert done.returncode == 130
    assert "long: interrupted after" in done.stdout
    assert present(open_log(tmp_path / "long.mcap").outcome)["status"] == "interrupted"


@pytest.mark.parametrize("more", ["", "endless: {use: doubles.endless}", "stubborn: {use: doubles.stubborn}"])
def test_a_signal_ends_an_asynchronous_run_wherever_it_is(
    more: str, doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from symaware_doubles import Progress

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PROGRESS", str(tmp_path / "progress"))
    (tmp_path / "long.yaml").write_text(SCENARIO.replace("MORE", more))
    process = subprocess.Popen([*COMMAND, "run", "long.yaml", "--quiet"], stderr=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + 60
        while len(Progress.read(tmp_path / "progress")) < 2:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end
            time.sleep(0.01)
        os.kill(process.pid, signal.SIGTERM)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130
    assert "Traceback" not in errors
    log = open_log(tmp_path / "long.mcap")
    assert log.verify() is None
    assert list(log.events())[-1].text == "ended by SIGTERM"
