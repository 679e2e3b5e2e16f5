"""Planted faults are found, simplified and can be run; a search that finds none reports its effort."""

import json
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from simulating import COMMAND
from sweeping import children, symaware

import symaware_cli as sa
from symaware_cli.evidence.search_method import method_names

#: Two robots whose paths cross at a right angle; they meet only if both arrive at the same time.
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
    "specifications": {"apart": {"pairs": [["east", "north"]], "formula": "always distance > 0.25"}},
}
START: dict[str, Any] = {
    "parameters.west": {"uniform": [-9, 9]},
    "parameters.south": {"uniform": [-9, 9]},
}
FAR: dict[str, Any] = {
    "parameters.west": {"uniform": [-20, 20]},
    "parameters.south": {"uniform": [-20, 20]},
}
SPEED: dict[str, Any] = {
    "parameters.slow": {"uniform": [0.5, 3.0]},
    "parameters.fast": {"uniform": [0.5, 3.0]},
}

#: Planted faults: the distance that counts as a violation, and the varied parameters.
PLANTED: dict[str, tuple[float, dict[str, Any]]] = {
    "near": (0.5, START),
    "all": (0.5, {**START, **SPEED}),
    "far": (1.0, FAR),
}

#: A component that ends the process of its run.
FATAL = """
import os
from symaware_cli import Component

class Fatal(Component):
    def _compute(self):
        os.kill(os.getpid(), 9)

    def _update(self, value):
        pass
"""


def crossing(folder: Path, clear: float = 0.25) -> Path:
    scenario = json.loads(json.dumps(CROSSING))
    scenario["specifications"]["apart"]["formula"] = f"always distance > {clear}"
    path = folder / "crossing.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return path


def test_a_counterexample_can_be_run_and_contains_only_necessary_changes(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("method", method_names())
def test_a_search_is_reproducible(method: str, tmp_path: Path) -> None:
    scenario = crossing(tmp_path, 0.5)
    first, second = (sa.falsify(scenario, "apart", over=START, runs=500, seed=4, method=method) for _ in range(2))
    assert first.is_found
    assert first == second
    other = sa.falsify(scenario, "apart", over=START, runs=500, seed=5, method=method)
    assert other.result.found != first.result.found


@pytest.mark.parametrize("method", method_names())
def test_a_search_does_not_depend_on_workers_or_batches(method: str, tmp_path: Path) -> None:
    scenario = crossing(tmp_path, 0.5)
    for over, seed in ((START, 4), ({**START, "parameters.slow": {"uniform": [0.0, 0.2]}}, 2)):
        alone, batched, shared = (
            sa.falsify(scenario, "apart", over=over, runs=60, seed=seed, method=method, batch=batch, jobs=jobs)
            for batch, jobs in ((1, 0), (None, 0), (None, 2))
        )
        assert alone.result.one_by_one == "batches are switched off"
        assert batched == shared
        assert replace(alone.result, one_by_one=batched.result.one_by_one) == batched.result


def test_runs_after_the_first_violation_in_a_batch_do_not_count(tmp_path: Path) -> None:
    found = sa.falsify(crossing(tmp_path, 1.0), "apart", over=START, method="random", runs=200)
    fewer = sa.falsify(crossing(tmp_path, 1.0), "apart", over=START, method="random", runs=found.result.runs)
    none = sa.falsify(crossing(tmp_path, 1.0), "apart", over=START, method="random", runs=found.result.runs - 1)
    assert fewer.result == found.result
    assert (none.is_found, none.result.runs) == (False, found.result.runs - 1)


def test_the_reason_is_reported_if_runs_are_not_batched(tmp_path: Path) -> None:
    options = (crossing(tmp_path), "--specification", "apart", "--runs", 3, "--jobs", 0)
    assert "one by one" not in symaware("falsify", *options, "--over", "agents.east.state[0][0]={uniform: [8, 9]}")
    said = symaware("falsify", *options, "--over", "parameters.slow={uniform: [0.1, 0.2]}")
    assert "one by one   runs differ in more than seeds, initial states and knowledge" in said
    told = json.loads(symaware("falsify", *options, "--over", "run.duration={uniform: [1, 2]}", "--json"))
    assert told["one_by_one"] == "runs differ in more than seeds, initial states and knowledge"


def test_a_run_that_ends_its_process_ends_the_search(tmp_path: Path) -> None:
    (tmp_path / "fatal.py").write_text(FATAL)
    scenario = yaml.safe_load(crossing(tmp_path).read_text())
    information = tmp_path / "fatal-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: fatal\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[symaware.components]\nfatal.exit = fatal:Fatal\n")
    scenario["agents"]["east"]["components"]["end"] = {"use": "fatal.exit"}
    (tmp_path / "crossing.yaml").write_text(yaml.safe_dump(scenario))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        options = ("--specification", "apart", "--over", "parameters.west={uniform: [8, 9]}", "--runs", 3, "--jobs", 1)
        said = symaware("falsify", tmp_path / "crossing.yaml", *options, status=1)
    assert "run 0 of the search was lost: the worker process was killed by SIGKILL" in said


