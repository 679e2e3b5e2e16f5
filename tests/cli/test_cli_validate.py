"""`symaware validate`."""

import hashlib
import json
import os
from pathlib import Path

import pytest
from simulating import Command

from symaware_cli import open_log


def test_a_sound_scenario_is_reported_in_one_line(command: Command, scenarios: Path, tmp_path: Path) -> None:
    done = command("validate", scenarios / "hello.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{scenarios / 'hello.yaml'}: sound; 4 agents in 1 group, 240 steps\n"
    as_json = json.loads(command("validate", scenarios / "hello.yaml", "--json").stdout)
    # The digest is what processes that share the run compare, and that of the document in the log.
    assert command("run", scenarios / "hello.yaml", "--set", "run.duration=1", "-o", "hello.mcap").returncode == 0
    resolved = open_log(tmp_path / "hello.mcap").attachments["resolved.yaml"]
    short = json.loads(command("validate", scenarios / "hello.yaml", "--json", "--set", "run.duration=1").stdout)
    assert short["digest"] == hashlib.sha256(resolved).hexdigest() != as_json.pop("digest")
    (tmp_path / "hello.mcap").unlink()
    assert as_json == {"valid": True, "problems": [], "warnings": [], "name": "hello", "agents": 4, "steps": 240}
    assert os.listdir(tmp_path) == []


def test_every_problem_is_located_in_words_and_for_tools(command: Command, tmp_path: Path) -> None:
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


def test_values_may_be_changed_before_they_are_checked(command: Command, scenarios: Path) -> None:
    done = command("validate", scenarios / "hello.yaml", "--set", "agents.robot.count=9", "--seed", "3")
    assert done.returncode == 0
    assert "9 agents" in done.stdout
    assert command("validate", scenarios / "hello.yaml", "--set", "agents.robto.count=9").returncode == 2


@pytest.mark.slow
def test_a_hundred_thousand_agents_can_be_validated(command: Command, scenarios: Path) -> None:
    done = command("validate", scenarios / "hello.yaml", "--set", "agents.robot.count=100000")
    assert done.returncode == 0, done.stderr
    assert "100,000 agents" in done.stdout


def test_a_warning_leaves_the_exit_status_alone(command: Command, tmp_path: Path) -> None:
    (tmp_path / "open.yaml").write_text(
        """symaware: 1
name: open
run: {duration: 1}
environment: {use: kinematic, entities: {pillar: {shape: {circle: {radius: 0.3}}, position: [2, 0]}}}
agents:
  robot: {model: {use: unicycle}}
"""
    )
    done = command("validate", "open.yaml")
    assert done.returncode == 0
    assert done.stdout.startswith("open.yaml: sound; 1 agent in 1 group")
    assert "open.yaml:6:3: `robot` has no body, so it passes through `pillar` without a contact" in done.stderr
    assert "1 warning in open.yaml" in done.stderr
    (warning,) = json.loads(command("validate", "open.yaml", "--json").stdout)["warnings"]
    assert (warning["code"], warning["path"]) == ("no-body", "agents.robot")
