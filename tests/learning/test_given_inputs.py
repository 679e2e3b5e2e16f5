from __future__ import annotations

from pathlib import Path

import pytest
from learning_scenarios import HEAD_ON

import symaware_cli as sa
from symaware_cli.learning.given_inputs import GivenInputs, InputFileError

FIRST = "# SymAware actions 1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is no file of actions"),
        ("step,agent\n", "is no file of actions"),
        (FIRST + "x,robot.0,1,2\n", "line 2: not a step"),
        (FIRST + "0,robot.0\n", "line 2: not a step"),
        (FIRST + "0,robot.0,1,nan\n", "line 2: a control input is not a finite number"),
        (FIRST + "0,robot.0,1,1e999\n", "line 2: a control input is not a finite number"),
        (FIRST + "1,robot.0,1,2\n0,robot.1,1,2\n", "line 3: step 0 follows step 1"),
        (FIRST + "0,robot.0,1,2\n0,robot.0,1,2\n", "line 3: a second line for `robot.0` at step 0"),
        (FIRST + "0,roböt.0,1,2\n", "is no file of actions"),
    ],
)
def test_a_damaged_file_is_refused_at_its_line(text: str, said: str) -> None:
    with pytest.raises(InputFileError, match=said):
        GivenInputs("a.csv", text.encode())


def test_a_file_outside_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "a.csv").write_text(FIRST, encoding="utf-8")
    (tmp_path / "inner" / "a.csv").symlink_to(tmp_path / "a.csv")
    with pytest.raises(InputFileError, match="leads out of the scenario's folder"):
        GivenInputs.read(tmp_path / "inner", "a.csv")


@pytest.mark.parametrize(
    ("line", "said"),
    [("0,robot.9,1,2", "line 2: there is no agent `robot.9`"), ("0,robot.0,1", "line 2: 1 numbers for the 2 control")],
)
def test_actions_that_do_not_fit_the_scenario_are_located(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "head-on.yaml").write_bytes(HEAD_ON.read_bytes())
    (tmp_path / "a.csv").write_text(f"{FIRST}{line}\n", encoding="utf-8")
    with pytest.raises(sa.ScenarioError, match=said):
        sa.load(tmp_path / "head-on.yaml", {"learning": {"agents": "robot", "inputs": "a.csv"}})


def test_given_inputs_replace_those_that_components_request_at_their_steps(tmp_path: Path) -> None:
    (tmp_path / "head-on.yaml").write_bytes(HEAD_ON.read_bytes())
    (tmp_path / "a.csv").write_text(f"{FIRST}1,robot.2,0.25,-0.5\n", encoding="utf-8")
    scenario = sa.load(tmp_path / "head-on.yaml", {"learning": {"agents": "robot", "inputs": "a.csv"}})
    run = scenario.run(duration=0.2, output=tmp_path / "run.mcap")
    inputs = run.series("robot", "requested_control").values[:, 2]
    assert inputs[1].tolist() == [0.25, -0.5]
    assert inputs[[0, 2], 0] == pytest.approx([1.2, 1.2], abs=1e-3)
    assert sa.verify_log(tmp_path / "run.mcap").is_equal


def test_a_scenario_with_given_inputs_is_no_environment(tmp_path: Path) -> None:
    (tmp_path / "head-on.yaml").write_bytes(HEAD_ON.read_bytes())
    (tmp_path / "a.csv").write_text(f"{FIRST}1,robot.2,0.25,-0.5\n", encoding="utf-8")
    with pytest.raises(sa.LearningError, match="repeats an episode"):
        sa.env(tmp_path / "head-on.yaml", agents="robot", changes={"learning.inputs": "a.csv"})