def test_an_interrupted_search_ends_its_workers(tmp_path: Path) -> None:
    over = "parameters.slow={uniform: [0.01, 0.02]}"
    options = ["--specification", "apart", "--over", over, "--runs", "1000000", "--jobs", "2"]
    with subprocess.Popen([*COMMAND, "falsify", str(crossing(tmp_path)), *options], stderr=subprocess.PIPE) as process:
        while len(workers := children(process.pid)) < 2 and process.poll() is None:
            time.sleep(0.05)
        process.terminate()
        assert b"interrupted" in process.communicate()[1]
    assert process.returncode == 130
    assert len(workers) == 2
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)


def gusty(folder: Path, **gust: Any) -> Path:
    """The crossing with a gust that blows the northbound robot to the final position of the other one."""
    scenario = yaml.safe_load(crossing(folder).read_text())
    scenario["run"]["duration"] = 4.0
    scenario["parameters"]["south"] = -2.0
    scenario["faults"] = {"gust": {"at": 0.5, "push": {"of": "north", "by": [9.0, 0.0]}, **gust}}
    (folder / "crossing.yaml").write_text(yaml.safe_dump(scenario))
    return folder / "crossing.yaml"


def test_the_time_of_a_fault_can_be_searched(tmp_path: Path) -> None:
    out = tmp_path / "out"
    found = sa.falsify(gusty(tmp_path), "apart", out, over={"faults.gust.at": {"uniform": [0.1, 3.9]}})
    assert found.is_found
    # The two meet only if the gust comes when both are at the same height.
    at = found.result.values["faults.gust.at"]
    assert 1.6 < at < 2.4
    assert found.outcome is not None
    assert found.outcome.time == pytest.approx(at, abs=0.4)
    assert yaml.safe_load((out / "counterexample.yaml").read_text())["faults"]["gust"]["at"] == at


def test_a_parameter_of_a_fault_can_be_searched(tmp_path: Path) -> None:
    scenario = gusty(tmp_path, at=2.0, push={"of": "north", "by": [3.0, 0.0]})
    found = sa.falsify(scenario, "apart", over={"faults.gust.push.by[0]": {"uniform": [0.0, 20.0]}})
    assert found.is_found
    assert 8.7 < found.result.values["faults.gust.push.by[0]"] < 9.3


def test_noise_can_be_searched_through_seeds(tmp_path: Path) -> None:
    over = {"agents.east.model.with.process_noise": {"uniform": [0.0, 2.0]}}
    changes = {"parameters.west": 2.0, "parameters.south": -1.0}
    found = sa.falsify(crossing(tmp_path, 0.4), "apart", over=over, seeds=100, changes=changes, runs=500)
    assert found.is_found
    assert found.result.values["agents.east.model.with.process_noise"] > 0.0


def test_initial_states_can_be_searched_element_by_element(tmp_path: Path) -> None:
    over = {"agents.east.state[0][0]": {"uniform": [-9, 9]}, "agents.north.state[0][1]": {"uniform": [-9, 9]}}
    found = sa.falsify(crossing(tmp_path, 0.5), "apart", over=over, runs=500)
    # The search equals that over the parameters of these states, except for the draws, which are keyed by name.
    assert found.is_found
    assert {*found.result.values} <= {*over}
    assert found.result.one_by_one is None


