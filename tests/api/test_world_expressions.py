"""Expressions about the world: names in brackets are looked up, bodies have places, and absence has one meaning."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import ScenarioError, check_log, load
from symaware_cli.evidence.log_evaluation import evaluate_log

LATE = {
    "symaware": 1,
    "name": "late",
    "run": {"duration": 1.0},
    "environment": {
        "use": "kinematic",
        "with": {"time_step": 0.1},
        "entities": {
            "post": {"shape": {"circle": {"radius": 0.1}}, "position": [4.0, 3.0]},
            "cart": {
                "shape": {"circle": {"radius": 0.1}},
                "path": {"times": [0.0, 8.0], "positions": [[0, 5], [8, 5]]},
            },
        },
    },
    "regions": {"wall": {"box": [-1, 1, -1, 1]}},
    "agents": {
        "early": {"model": {"use": "single-integrator"}, "state": [3.0, 0.0]},
        "robot": {
            "count": 2,
            "model": {"use": "single-integrator", "with": {"max_speed": 1.0}},
            "state": [[0.0, 0.0], [0.5, 0.0]],
            "knowledge": {"goal": [0.3, 0.0]},
            "present": {"from": 0.5},
            "components": {"see": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
        },
    },
}


def scenario(folder: Path, **changes: Any) -> Path:
    path = folder / "late.yaml"
    path.write_text(yaml.safe_dump({**LATE, **changes}, sort_keys=False))
    return path


@pytest.mark.parametrize(
    ("text", "said", "nearest"),
    [
        ('position["robt.0"][0] > 7', "there is no agent, group or entity `robt.0`", "robot.0"),
        ("state.erly[0] > 7", "there is no agent, group or entity `erly`", "early"),
        ('position["pst"][0] > 7', "there is no agent, group or entity `pst`", "post"),
        ('present["robot.7"]', "there is no agent or group `robot.7`", "robot.1"),
        ('violated["saef"]', "there is no specification `saef`", "safe"),
        ("position[0] > 7", "`position` takes a name in quotes", None),
        ("position > 7", "say whose: position[", None),
        ("violated", "say whose: violated[", None),
    ],
)
@pytest.mark.parametrize("place", ["until", "specification", "presence"])
def test_names_in_brackets_are_looked_up(tmp_path: Path, place: str, text: str, said: str, nearest: str) -> None:
    changes: dict[str, Any] = {"specifications": {"safe": {"formula": "always contacts == 0"}}}
    if place == "until":
        changes["run"] = {"duration": 1.0, "until": text}
    elif place == "specification":
        changes["specifications"]["other"] = {"formula": f"eventually ({text})"}
    else:
        agents: Mapping[str, Any] = LATE["agents"]  # type: ignore[assignment]
        changes["agents"] = {**agents, "robot": {**agents["robot"], "present": {"from": text}}}
    path = scenario(tmp_path, **changes)
    with pytest.raises(ScenarioError) as caught:
        load(path)
    (problem,) = caught.value.problems
    assert said in problem.message
    if nearest is not None:
        assert problem.suggestion == nearest
    span, line = problem.span, problem.source_line
    assert span is not None
    assert line is not None
    wrong = said.partition("`")[2].partition("`")[0] if nearest else "0" if "[0] > 7" in text else text[:5]
    assert line[span.column - 1 :].startswith(wrong)


#: Conditions at 0 s, when nobody of `robot` is there, and their values.
ABSENT = {
    'position["robot.0"][0] < 9': False,
    'position["robot.0"][0] > -9': False,
    'position["robot.0"] != position["early"]': False,
    'not (position["robot.0"][0] < 9)': True,
    'position["robot.0"][0] > 9 implies contacts > 5': True,
    'distance(position["robot.0"], position["early"]) > 1': False,
    'inside(position["robot.0"], wall)': False,
    'not inside(position["robot.0"], wall)': True,
    'present["robot.0"]': False,
    'any(present["robot"])': False,
    'present["early"]': True,
    'all(position["robot"] > 5)': True,
    'any(position["robot"] < 5)': False,
    'max(position["robot"]) < -5': True,
    'min(position["robot"]) > 5': True,
    'position["robot"][0][0] < 9': False,
    'count(present["robot"]) == 0': True,
    "all(goals_reached)": False,
    "count(goals_reached) == 0": True,
    "agents == 1": True,
    'position["post"][1] == 3': True,
    'state["cart"][0] < 0.01': True,
}


def test_what_is_about_an_absent_agent_does_not_hold_in_any_place(tmp_path: Path) -> None:
    specifications = {f"s{number}": {"formula": text} for number, text in enumerate(ABSENT)}
    path = scenario(tmp_path, specifications=specifications)
    result = load(path).run(output=tmp_path / "late.mcap")
    wanted = ["satisfied" if holds else "violated" for holds in ABSENT.values()]
    for outcomes in (result.summary.specifications, check_log(tmp_path / "late.mcap").specifications):
        assert [each.verdict for each in outcomes] == wanted
    evaluated = evaluate_log(tmp_path / "late.mcap")
    assert not evaluated.left_out
    assert [each.verdict for each in evaluated.specifications] == wanted
    for text, holds in ABSENT.items():
        ended = load(path, {"run.until": f"time < 0.05 and ({text})", "specifications": None}).run(record=False)
        assert (ended.summary.steps == 0) == holds, text


def test_a_run_goes_on_until_those_who_enter_later_have_reached_their_goals(tmp_path: Path) -> None:
    path = scenario(tmp_path, run={"duration": 5.0, "until": "all(goals_reached)"})
    result = load(path).run(record=False)
    assert result.status == "finished"
    assert 5 < result.summary.steps < 50


def test_nearest_neighbours_are_among_those_present(tmp_path: Path) -> None:
    result = load(scenario(tmp_path, topology={"use": "k-nearest", "with": {"count": 2}})).run(record=False)
    assert result.status == "finished"


@pytest.mark.parametrize("interval", [0.0, 0.2])
def test_the_places_of_entities_are_those_of_the_run_in_its_log(tmp_path: Path, interval: float) -> None:
    specifications = {
        "there": {"formula": 'eventually position["cart"][0] > 0.7'},
        "near": {"formula": 'always distance(position["cart"], position["post"]) > 3'},
    }
    path = scenario(tmp_path, specifications=specifications, recording={"interval": interval})
    told = load(path).run(output=tmp_path / "log.mcap").summary.specifications
    found = check_log(tmp_path / "log.mcap").specifications
    assert [each.verdict for each in told] == [each.verdict for each in found] == ["satisfied", "satisfied"]
    if not interval:
        assert [each.robustness for each in told] == [each.robustness for each in found]
        assert [each.robustness for each in evaluate_log(tmp_path / "log.mcap").specifications] == [
            each.robustness for each in told
        ]


def test_a_specification_that_cannot_be_satisfied_is_a_warning_with_its_place(tmp_path: Path) -> None:
    specifications = {
        "never": {"each": "early", "formula": "always next x > 0"},
        "long": {"each": "early", "formula": "always[0, 5] x > 0"},
        "fine": {"each": "early", "formula": "always weak next x > 0"},
    }
    found = load(scenario(tmp_path, specifications=specifications)).validate().warnings
    warnings = [each for each in found if each.code == "unsatisfiable"]
    assert [each.path for each in warnings] == ["specifications.never.formula", "specifications.long.formula"]
    assert "weak next" in (warnings[0].expected or "")
    assert "5 s ahead" in (warnings[1].expected or "")


def test_a_distance_without_pairs_says_how_to_get_them(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(scenario(tmp_path, specifications={"apart": {"each": "robot", "formula": "always distance > 1"}}))
    assert "give the specification `pairs` instead of `each`" in caught.value.problems[0].message
    load(scenario(tmp_path, specifications={"apart": {"pairs": "robot", "formula": "always distance > 1"}}))
