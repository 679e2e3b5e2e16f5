"""Awareness contracts compare beliefs with the truth, as specifications of the run, its log and its sweeps."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT

import symaware_cli as sa
from symaware_cli.evidence.log_evaluation import evaluate_log
from symaware_cli.language.build import build

SCENARIO = """
symaware: 1
name: aware
seed: 3
run: {duration: 1.0}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    count: 3
    model: {use: unicycle, with: {max_speed: 1.5}}
    state: [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [40.0, 0.0, 0.0]]
    components:
      sense: {use: perception.range, with: {range: 8.0, position_noise: 0.13, velocity_noise: 0.1}}
      drive: {use: control.schedule, with: {inputs: [{time: 0.0, input: [1.0, 0.1]}]}}
contracts:
  sees: {of: [robot.0, robot.1], about: [robot.0, robot.1], formula: "always norm(belief(other) - truth(other)) < 0.5"}
  far: {of: robot.0, about: robot.2, formula: "always norm(belief(other) - truth(other)) < 100"}
  unknown: {of: robot.0, about: robot.2, formula: "always not known(other)"}
  itself: "always norm(belief(self) - truth(self)) < 0.6"
  near: "always (distance < 8 implies known(other) and norm(believed_velocity(other) - true_velocity(other)) < 1)"
specifications:
  apart: {pairs: robot, formula: "always distance > 0.6"}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "aware.yaml"
    path.write_text(SCENARIO)
    return path


def test_contracts_are_monitored_for_each_ordered_pair(scenario: Path) -> None:
    summary = sa.load(scenario).run(output=scenario.with_suffix(".mcap")).summary
    counts = {each.name: {key: n for key, n in each.counts.items() if n} for each in summary.specifications}
    assert {name: each for name, each in counts.items() if name != "apart"} == {
        "sees": {"satisfied": 2},
        "far": {"violated": 1},
        "unknown": {"satisfied": 1},
        "itself": {"satisfied": 6},
        "near": {"satisfied": 6},
    }


def test_a_contract_about_a_missing_belief_is_violated(scenario: Path) -> None:
    """A belief that an agent lacks is within no distance of the truth, however large; nothing is undefined by it."""
    far = next(each for each in sa.load(scenario).run(record=False).summary.specifications if each.name == "far")
    assert far.verdict == "violated"
    assert far.reason == '`norm(belief["other"] - truth["other"]) < 100` fails at 0 s'


def test_the_independent_witness_finds_the_same_robustness_in_the_log(scenario: Path) -> None:
    log = scenario.with_suffix(".mcap")
    summary = sa.load(scenario).run(output=log).summary
    found = {each.name: each.rows for each in evaluate_log(log).specifications}
    for each in summary.specifications:
        least = min(row.robustness for row in found[each.name])
        assert (least if np.isfinite(least) else None) == each.robustness, each.name
    checked = {each.name: (each.verdict, each.robustness) for each in sa.check_log(log).specifications}
    assert checked == {each.name: (each.verdict, each.robustness) for each in summary.specifications}
    assert sa.verify_log(log).is_equal


def test_agents_read_the_status_of_their_own_awareness(scenario: Path) -> None:
    stated = {each.name: each.scope for each in build(scenario).options.specifications}
    assert (stated["far"].agents(0), stated["far"].subjects(0)) == (("robot.0", "robot.2"), ("robot.0",))
    assert stated["apart"].subjects(0) == stated["apart"].agents(0) == ("robot.0", "robot.1")


@pytest.mark.parametrize(
    ("changes", "path", "said"),
    [
        ({"contracts": {"sees": "always norm(belief(anyone)) < 1"}}, "contracts.sees", "contract `anyone`"),
        ({"contracts": {"sees": "always norm(belief) < 1"}}, "contracts.sees", "say whose: belief"),
        ({"contracts": {"sees": "always belief(other) < 1"}}, "contracts.sees", "2 values"),
        ({"contracts": {"sees": {"formula": "always known(other)", "about": "robto"}}}, "contracts.sees", "`robto`"),
        ({"contracts": {"sees": {"formla": "always known(other)"}}}, "contracts.sees", "formula"),
        ({"contracts": {"sees": "always norm(belief(other)) < time"}}, "contracts.sees", "compares m with s"),
        ({"contracts": {"apart": "always known(other)"}}, "contracts.apart", "whose name is taken"),
        ({"contracts": {"sees": "always known(other)"}, "agents.robot.count": 1, "agents.robot.state": [0, 0, 0]},
         "contracts.sees", "it takes two agents"),
    ],
)  # fmt: skip
def test_problems_are_located_at_the_contract(scenario: Path, changes: dict[str, Any], path: str, said: str) -> None:
    with pytest.raises(sa.ScenarioError) as raised:
        sa.load(scenario, changes)
    problems = raised.value.problems
    assert any(each.path.startswith(path) and said in f"{each.message} {each.expected}" for each in problems), problems


def test_a_sweep_certifies_contracts_and_claims_conditional_on_them(scenario: Path) -> None:
    pytest.importorskip("pyarrow")
    out = scenario.parent / "out"
    claim = "P(sees) > 0.8; P(apart | sees) > 0.8 with confidence 0.9"
    sa.sweep(scenario, output=out, runs=30, jobs=0, claim=claim, changes={"run.duration": 0.3})
    made = sa.certify(out)
    assert made.is_established
    cell = made.statement["predicate"]["combinations"][0]
    assert cell["runs"] == 30
    assert cell["terms"][1]["counted"] == cell["terms"][0]["satisfied"] <= 30
    assert sa.verify_certificate(out / "certificate.json", rows=1).is_sound
    check = [sys.executable, "-I", str(CHECKOUT / "docs" / "check_certificate.py"), str(out)]
    said = subprocess.run(check, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout
    assert "combination 0, P(apart | sees) > 0.8: " in said.stdout