def test_covariance_adaptation_uses_all_allowed_runs(tmp_path: Path) -> None:
    # A plateau with one coordinate, on which the method converges repeatedly.
    over = {"parameters.clear": {"uniform": [0, 1]}}
    found = sa.falsify(crossing(tmp_path), "apart", over=over, runs=150, method="cma-es")
    assert (found.is_found, found.result.runs) == (False, 150)


@pytest.mark.parametrize(("method", "module", "extra"), [("cma-es", "cmaes", "falsify"), ("tpe", "optuna", "tpe")])
def test_a_method_with_a_missing_module_names_the_package_to_install(
    method: str, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    options = ("--specification", "apart", "--seeds", "3", "--method", method)
    said = symaware("falsify", crossing(tmp_path), *options, status=2)
    assert f"pip install 'symaware-cli[{extra}]'" in " ".join(said.split())


def test_a_search_without_a_violation_reports_its_effort(tmp_path: Path) -> None:
    options = ("--specification", "apart", "--over", "parameters.west={uniform: [20, 30]}", "--runs", 30)
    said = symaware("falsify", crossing(tmp_path), *options, "--method", "random", "-o", tmp_path / "out")
    assert "does not prove that there is none" in said
    assert "30 runs by random" in said
    assert "0.095 of such draws" in said  # 1 - 0.05^(1/30)
    assert not (tmp_path / "out").exists()


def test_an_unchanged_scenario_can_be_the_counterexample(tmp_path: Path) -> None:
    found = sa.falsify(crossing(tmp_path, 30.0), "apart", over=START)
    assert found.result.values == {}
    assert found.result.runs == 1


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("method", method_names())
def test_rejected_values_are_counted_and_the_first_reason_is_reported(method: str, tmp_path: Path) -> None:
    over = {"environment.with.time_step": {"choice": [-1.0, 0.1, -2.0]}}
    found = sa.falsify(crossing(tmp_path), "apart", over=over, runs=20, method=method)
    assert found.result.runs == 20
    assert 3 < found.result.failed < 20
    assert "environment.with.time_step" in (found.result.failure or "")
    assert found.outcome is not None


def test_a_formula_without_robustness_can_be_searched(tmp_path: Path) -> None:
    scenario = crossing(tmp_path)
    for limit, found in ((50.0, False), (5.0, True)):
        low = {"each": "east", "logic": "ltl", "formula": f"always position[0] < {limit}"}
        options: dict[str, Any] = {"over": START, "runs": 20, "changes": {"specifications": {"low": low}}}
        result = sa.falsify(scenario, "low", **options)
        assert result.is_found == found
        assert result.outcome is not None
        assert result.outcome.robustness is None


def test_seeds_can_be_searched(tmp_path: Path) -> None:
    scenario = yaml.safe_load(crossing(tmp_path).read_text())
    scenario["agents"]["east"]["state"] = {"uniform": [[-9, 0], [9, 0]]}
    scenario["parameters"]["south"] = -1.0
    (tmp_path / "crossing.yaml").write_text(yaml.safe_dump(scenario))
    found = sa.falsify(tmp_path / "crossing.yaml", "apart", seeds=10_000, method="random", runs=2000)
    assert found.is_found
    assert list(found.result.values) == ["seed"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--specification", "none", "--seeds", "3"), "the scenario has no specification `none`; it has apart"),
        (("--specification", "apart"), "nothing to vary"),
        (("--specification", "apart", "--seeds", "3", "--method", "luck"), "there is no search method `luck`"),
        (("--specification", "apart", "--over", "agents.east.cuont=1,2"), "did you mean `count`"),
    ],
)
def test_invalid_searches_are_rejected(tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    assert message in symaware("falsify", crossing(tmp_path), *options, status=2)


@pytest.mark.slow
def test_searches_find_planted_faults_with_fewer_runs_than_random_draws(tmp_path: Path) -> None:
    medians = dict.fromkeys(method_names(), 0.0)
    for clear, over in PLANTED.values():
        scenario = crossing(tmp_path, clear)
        for method in method_names():
            made = [
                sa.falsify(scenario, "apart", over=over, runs=600, seed=seed, method=method).result for seed in range(9)
            ]
            assert all(each.found is not None for each in made)
            medians[method] += statistics.median(each.runs for each in made)
    assert medians["differential-evolution"] < 0.8 * medians["random"]
    assert medians["tpe"] < 0.8 * medians["random"]
    assert medians["cma-es"] < 0.8 * medians["random"]
