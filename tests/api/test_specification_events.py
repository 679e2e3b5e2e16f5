"""Specifications that begin with an event: every event begins the same instances on a log as in a run."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import open_log
from symaware_cli.evidence.checking import check_log
from symaware_cli.evidence.log_evaluation import evaluate_log
from symaware_cli.evidence.verification import verify_log
from symaware_cli.language import timing_check
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute, prepared
from symaware_cli.log.error import LogError
from symaware_cli.specification.outcome import Outcome
from symaware_cli.studies.metrics import PREFIX, agent_verdicts

#: Robots that meet, lose messages, fail, are late and are restarted; a visitor comes and goes.
SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "eventful",
    "seed": 5,
    "run": {"duration": 1.0},
    "recording": {"events": "all"},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 3,
            "entity": {"shape": {"circle": {"radius": 0.3}}},
            "model": {"use": "single-integrator"},
            "state": [[0, 0], [1.1, 0], [3, 3]],
            "knowledge": {"goal": [[0.9, 0], [0.2, 0], [3.6, 3]]},
            "components": {
                "inbox": {"use": "communication.inbox"},
                "see": {"use": "perception.omniscient"},
                "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0, "tolerance": 0.2}},
                "tell": {"use": "communication.broadcast", "period": 0.3},
                "take": {"use": "allocation.nearest", "with": {"least": -7.0}},
                "late": {"use": "doubles.fault", "with": {"at": 100}, "period": 0.2, "latency": 0.25},
                "retry": {"use": "doubles.fault", "with": {"at": 0.8}, "on_failure": "restart"},
                "die": {"use": "doubles.fault", "with": {"at": 0.9, "agent": "robot.1"}, "on_failure": "isolate"},
            },
        },
        "visitor": {
            "model": {"use": "single-integrator"},
            "state": [5, 5],
            "present": {"from": 0.4, "until": 0.8},
            "components": {"see": {"use": "perception.self"}},
        },
    },
    "topology": {"use": "range", "with": {"range": 1.0}, "channel": {"loss": 0.4}},
    "faults": {
        "fog": {"at": 0.2, "for": 0.3, "blind": "robot.see"},
        "halt": {"at": 0.3, "for": 0.3, "stop": "robot.2"},
    },
}

#: An errand that robot 2 accepts before it is stopped, and one that nobody does.
OFFERED = {
    "errand": {
        "each": "robot",
        "formula": "eventually x > 9",
        "offer": {"at": 0.1, "open_for": 0.4, "knowledge": {"goal": [3.2, 3]}},
    },
    "secret": {"each": "robot", "formula": "x > 0.5", "offer": {"at": 0.1, "open_for": 0.2, "to": ["visitor"]}},
}
#: Sources of events by a name for them, with the events that `TimingCheck` knows of each.
SOURCES = {
    "agents": ("agents.*", timing_check.AGENT_EVENTS | timing_check.COMPONENT_EVENTS | {"goal-reached", "*"}),
    "first": ("agents.robot.0", timing_check.AGENT_EVENTS),
    "group": ("agents.robot.steer", timing_check.COMPONENT_EVENTS | {"goal-reached"}),
    "component": ("agents.robot.*.late", timing_check.COMPONENT_EVENTS),
    "environment": ("environment", timing_check.ENVIRONMENT_EVENTS),
    "run": ("run", timing_check.RUN_EVENTS | {"*"}),
    "everything": ("*", {"*"}),
    "topology": ("topology", timing_check.TOPOLOGY_EVENTS),
    "specifications": ("specifications.*", timing_check.SPECIFICATION_EVENTS),
}
#: Whom a specification is about; `VALUE` differs from step to step.
SCOPES: dict[str, tuple[dict[str, Any], str]] = {
    "each": ({"each": "robot"}, "x"),
    "visitor": ({"each": "visitor"}, "x"),
    "pairs": ({"pairs": "robot"}, "distance"),
    "world": ({}, "min_separation"),
}
TABLE: dict[str, dict[str, Any]] = {
    f"{scope}-{source}-{event.replace('*', 'any')}": {
        **SCOPES[scope][0],
        "formula": f"always[0, 0.2] {SCOPES[scope][1]} > 0.6",
        "from": {"event": event, "of": SOURCES[source][0]},
    }
    for scope in SCOPES
    for source in SOURCES
    for event in sorted(SOURCES[source][1])
}


def written(folder: Path, mode: str, **more: Any) -> Path:
    path = folder / "eventful.yaml"
    run = {**SCENARIO["run"], "mode": mode}
    path.write_text(yaml.safe_dump({**SCENARIO, "run": run, "specifications": {**OFFERED, **TABLE}, **more}))
    return path


@pytest.fixture(params=["synchronous", "asynchronous"])
def ran(request: pytest.FixtureRequest, tmp_path: Path, doubles: Path) -> tuple[Path, list[Any], dict[str, Any]]:
    """A log, and what its run said: the outcomes, and the verdict of each agent or pair by specification."""
    with prepared(build(written(tmp_path, request.param)), tmp_path / "run.mcap", may_exit=False) as run:
        summary = run.execute()
    assert summary.status == "finished", summary.failure
    return tmp_path / "run.mcap", said_of(summary.specifications), dict(agent_verdicts(run.specification_monitors))


def said_of(outcomes: Iterable[Outcome]) -> list[Any]:
    said: list[Any] = json.loads(json.dumps([each.to_json() for each in outcomes]))
    return said


def test_every_event_begins_the_same_instances_on_a_log(ran: tuple[Path, list[Any], dict[str, Any]]) -> None:
    log, said, rows = ran
    counts = {each["name"]: sum(each["counts"].values()) for each in said}
    fired = {name.split("-", 2)[2] for name in TABLE if counts[name]}
    assert fired == {name.split("-", 2)[2] for name in TABLE}
    assert {each["verdict"] for each in said} == {"satisfied", "violated", "undecided", "rejected"}
    assert said_of(check_log(log).specifications) == said
    assert said_of(check_log(log, again=True).specifications) == said
    assert said_of(open_log(log).outcomes) == said
    evaluated = evaluate_log(log)
    outcomes = {each["name"]: each for each in said}
    for each in evaluated.specifications:
        assert (each.name, each.verdict) == (each.name, outcomes[each.name]["verdict"])
        if rows_found := {" and ".join(row.agents): row.verdict for row in each.rows if row.agents}:
            of_run = {row["agent"]: row["verdict"] for row in rows[PREFIX + each.name]}
            assert (each.name, of_run) == (each.name, rows_found)
    assert verify_log(log).is_equal


def test_a_row_begins_one_instance_however_many_events_fire_at_one_instant(tmp_path: Path) -> None:
    """Verdicts that begin with verdicts: each step would begin a multiple of the instances of the one before."""
    mutual = {
        name: {"formula": "min_separation > 0.6", "from": {"event": "satisfied", "of": "specifications.*"}}
        for name in ("one", "two", "three")
    }
    first = {"first": {"formula": "min_separation > 0.5"}}
    agents = {"robot": {**SCENARIO["agents"]["robot"], "components": {}}}
    path = tmp_path / "mutual.yaml"
    path.write_text(
        yaml.safe_dump(
            {**SCENARIO, "agents": agents, "topology": None, "faults": {}, "specifications": {**first, **mutual}}
        )
    )
    execute(build(path), tmp_path / "run.mcap")
    events = [(each.time, each.source) for each in open_log(tmp_path / "run.mcap").events() if each.name == "satisfied"]
    assert len(events) > 20
    assert len({*events}) == len(events)


@pytest.mark.parametrize("event", ["stepped", "updated", "sent"])
@pytest.mark.parametrize("kinds", ["notable", "none"])
def test_a_log_without_recurring_events_says_so(event: str, kinds: str, tmp_path: Path, doubles: Path) -> None:
    source = "environment" if event == "stepped" else "agents.*"
    specification = {"s": {"each": "robot", "formula": "x > 1", "from": {"event": event, "of": source}}}
    path = written(tmp_path, "synchronous", recording={"events": kinds}, specifications=specification)
    summary = execute(build(path), tmp_path / "run.mcap")
    with pytest.raises(LogError, match=f"leaves the event `{event}` out of the log; repeat the run with --again"):
        check_log(tmp_path / "run.mcap")
    assert check_log(tmp_path / "run.mcap", again=True).specifications == summary.specifications
