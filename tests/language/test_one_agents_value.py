"""A value of one agent of a group is set in brackets; the others keep theirs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import symaware_cli as sa
from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "few",
    "seed": 5,
    "run": {"duration": 0.2},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 3,
            "model": {"use": "single-integrator"},
            "components": {"steer": {"use": "control.go-to-goal"}, "see": {"use": "perception.self"}},
        }
    },
}

#: Every way in which the values of a group are given.
GIVEN: dict[str, Any] = {
    "one for all": [4, 5],
    "a list for each": [[4, 5], [6, 7], [8, 9]],
    "a list named as such": {"each": [[4, 5], [6, 7], [8, 9]]},
    "a distribution": {"uniform": [[-9, -9], [9, 9]]},
    "elements that are drawn": [{"normal": [0, 2]}, 3],
    "distributions for each": [[{"uniform": [0, 1]}, 0], [{"uniform": [0, 2]}, 0], [1, {"normal": [0, 1]}]],
    "a placement": {"circle": {"radius": 4}},
}


def values(folder: Path, given: Any, kind: str, *changes: str) -> np.ndarray[Any, Any]:
    """The initial states, or goals, of all agents; shape (3, 2)."""
    entry = {**SCENARIO["agents"]["robot"], "knowledge": {"goal": [0, 0]}}
    if kind == "state":
        entry["state"] = given
    else:
        entry["knowledge"] = {"goal": given}
    (folder / "s.yaml").write_text(yaml.safe_dump({**SCENARIO, "agents": {"robot": entry}}))
    (group,) = build(folder / "s.yaml", changes).simulation.groups
    if kind == "state":
        return np.array(group.awareness.state)
    return np.array([known["goal"] for known in group.knowledge])


@pytest.mark.parametrize("given", GIVEN)
@pytest.mark.parametrize(("kind", "path"), [("state", "state"), ("knowledge", "knowledge.goal")])
def test_one_agents_value_is_set_and_the_others_keep_theirs(given: str, kind: str, path: str, tmp_path: Path) -> None:
    before = values(tmp_path, GIVEN[given], kind)
    after = values(tmp_path, GIVEN[given], kind, f"agents.robot[1].{path}=[1.5, 2.5]")
    assert after[1].tolist() == [1.5, 2.5]
    assert np.array_equal(np.delete(after, 1, 0), np.delete(before, 1, 0))
    both = values(
        tmp_path, GIVEN[given], kind, f"agents.robot[1].{path}=[1.5, 2.5]", f"agents.robot[2].{path}=[3.5, 0]"
    )
    assert both[1:].tolist() == [[1.5, 2.5], [3.5, 0]]
    assert np.array_equal(both[0], before[0])


@pytest.mark.parametrize("given", ["one for all", "a list for each", "a list named as such"])
def test_one_element_of_one_agents_value_is_set(given: str, tmp_path: Path) -> None:
    before = values(tmp_path, GIVEN[given], "knowledge")
    after = values(tmp_path, GIVEN[given], "knowledge", "agents.robot[2].knowledge.goal[1]=7.25")
    before[2, 1] = 7.25
    assert np.array_equal(after, before)


def test_an_element_of_the_value_of_all_is_set(tmp_path: Path) -> None:
    after = values(tmp_path, [4, 5], "knowledge", "agents.robot.knowledge.goal[1]=7.25")
    assert after.tolist() == [[4, 7.25]] * 3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("agents.robot[1].components.steer.period=2", r"is one for all agents of `robot`"),
        ("agents.robot[1].model.with.max_speed=2", r"is one for all agents of `robot`"),
        ("agents.robot[3].state=[0, 0]", r"`robot` has no agent 3"),
        ("agents.robot.1.state=[0, 0]", r"named in brackets"),
        ("agents.robot[1].knowledge.goal[0]=2", r"`agents.robot\[1\].knowledge.goal` is not a list"),
    ],
)
def test_an_assignment_for_one_agent_is_refused_with_the_possible_ones(change: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=said) as caught:
        values(tmp_path, {"uniform": [0, 1]}, "knowledge", change)
    (problem,) = caught.value.problems
    assert problem.span is not None
    assert problem.span.file == f"--set {change}"
    if "one for all" in said:
        assert "agents.robot[1].knowledge.NAME" in str(problem.expected)


def test_the_log_of_such_a_run_repeats_and_sweeps_and_python_use_the_same_notation(tmp_path: Path) -> None:
    values(tmp_path, {"uniform": [-9, 9]}, "state")
    changes = {"agents.robot[1].state": [1.5, 2.5], "agents.robot.knowledge.goal[0]": 4}
    result = sa.load(tmp_path / "s.yaml", changes).run(output=tmp_path / "s.mcap")
    assert result.log_path is not None
    assert sa.verify_log(str(tmp_path / "s.mcap")).is_equal
    made = sa.sweep(
        tmp_path / "s.yaml", output=tmp_path / "out", over={"agents.robot[1].knowledge.goal[0]": [1, 2]}, jobs=0
    )
    assert made is not None
    assert sa.verify_sweep(str(tmp_path / "out"), "all").is_sound
