"""Run, check, verify, inspect and report agree on a specification: its agents, instants and robustness."""

import json
import re
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli import open_log, write_report
from symaware_cli.api.sweeps import verify_sweep
from symaware_cli.evidence.checking import check_log
from symaware_cli.evidence.log_evaluation import evaluate_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute, prepared
from symaware_cli.log.error import LogError
from symaware_cli.specification.outcome import Outcome
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.metrics import PREFIX, agent_verdicts
from symaware_cli.studies.request import SweepRequest
from symaware_cli.studies.session import conduct
from symaware_cli.studies.sweep_source import read_sweep

#: Robots that collide with a wall one after the other, the second also with the third; a visitor enters and leaves.
SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "walls",
    "seed": 3,
    "run": {"duration": 1.5},
    "environment": {
        "use": "kinematic",
        "with": {"time_step": 0.1},
        "entities": {"wall": {"shape": {"box": {"length": 0.4, "width": 9}}, "position": [2, 0]}},
    },
    "agents": {
        "robot": {
            "count": 3,
            "entity": {"shape": {"circle": {"radius": 0.3}}},
            "model": {"use": "single-integrator", "with": {"process_noise": 0.1}},
            "state": [[0.3, 0], [1.0, 2], [-3.5, 2.4]],
            "knowledge": {"goal": [[4, 0], [4, 2], [-3, 2.6]]},
            "components": {
                "see": {"use": "perception.omniscient"},
                "steer": {"use": "control.go-to-goal", "with": {"speed": 1.5, "tolerance": 0.3}},
            },
        },
        "visitor": {
            "model": {"use": "single-integrator"},
            "state": [5, 5],
            "present": {"from": 0.4, "until": 1.1},
        },
    },
}

#: The scopes of specifications; `VALUE` in a formula is a quantity that grows during the run.
SCOPES: dict[str, tuple[dict[str, Any], str]] = {
    "each": ({"each": "robot"}, "x"),
    "visitor": ({"each": "visitor"}, "x - 4.5"),
    "believed": ({"each": "robot", "of": "belief"}, "x"),
    "pairs": ({"pairs": "robot"}, "distance"),
    "listed": ({"pairs": [["robot.0", "robot.1"], ["robot.1", "visitor"]]}, "distance"),
    "world": ({}, "min_separation"),
}
FORMULAS = {
    "now": "VALUE > 1",
    "window": "always[0, 0.4] VALUE > 0.2",
    "beyond": "(eventually[0, 9] VALUE > -100) and VALUE > 0.7",
    "open": "eventually (VALUE > 0.9 and always[0, 0.3] VALUE > 0.1)",
    "past": "always (VALUE > -9 since[0, 0.2] VALUE > 0.3)",
}
BEGINNINGS: dict[str, dict[str, Any]] = {
    "at-once": {},
    "late": {"from": 0.5, "to": 1.2},
    "contact": {"from": {"event": "contact", "of": "environment"}},
    "contact-until": {"from": {"event": "contact", "of": "environment"}, "to": 1.0},
    "goal": {"from": {"event": "goal-reached", "of": "agents.*"}},
    "entering": {"from": {"event": "added", "of": "agents.*"}},
}

TABLE = {
    f"{scope}-{formula}-{beginning}-{'interval' if interval else 'verdict'}": {
        **SCOPES[scope][0],
        "formula": FORMULAS[formula].replace("VALUE", SCOPES[scope][1]),
        **BEGINNINGS[beginning],
        "interval": interval,
    }
    for scope in SCOPES
    for formula in FORMULAS
    for beginning in BEGINNINGS
    for interval in (True, False)
}
#: A third of the table, with every scope, formula, beginning and option.
SOME = {name: TABLE[name] for place, name in enumerate(TABLE) if place % 7 in (0, 3)}


def reported(log: Path) -> dict[str, list[str]]:
    """Return the rows of specifications in the report on a log: the texts of their cells by name."""
    page = write_report(log, log.with_suffix(".html")).read_text(encoding="utf-8")
    table = page.partition("<h2>Specifications</h2>")[2].partition("</table>")[0]
    rows = [re.findall("<td>(.*?)</td>", row) for row in table.split("<tr>")[2:]]
    return {row[0]: [unescape(re.sub("<[^>]*>", "", cell)) for cell in row] for row in rows}


def robustness(outcome: Outcome) -> str:
    if outcome.robustness is None:
        return ""
    return f"{'' if outcome.is_exact else 'at most '}{outcome.robustness:.6g}"


@pytest.fixture(scope="module", params=[SOME, pytest.param(TABLE, marks=pytest.mark.slow)], ids=["some", "all"])
def log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walls")
    scenario = folder / "walls.yaml"
    scenario.write_text(yaml.safe_dump({**SCENARIO, "specifications": request.param}))
    built = build(scenario)
    with prepared(built, folder / "run.mcap", may_exit=False) as run:
        summary = run.execute()
    monitors = run.specification_monitors
    stated = {"outcomes": [each.to_json() for each in summary.specifications], "rows": agent_verdicts(monitors)}
    (folder / "told.json").write_text(json.dumps(stated))
    return folder / "run.mcap"


