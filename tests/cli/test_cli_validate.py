"""`symaware validate`."""

import json
import os
import subprocess
import sys
import time

import pytest
from simulating import COMMAND


def test_a_sound_scenario_is_told_in_one_line(command, scenarios, tmp_path):
    done = command("validate", scenarios / "hello.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{scenarios / 'hello.yaml'}: sound; 4 agents in 1 group, 240 steps\n"
    as_json = json.loads(command("validate", scenarios / "hello.yaml", "--json").stdout)
    assert as_json == {"valid": True, "problems": [], "name": "hello", "agents": 4, "steps": 240}
    assert os.listdir(tmp_path) == []


def test_every_problem_is_located_in_words_and_for_tools(command, tmp_path):
    (tmp_path / "bad.yaml").write_text(
        """symaware: 1
name: bad
run: {duration: -1}
environment: {use: kinematic}
agents:
  robot: {model: {use: unicicle}}
"""
    )
    done = command("validate", "bad.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert "bad.yaml:3:17" in done.stderr
    assert "bad.yaml:6:24" in done.stderr
    assert "unicycle" in done.stderr
    assert "2 problems in bad.yaml" in done.stderr
    as_json = command("validate", "bad.yaml", "--json")
    assert (as_json.returncode, as_json.stderr) == (2, "")
    report = json.loads(as_json.stdout)
    assert report["valid"] is False
    assert len(report["problems"]) == 2


def test_values_may_be_changed_before_they_are_checked(command, scenarios):
    done = command("validate", scenarios / "hello.yaml", "--set", "agents.robot.count=9", "--seed", "3")
    assert done.returncode == 0
    assert "9 agents" in done.stdout
    assert command("validate", scenarios / "hello.yaml", "--set", "agents.robto.count=9").returncode == 2


def cpu_time(line, repetitions=5):
    """The least CPU time of several runs of a command, user and system [s]."""
    best = float("inf")
    for _ in range(repetitions):
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0
        best = min(best, usage.ru_utime + usage.ru_stime)
    return best


@pytest.mark.slow
def test_validating_costs_at_most_five_times_what_importing_numpy_does(scenarios):
    # About 0.4 s of CPU time on a machine where NumPy takes a tenth.
    measure = cpu_time([sys.executable, "-c", "import numpy"])
    spent = cpu_time([*COMMAND, "validate", str(scenarios / "hello.yaml")])
    print(f"validate hello.yaml: {spent:.3f} s of CPU time, import numpy: {measure:.3f} s")
    assert spent <= 5 * measure


def test_validating_costs_a_bounded_multiple_of_starting_python(scenarios):
    # Half a second where python takes its usual 10 ms; twice as much again is what a loaded machine may add.
    assert cpu_time([*COMMAND, "validate", str(scenarios / "hello.yaml")], 3) <= 100 * cpu_time(
        [sys.executable, "-c", "pass"], 5
    )


@pytest.mark.slow
def test_validating_a_hundred_thousand_agents_takes_seconds_not_minutes(command, scenarios):
    started = time.monotonic()
    done = command("validate", scenarios / "hello.yaml", "--set", "agents.robot.count=100000")
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - started < 60
