"""A log can be checked afterwards, with the verdicts of the run or with new specifications."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from checkout import CHECKOUT

from symaware_cli import load, open_log, sweep, verify_sweep
from symaware_cli.evidence.checking import check_log
from symaware_cli.evidence.log_evaluation import evaluate_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.error import LogError

SCENARIOS = sorted(
    path
    for path in (CHECKOUT / "scenarios").rglob("*")
    if path.suffix in (".yaml", ".toml") and not path.name.startswith("_")
)

#: Stated for every group, so that every shipped scenario has a specification to check.
STATED = {
    "moves": {"formula": "always[0, 1] (speed < 0.3 or eventually[0, 0.4] nearest < 3)"},
    "believes": {"of": "belief", "formula": "always (risk < 0.1 or once[0, 0.5] nearest < 2)"},
    "place": {"formula": "norm(position) < 30 until[0, 1] time > 0.5"},
}


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.name)
def test_checking_a_log_gives_the_verdicts_of_the_run(scenario: Path, tmp_path: Path) -> None:
    overrides = ["run.duration=2", "recording.interval=0", "recording.omit=[]"]
    document = build(scenario, overrides).document
    # A hundred agents of a group are checked as a thousand are.
    overrides += [f"agents.{name}.count=100" for name, group in document.agents.items() if (group.count or 1) > 100]
    stated = {
        f"{name}-{group}": {"each": group, **content} for name, content in STATED.items() for group in document.agents
    }
    stated["world"] = {"formula": "always (contacts < 2 and min_separation > 0.5)"}
    # Contracts and promises are added to them by sections of their own.
    added = {**(getattr(document, "contracts", None) or {}), **(getattr(document, "promises", None) or {})}
    written = {
        name: use.model_dump(by_alias=True, exclude_defaults=True)
        for name, use in document.specifications.items()
        if name not in added
    }
    overrides.append(f"specifications={json.dumps({**written, **stated})}")
    log = tmp_path / "run.mcap"
    summary = execute(build(scenario, overrides), log)
    checked = check_log(log)
    assert checked.sampled is None
    assert checked.is_whole
    assert [each.to_json() for each in checked.specifications] == [each.to_json() for each in summary.specifications]
    assert len(checked.specifications) == len(stated) + len(document.specifications)
    by_definition = evaluate_log(log)
    assert by_definition.is_complete
    assert len(by_definition.specifications) + len(by_definition.left_out) == len(checked.specifications)
    for each in by_definition.specifications:
        said = next(outcome for outcome in checked.specifications if outcome.name == each.name)
        assert (each.name, each.verdict) == (said.name, said.verdict)
        assert each.robustness == said.robustness or not each.is_exact


@pytest.mark.parametrize(
    "change",
    [{"push": {"of": "robot.0", "by": [0.0, 30.0, 0.0]}}, {"place": {"of": "robot.0", "state": [0.0, 30.0, 0.0]}}],
    ids=["push", "place"],
)
def test_a_log_with_a_jump_in_a_state_can_be_checked(change: dict[str, object], tmp_path: Path) -> None:
    stated = {"near": {"each": "robot", "formula": "always norm(position) < 20"}}
    overrides = [f"specifications={json.dumps(stated)}", f"faults={json.dumps({'gust': {'at': 1.0, **change}})}"]
    hello = next(each for each in SCENARIOS if each.name == "head-on.yaml")
    summary = execute(build(hello, ["run.duration=2", *overrides]), tmp_path / "run.mcap")
    checked = check_log(tmp_path / "run.mcap")
    assert checked.violated == ("near",)
    assert [each.to_json() for each in checked.specifications] == [each.to_json() for each in summary.specifications]
    (by_definition,) = evaluate_log(tmp_path / "run.mcap").specifications
    assert by_definition.verdict == "violated"


@pytest.mark.parametrize("scenario", ["auction.yaml", "errands.yaml"])
def test_the_independent_evaluation_of_offers_agrees_with_the_run(scenario: str, tmp_path: Path) -> None:
    path = next(each for each in SCENARIOS if each.name == scenario)
    log = tmp_path / "run.mcap"
    summary = execute(build(path, ["recording.interval=0", "recording.omit=[]"]), log)
    offered = {each.name: each for each in evaluate_log(log).specifications}
    names = [each.name for each in build(path).options.specifications if each.offer is not None]
    assert names
    assert offered.keys() >= {*names}
    for outcome in summary.specifications:
        if outcome.name in names:
            found = offered[outcome.name]
            assert (outcome.name, found.verdict) == (outcome.name, outcome.verdict)
            assert found.robustness == outcome.robustness
            assert len(found.rows) == sum(outcome.counts.values())


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "patrol.mcap"
    execute(build(next(each for each in SCENARIOS if each.name == "patrol.yaml"), ["run.duration=20"]), path)
    return path


def test_new_specifications_can_be_checked(log: Path) -> None:
    checked = check_log(log, {"quick": {"each": "robot", "formula": "eventually[0, 9] speed > 2"}})
    assert [(each.name, each.verdict) for each in checked.specifications] == [("quick", "satisfied")]


def test_a_file_of_specifications_may_define_regions(log: Path, tmp_path: Path) -> None:
    file = tmp_path / "more.yaml"
    file.write_text(
        yaml.safe_dump(
            {
                "regions": {"far": {"box": [50, 60, 0, 10]}, "ahead": {"union": ["far", "wall"]}},
                "specifications": {"keep": {"each": "robot", "formula": "always not inside(position, ahead)"}},
            }
        )
    )
    assert check_log(log, file).specifications[0].verdict == "satisfied"
    file.write_text('specifications:\n  keep: {each: robot, formula: "always inside(position, walll)"}\n')
    with pytest.raises(ScenarioError, match=r"more.yaml:2:\d+.*there is no `walll` here"):
        check_log(log, file)
    file.write_text("agents: {}\n")
    with pytest.raises(ScenarioError, match="`agents` does not belong here"):
        check_log(log, file)


def test_repeating_the_run_gives_the_same_outcomes(log: Path) -> None:
    assert check_log(log, again=True).specifications == check_log(log).specifications


def test_a_window_between_recorded_instants_is_refused_with_a_remedy_and_is_no_finding_of_a_sweep(
    tmp_path: Path,
) -> None:
    scenario = yaml.safe_load((CHECKOUT / "scenarios" / "head-on.yaml").read_text())
    scenario["recording"] = {"interval": 0.3}
    scenario["run"]["duration"] = 1.5
    scenario["specifications"] = {"soon": {"each": "robot", "formula": "eventually[0.05, 0.1] speed > 0"}}
    (tmp_path / "coarse.yaml").write_text(yaml.safe_dump(scenario))
    log = load(tmp_path / "coarse.yaml").run(output=tmp_path / "coarse.mcap").log
    lacking = r"its scenario leaves steps that its windows need \(no instant lies in the window .*--again"
    with pytest.raises(LogError, match=f"lacks data for `soon`: {lacking}"):
        check_log(log.path)
    assert check_log(log.path, again=True).specifications[0].verdict == "satisfied"
    sweep(tmp_path / "coarse.yaml", tmp_path / "swept", runs=2, keep="all")
    assert not verify_sweep(tmp_path / "swept", "all").findings


def test_a_log_without_every_step_is_reported_as_sampled(tmp_path: Path) -> None:
    path = tmp_path / "patrol.mcap"
    scenario = next(each for each in SCENARIOS if each.name == "patrol.yaml")
    execute(build(scenario, ["run.duration=20", "recording.interval=0.25"]), path)
    checked = check_log(path)
    # The first step at or after .25 s.
    assert checked.sampled == pytest.approx(0.3)
    assert check_log(path, again=True).sampled is None


def test_data_missing_from_the_log_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "patrol.mcap"
    scenario = next(each for each in SCENARIOS if each.name == "patrol.yaml")
    execute(build(scenario, ["run.duration=1", "recording.omit=[world]"]), path)
    with pytest.raises(LogError, match=re.escape("its scenario leaves world out of the log")):
        check_log(path)


def test_open_verdicts_of_a_truncated_log_remain_undecided(log: Path, tmp_path: Path) -> None:
    whole = open_log(log)
    assert whole.outcome is not None
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: -len(log.read_bytes()) // 3])
    checked = check_log(cut)
    assert not checked.is_whole
    verdicts = {each.name: each.verdict for each in checked.specifications}
    assert verdicts["safe"] == "undecided"
    assert np.isfinite(checked.specifications[0].robustness or np.nan)
