"""External inputs of a run are in its log, and a repetition takes them from there."""

from pathlib import Path

import pytest

from symaware_cli import BranchError, branch, branches, compare, open_log, verify_log
from symaware_cli.evidence import explain
from symaware_cli.language import open_scenario
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log import INPUTS, overview_of

SCENARIO = """\
symaware: 1
name: outside
run: {duration: 1.0}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    count: 2
    model: {use: unicycle}
    state: [[0, 0, 0], [0, 3, 0]]
    components:
      sense: {use: perception.omniscient}
      drive: {use: doubles.outsider}
specifications:
  slow: {each: robot, formula: "always position[0] < 0.2"}
"""


@pytest.fixture
def scenario(tmp_path: Path, doubles: Path) -> Path:
    path = tmp_path / "outside.yaml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture
def log(scenario: Path) -> Path:
    path = scenario.with_name("run.mcap")
    execute(build(scenario), path)
    return path


def reading(file: Path, scenario: Path) -> Path:
    """Run a scenario whose agents read their speeds from a file."""
    path = scenario.with_name("reading.mcap")
    execute(build(scenario, [f"agents.robot.components.drive.with.file={file}"]), path)
    return path


def test_two_runs_differ_and_each_is_verified(scenario: Path, log: Path, tmp_path: Path) -> None:
    execute(build(scenario), tmp_path / "other.mcap")
    assert not compare(log, tmp_path / "other.mcap").is_equal
    for path in (log, tmp_path / "other.mcap"):
        result = verify_log(path)
        assert result.is_equal
        assert result.is_whole


def test_inputs_are_recorded_even_if_all_else_is_left_out(scenario: Path, tmp_path: Path) -> None:
    path = tmp_path / "sparse.mcap"
    sparse = "recording={events: none, messages: none, interval: 0.5, omit: [control, state, world]}"
    execute(build(scenario, [sparse]), path)
    assert sum(map(len, open_log(path).inputs.values())) == 20
    assert overview_of(open_log(path)).events == {"finished": 1}
    assert verify_log(path).is_equal


def test_a_run_without_inputs_has_no_channel_for_them(scenario: Path, tmp_path: Path) -> None:
    execute(build(scenario, ["agents.robot.components.drive=null"]), tmp_path / "plain.mcap")
    assert INPUTS not in open_log(tmp_path / "plain.mcap").channels


def test_a_branch_asks_again_from_its_instant_on(scenario: Path, tmp_path: Path) -> None:
    speed = tmp_path / "speed"
    speed.write_text("1.0")
    path = reading(speed, scenario)
    speed.write_text("0.25")
    assert branch(path, 0.5, output=tmp_path / "same.mcap").changes == ()
    assert compare(path, tmp_path / "same.mcap").is_equal
    branch(path, 0.5, ["agents.robot[1].state=[0, 3, 0]"], tmp_path / "other.mcap")
    speeds = [answers[0]["answer"]["speed"] for (_, time), answers in open_log(tmp_path / "other.mcap").inputs.items()]
    assert speeds == [1.0] * 10 + [0.25] * 10
    speed.unlink()
    assert verify_log(tmp_path / "other.mcap").is_equal


def test_branches_from_a_captured_state_ask_again_too(scenario: Path, tmp_path: Path) -> None:
    speed = tmp_path / "speed"
    speed.write_text("1.0")
    path = reading(speed, scenario)
    speed.write_text("0.25")
    change = ["agents.robot[1].state=[0, 3, 0]"]
    results = branches(path, 0.5, [change], tmp_path / "many", "capture")
    branch(path, 0.5, change, tmp_path / "one.mcap")
    assert [each.way for each in results] == ["capture"]
    assert compare(tmp_path / "many" / "0.mcap", tmp_path / "one.mcap").is_equal


def test_a_log_run_again_is_repeated_unless_something_is_changed(log: Path, tmp_path: Path) -> None:
    execute(open_scenario(log), tmp_path / "again.mcap")
    assert compare(log, tmp_path / "again.mcap").is_equal
    execute(open_scenario(log, ["run.duration=0.5"]), tmp_path / "changed.mcap")
    assert not open_log(tmp_path / "changed.mcap").inputs.items() <= open_log(log).inputs.items()


def test_a_failure_to_ask_ends_the_run_and_is_verified(scenario: Path, tmp_path: Path) -> None:
    speed = tmp_path / "speed"
    speed.write_text("fast")
    path = reading(speed, scenario)
    failed = next(event for event in open_log(path).events() if event.name == "failed")
    assert "could not convert string to float: 'fast'" in failed.text
    assert failed.source == "agents.robot.0.drive"
    speed.write_text("1.0")
    assert verify_log(path).is_equal


def test_a_component_in_a_separate_process_has_no_inputs(scenario: Path, tmp_path: Path) -> None:
    summary = execute(build(scenario, ["agents.robot.components.drive.run_in=process"]), tmp_path / "run.mcap")
    assert "has no inputs from outside" in (summary.failure or "")


def test_inputs_of_other_futures_are_not_guessed(log: Path) -> None:
    with pytest.raises(BranchError, match="which other futures do not have"):
        explain(log, "slow")
