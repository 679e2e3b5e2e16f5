"""For failed and interrupted runs, all readers agree with the run on its specifications."""

from pathlib import Path
from typing import Any

import pytest
import yaml

import symaware_cli as sa
from symaware_cli.log import overview_of

SPECIFICATIONS = {
    "slow": {"each": "robot", "formula": "always speed < 0.5"},
    "near": {"each": "robot", "formula": "always norm(position) < 1.2"},
    "soon": {"each": "robot", "formula": "eventually[0, 0.2] norm(position) > 1.4"},
    "short": {"formula": "always time < 0.15"},
    "after": {
        "each": "robot",
        "from": {"event": "violated", "of": "specifications.short"},
        "formula": "always x > 1.1",
    },
    "long": {"each": "robot", "logic": "ltl", "formula": "always (eventually x > 1.1)"},
}


def scenario(mode: str, *components: Any, world: Any = None, **sections: Any) -> dict[str, Any]:
    content: dict[str, Any] = {
        "symaware": 1,
        "name": "failing",
        "run": {"duration": 0.4, "mode": mode},
        "environment": world or {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {
            "robot": {
                "count": 2,
                "entity": {"shape": {"circle": {"radius": 0.1}}},
                "model": {"use": "single-integrator"},
                "state": {"each": [[1.0, 0.0], [1.0, 1.0]]},
                "knowledge": {"goal": {"all": [3, 0]}},
                "components": {
                    "sense": {"use": "perception.omniscient"},
                    "steer": {"use": "control.go-to-goal"},
                    **{f"bad{number}": use for number, use in enumerate(components)},
                },
            }
        },
        "specifications": SPECIFICATIONS,
    }
    return content | sections


def fault(**parameters: Any) -> Any:
    return {"use": "doubles.fault", "with": parameters}


def world(**parameters: Any) -> Any:
    return {"use": "doubles.faulty-world", "with": {"time_step": 0.1, **parameters}}


def refused(event: str, of: str = "*") -> Any:
    return {"subscribers": {"it": {"use": "doubles.refuse", "event": event, "of": of}}}


FAILURES: dict[str, dict[str, Any]] = {
    **{
        f"{where} at {at} of {agent}": {"component": fault(where=where, at=at, agent=agent)}
        for where in ("compute", "update")
        for at in (0.0, 0.2, 0.3)
        for agent in ("robot.0", "robot.1")
    },
    "initialise": {"component": fault(where="initialise")},
    "its subscriber": {"component": fault(where="subscriber", at=0.1)},
    "exit": {"component": fault(where="exit", at=0.1)},
    "a late turn": {"component": {**fault(at=0.0), "offset": 0.4}},
    "a turn with latency": {"component": {**fault(where="update", at=0.0), "latency": 0.15}},
    "nan": {"component": fault(value="nan", at=0.2)},
    **{
        f"the world's {where} at {at}": {"world": world(where=where, at=at)}
        for where in ("step", "state", "snapshot", "contacts", "nan")
        for at in (0.0, 0.2, 0.3, 0.4)
        if (where, at) != ("state", 0.0)  # with which no scenario is valid
    },
    **{
        f"a subscriber to {event} of {of}": refused(event, of)
        for event, of in [
            ("started", "*"),
            ("computed", "*"),
            ("stepped", "*"),
            ("stepping", "*"),
            ("iterating", "*"),
            ("iterated", "*"),
            ("violated", "specifications.slow"),
            ("violated", "specifications.short"),
            ("violated", "specifications.soon"),
            ("satisfied", "*"),
            ("finished", "*"),
        ]
    },
    "a specification at once": {"valueless": "1 / time > 0"},
    "a specification later": {"valueless": "1 / (time - 0.2) > -100"},
    "the end": {"run": {"until": "1 / (time - 0.2) > 100"}},
}


def outcomes(specifications: Any) -> list[Any]:
    return [each.to_json() for each in specifications]


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize("what", FAILURES)
def test_check_agrees_with_a_failed_run(what: str, mode: str, tmp_path: Path, doubles: Path) -> None:
    failure = dict(FAILURES[what])
    components = [failure.pop("component")] if "component" in failure else []
    content = scenario(mode, *components, world=failure.pop("world", None))
    if "valueless" in failure:
        # Failures before and after other components, whose values all count.
        wrong = {"formula": f"always {failure.pop('valueless')}"}
        content["specifications"] = {"first": SPECIFICATIONS["slow"], "wrong": wrong, **SPECIFICATIONS}
    content["run"] |= failure.pop("run", {})
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump(content | failure))
    log = tmp_path / "s.mcap"
    try:
        result = sa.Scenario(path).run(output=log)
    except sa.RunFailedError as error:
        result = error.run
    expected = outcomes(result.summary.specifications)
    assert result.log.outcome
    assert result.status == result.log.outcome["status"]
    assert outcomes(sa.check_log(log).specifications) == expected
    assert outcomes(overview_of(sa.open_log(log)).specifications) == expected
    assert sa.verify_log(log).is_equal
    if what == "compute at 0.2 of robot.1":
        page = tmp_path / "page.html"
        sa.write_report(log, page)
        text = page.read_text()
        assert all(f">{each.verdict}</b>" in text for each in result.summary.specifications)


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize("steps", range(5))
def test_check_agrees_with_an_interrupted_run(steps: int, mode: str, tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump(scenario(mode)))
    with sa.Scenario(path).start(output=tmp_path / "s.mcap") as simulation:
        if steps:
            simulation.step(steps)
    expected = outcomes(simulation.result.summary.specifications)
    assert outcomes(sa.check_log(tmp_path / "s.mcap").specifications) == expected


def test_a_sweep_with_failed_runs_is_sound(tmp_path: Path, doubles: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump(scenario("synchronous", fault(at=0.2))))
    over = {"agents.robot.components.bad0.with.at": [0.0, 0.2, 9.0]}
    table = sa.sweep(path, tmp_path / "out", over=over, keep="all")
    assert table["state"].to_pylist() == ["failed", "failed", "done"]
    assert not sa.verify_sweep(tmp_path / "out", "all").findings