def told(log: Path) -> dict[str, Any]:
    """Return the results of the run: its outcomes, and a row for each agent or pair of each specification."""
    said: dict[str, Any] = json.loads((log.parent / "told.json").read_text())
    return said


def test_the_specifications_cover_all_kinds_of_instances(log: Path) -> None:
    outcomes = {each["name"]: each for each in told(log)["outcomes"]}
    assert {each["verdict"] for each in outcomes.values()} == {"satisfied", "violated", "undecided"}
    assert {each["is_exact"] for each in outcomes.values()} == {True, False}
    begun = {name: sum(each["counts"].values()) for name, each in outcomes.items()}
    of_beginnings = {"at-once": 3, "late": 3, "contact": 2, "contact-until": 2, "goal": 3, "entering": 3}
    for name, count in begun.items():
        if name.startswith("each-"):
            beginning = name.split("-", 2)[2].rpartition("-")[0]
            assert (name, count) == (name, of_beginnings[beginning])


def test_check_agrees_with_the_run(log: Path) -> None:
    assert json.loads(json.dumps([each.to_json() for each in check_log(log).specifications])) == told(log)["outcomes"]


def test_a_repeated_run_agrees_with_the_run(log: Path) -> None:
    found = [each.to_json() for each in check_log(log, again=True).specifications]
    assert json.loads(json.dumps(found)) == told(log)["outcomes"]


def test_inspect_agrees_with_the_run(log: Path) -> None:
    assert json.loads(json.dumps([each.to_json() for each in open_log(log).outcomes])) == told(log)["outcomes"]


@pytest.mark.slow
def test_the_report_agrees_with_the_run(log: Path) -> None:
    rows = reported(log)
    assert list(rows) == [each["name"] for each in told(log)["outcomes"]]
    for outcome in open_log(log).outcomes:
        assert rows[outcome.name][2:4] == [outcome.verdict, robustness(outcome)]


def test_the_independent_evaluation_gives_the_same_rows_as_the_run(log: Path) -> None:
    evaluated = evaluate_log(log)
    assert not evaluated.left_out
    outcomes = {each["name"]: each for each in told(log)["outcomes"]}
    assert [each.name for each in evaluated.specifications] == [*outcomes]
    for each in evaluated.specifications:
        outcome = outcomes[each.name]
        assert (each.name, each.verdict) == (each.name, outcome["verdict"])
        if not outcome["agents"] and each.rows and each.rows[0].agents == ():
            continue
        of_run = {row["agent"]: row for row in told(log)["rows"].get(PREFIX + each.name, ())}
        here = {" and ".join(row.agents): row for row in each.rows}
        assert (each.name, sorted(of_run)) == (each.name, sorted(here))
        for agent, row in here.items():
            known = of_run[agent]["robustness"]
            found = row.robustness if np.isfinite(row.robustness) else None
            assert (each.name, agent, row.verdict) == (each.name, agent, of_run[agent]["verdict"])
            assert known == found if each.is_exact else known is None or found is None or known >= found


def test_a_verdict_and_its_robustness_have_the_same_sign(log: Path) -> None:
    for outcome in open_log(log).outcomes:
        if outcome.robustness and outcome.verdict == "violated":
            assert (outcome.name, outcome.robustness < 0) == (outcome.name, True)
        if outcome.robustness and outcome.is_exact and outcome.verdict == "satisfied":
            assert (outcome.name, outcome.robustness > 0) == (outcome.name, True)


def test_an_unchanged_sweep_is_sound_for_all_specifications(tmp_path: Path) -> None:
    (tmp_path / "walls.yaml").write_text(yaml.safe_dump({**SCENARIO, "specifications": SOME}))
    made = SweepFolder.created(
        tmp_path / "out", read_sweep(tmp_path / "walls.yaml", SweepRequest(entries={"runs": 1, "keep": "all"}))
    )
    conduct(made, 0)
    found = verify_sweep(made.path, "monitor")
    assert found.logs == 1
    assert found.is_sound, found.findings


@pytest.mark.parametrize(
    ("beginning", "recording", "missing"),
    [
        ({"event": "goal-reached", "of": "agents.*"}, {"events": "none"}, "events"),
        ({"event": "stepped", "of": "environment"}, {}, "the event `stepped`"),
        ({"event": "stepped", "of": "environment"}, {"events": "all"}, None),
        ({"event": "contact", "of": "environment"}, {"events": "none"}, None),
        ({"event": "added", "of": "agents.*"}, {"events": "none"}, None),
    ],
)
def test_missing_events_of_a_specification_in_a_log_are_reported(
    beginning: dict[str, str], recording: dict[str, Any], missing: str | None, tmp_path: Path
) -> None:
    specifications = {"s": {"each": "robot", "formula": "x > 1", "from": beginning}}
    (tmp_path / "s.yaml").write_text(
        yaml.safe_dump({**SCENARIO, "recording": recording, "specifications": specifications})
    )
    summary = execute(build(tmp_path / "s.yaml"), tmp_path / "s.mcap")
    if missing is None:
        assert check_log(tmp_path / "s.mcap").specifications == summary.specifications
        return
    with pytest.raises(LogError, match=f"leaves {missing} out of the log"):
        check_log(tmp_path / "s.mcap")
    assert check_log(tmp_path / "s.mcap", again=True).specifications == summary.specifications
