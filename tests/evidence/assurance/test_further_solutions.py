"""Solutions by an explanation of a violation, and by a study of paired variants."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from test_assurance import SCENARIO

import symaware_cli as sa
from symaware_cli.evidence import explain

pytest.importorskip("pyarrow")

PUSHED = SCENARIO.replace("duration: 0.3", "duration: 1.0") + (
    "faults: {jump: {at: 0.6, place: {of: robot.1, state: [0.5, 0.0]}}}\n"
)
STUDY = """
symaware-sweep: 1
scenario: meeting.yaml
runs: 4
seed: 2
paired: true
variants:
  far: {}
  near: {agents.robot.state: [[0.0, 0.0], [3.0, 0.0]]}
"""
CASE = """
symaware-case: 1
name: Two robots
scenario: meeting.yaml
goals: {G1: {text: Violations are understood, by: [Sn1, Sn2]}}
solutions:
  Sn1: {explanation: why.json, specification: apart, cause: fault jump, scenario: pushed.yaml}
  Sn2: {study: placed/sweep.yaml, variant: near, column: robustness.apart, difference: less}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("case")
    (folder / "meeting.yaml").write_text(SCENARIO)
    (folder / "pushed.yaml").write_text(PUSHED)
    (folder / "placed.yaml").write_text(STUDY)
    (folder / "case.yaml").write_text(CASE)
    sa.sweep(folder / "placed.yaml", output=folder / "placed", jobs=0)
    sa.load(folder / "pushed.yaml").run(output=folder / "pushed.mcap")
    found = explain(folder / "pushed.mcap", "apart", kinds=["faults"], before=[0.3], within=0.1, futures=10)
    (folder / "why.json").write_text(json.dumps({**found.to_json(), "log": "pushed.mcap"}))
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "case")
    return tmp_path / "case"


def problems(folder: Path, written: str = "", instead: str = "") -> dict[str, str | None]:
    (folder / "case.yaml").write_text(CASE.replace(written, instead, 1) if written else CASE)
    return dict(sa.assure(folder / "case.yaml", folder / f"out-{len(list(folder.iterdir()))}", rows=1, seed=1).problems)


def test_an_explanation_and_a_study_support_a_goal(folder: Path) -> None:
    (folder / "pushed.mcap").rename(folder / "elsewhere.mcap")
    assert (problems(folder)["Sn1"] or "").startswith("missing: there is no log")
    (folder / "elsewhere.mcap").rename(folder / "pushed.mcap")
    assert problems(folder) == {"Sn1": None, "Sn2": None}


@pytest.mark.parametrize(
    ("written", "instead", "name", "said"),
    [
        ("fault jump", "fault push", "Sn1", "another claim: its causes are fault jump"),
        ("fault jump", "none", "Sn1", "contradicted: it has a cause"),
        ("specification: apart", "specification: sees", "Sn1", "another claim: it explains a violation of apart"),
        ("difference: less", "difference: greater", "Sn2", "contradicted: the difference in robustness.apart is -"),
        ("variant: near", "variant: far", "Sn2", "far is not compared with another variant"),
        ("column: robustness.apart", "column: robustness.apart2", "Sn2", "another claim"),
    ],
)
def test_evidence_for_other_claims_is_refused(folder: Path, written: str, instead: str, name: str, said: str) -> None:
    assert said in (problems(folder, written, instead)[name] or "")


def test_solutions_are_stale_if_run_or_scenario_changed(folder: Path) -> None:
    sa.load(folder / "pushed.yaml", seed=8).run(output=folder / "pushed.mcap")
    (folder / "meeting.yaml").write_text(SCENARIO.replace("4.0, 0.0", "4.5, 0.0"))
    found = problems(folder)
    assert (found["Sn1"] or "").startswith("stale: it explains a run other than")
    assert found["Sn2"] == "stale: meeting.yaml has changed since it was made"
