"""What is planted is found, made simple, and can be run; what is not there is not found, and it is said how hard."""

import json
import statistics
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from sweeping import symaware

import symaware_cli as sa
from symaware_cli.study.search_method import METHODS, Method

#: Two robots whose ways cross at a right angle; they meet only where both arrive at the same time.
CROSSING: dict[str, Any] = {
    "symaware": 1,
    "name": "crossing",
    "seed": 3,
    "run": {"duration": 2.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "parameters": {"west": 8.0, "south": 2.0, "slow": 1.0, "fast": 1.0, "clear": 0.25},
    "agents": {
        "east": {
            "model": {"use": "single-integrator"},
            "state": [["${parameters.west}", 0]],
            "knowledge": {"goal": [9, 0]},
            "components": {
                "see": {"use": "perception.self"},
                "go": {"use": "control.go-to-goal", "with": {"speed": "${parameters.slow}"}},
            },
        },
        "north": {
            "model": {"use": "single-integrator"},
            "state": [[0, "${parameters.south}"]],
            "knowledge": {"goal": [0, 9]},
            "components": {
                "see": {"use": "perception.self"},
                "go": {"use": "control.go-to-goal", "with": {"speed": "${parameters.fast}"}},
            },
        },
    },
    "specifications": {"apart": {"formula": "always norm(position.east[0] - position.north[0]) > 0.25"}},
}
START: dict[str, Any] = {
    "parameters.west": {"uniform": [-9, 9]},
    "parameters.south": {"uniform": [-9, 9]},
}
FAR: dict[str, Any] = {
    "parameters.west": {"uniform": [-40, 40]},
    "parameters.south": {"uniform": [-40, 40]},
}
SPEED: dict[str, Any] = {
    "parameters.slow": {"uniform": [0.5, 3.0]},
    "parameters.fast": {"uniform": [0.5, 3.0]},
}

#: Five planted faults: how near counts as one, and what varies.
PLANTED: dict[str, tuple[float, dict[str, Any]]] = {
    "near": (1.0, FAR),
    "nearer": (0.5, FAR),
    "fast": (0.5, {**FAR, "parameters.fast": {"uniform": [0.5, 5]}}),
    "all": (0.5, {**FAR, **SPEED}),
    "farther": (1.0, {"parameters.west": {"uniform": [-90, 90]}, "parameters.south": {"uniform": [-90, 90]}}),
}


def crossing(folder: Path, clear: float = 0.25) -> Path:
    scenario = json.loads(json.dumps(CROSSING))
    formula = f"always norm(position.east[0] - position.north[0]) > {clear}"
    scenario["specifications"]["apart"]["formula"] = formula
    path = folder / "crossing.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return path


def test_a_counterexample_runs_and_has_only_what_is_needed(tmp_path: Path) -> None:
    scenario = crossing(tmp_path, 0.5)
    needless = {"parameters.clear": {"uniform": [0, 1]}, **START}
    out = tmp_path / "out"
    found = sa.falsify(scenario, "apart", out, over=needless, runs=2000)
    assert found.is_found
    assert "parameters.clear" not in found.result.values
    assert all(len(f"{abs(value):g}".replace(".", "")) <= 4 for value in found.result.values.values())
    assert "violated" in symaware("run", out / "counterexample.yaml", "-o", tmp_path / "again.mcap", status=3)
    log, again = sa.open_log(out / "counterexample.mcap"), sa.open_log(tmp_path / "again.mcap")
    assert log.outcomes == again.outcomes
    assert found.outcome is not None
    assert found.outcome.reason == log.outcomes[0].reason
    # None of the changes can be left out.
    for path in found.result.values:
        rest = {name: value for name, value in found.result.values.items() if name != path}
        summary = sa.load(scenario, rest).run(record=False).summary
        assert summary.specifications[0].verdict == "satisfied"


@pytest.mark.parametrize("method", METHODS)
def test_the_same_search_finds_the_same(method: Method, tmp_path: Path) -> None:
    scenario = crossing(tmp_path, 0.5)
    first, second = (sa.falsify(scenario, "apart", over=START, runs=500, seed=4, method=method) for _ in range(2))
    assert first.is_found
    assert first == second
    other = sa.falsify(scenario, "apart", over=START, runs=500, seed=5, method=method)
    assert other.result.found != first.result.found


def test_covariance_adaptation_makes_as_many_runs_as_are_allowed(tmp_path: Path) -> None:
    # A plateau, and one coordinate: it converges again and again.
    over = {"parameters.clear": {"uniform": [0, 1]}}
    found = sa.falsify(crossing(tmp_path), "apart", over=over, runs=150, method="cma-es")
    assert (found.is_found, found.result.runs) == (False, 150)


def test_a_method_whose_module_is_missing_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cmaes", None)
    options = ("--specification", "apart", "--seeds", "3", "--method", "cma-es")
    said = symaware("falsify", crossing(tmp_path), *options, status=2)
    assert "pip install 'symaware-cli[falsify]'" in " ".join(said.split())


def test_nothing_found_is_said_with_how_hard_it_looked(tmp_path: Path) -> None:
    options = ("--specification", "apart", "--over", "parameters.west={uniform: [20, 30]}", "--runs", 30)
    said = symaware("falsify", crossing(tmp_path), *options, "--method", "random", "-o", tmp_path / "out")
    assert "does not prove that there is none" in said
    assert "30 runs by random" in said
    assert "0.095 of such draws" in said  # 1 - 0.05^(1/30)
    assert not (tmp_path / "out").exists()


def test_a_scenario_that_violates_by_itself_needs_no_change(tmp_path: Path) -> None:
    found = sa.falsify(crossing(tmp_path, 30.0), "apart", over=START)
    assert found.result.values == {}
    assert found.result.runs == 1


def test_values_that_a_scenario_refuses_are_counted(tmp_path: Path) -> None:
    over = {"environment.with.time_step": {"choice": [-1.0, 0.1, -2.0]}}
    found = sa.falsify(crossing(tmp_path), "apart", over=over, runs=20, method="random")
    assert found.result.runs == 20
    assert 5 < found.result.failed < 20
    assert found.outcome is not None


def test_seeds_can_be_searched(tmp_path: Path) -> None:
    scenario = yaml.safe_load(crossing(tmp_path).read_text())
    scenario["agents"]["east"]["state"] = {"uniform": [[-9, 0], [9, 0]]}
    (tmp_path / "crossing.yaml").write_text(yaml.safe_dump(scenario))
    found = sa.falsify(tmp_path / "crossing.yaml", "apart", seeds=10_000, method="random", runs=2000)
    assert found.is_found
    assert list(found.result.values) == ["seed"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--specification", "none", "--seeds", "3"), "there is no specification `none`, only apart"),
        (("--specification", "apart"), "nothing to vary"),
        (("--specification", "apart", "--seeds", "3", "--method", "luck"), "--method takes"),
        (("--specification", "apart", "--over", "agents.east.cuont=1,2"), "did you mean `count`"),
    ],
)
def test_what_cannot_be_searched_is_refused(tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    assert message in symaware("falsify", crossing(tmp_path), *options, status=2)


@pytest.mark.slow
def test_searches_find_what_is_planted_with_fewer_runs_than_chance(tmp_path: Path) -> None:
    medians = dict.fromkeys(METHODS, 0.0)
    for clear, over in PLANTED.values():
        for method in METHODS:
            made = [
                sa.falsify(crossing(tmp_path, clear), "apart", over=over, runs=600, seed=seed, method=method).result
                for seed in range(5)
            ]
            assert all(each.found is not None for each in made)
            medians[method] += statistics.median(each.runs for each in made)
    assert medians["differential-evolution"] < 0.8 * medians["random"]
    assert medians["cma-es"] < 0.8 * medians["random"]
