"""A switch changes the controller in force by conditions, and keeps each choice for its dwell time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT

import symaware_cli as sa

SIMPLEX = CHECKOUT / "scenarios" / "simplex.yaml"

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "switching",
    "seed": 1,
    "run": {"duration": 4.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 1,
            "model": {"use": "single-integrator"},
            "state": [0.0, 5.0],
            "components": {
                "sense": {"use": "perception.omniscient"},
                "guard": {"use": "control.switch", "with": {"when": "time % 1 >= 0.5 and y > 1", "to": "halt"}},
                "drive": {
                    "use": "control.schedule",
                    "condition": "switched[0] == 0",
                    "with": {"inputs": [{"time": 0.0, "input": [1.0, 0.0]}]},
                },
                "halt": {
                    "use": "control.schedule",
                    "condition": "switched[0] == 1",
                    "with": {"inputs": [{"time": 0.0, "input": [0.0, 0.0]}]},
                },
            },
        }
    },
}


def scenario(**given: Any) -> sa.Scenario:
    return sa.scenario(SCENARIO, {f"agents.robot.components.guard.with.{key}": value for key, value in given.items()})


def switched(tmp_path: Path, **given: Any) -> np.ndarray[Any, Any]:
    """Return at which tenths of a second the fallback of robot.0 is in force, each from 0 on."""
    series = scenario(**given).run(output=tmp_path / "switch.mcap").series("robot.0", "switched")
    instants = np.rint(np.asarray(series.times) / 1e8).astype(int)
    found = np.zeros(41, int)
    for instant, value in zip(instants, series.values[:, 0], strict=True):
        found[instant:] = int(value)
    return found


def test_the_condition_of_each_agent_decides_which_of_its_controllers_is_in_force(tmp_path: Path) -> None:
    found = switched(tmp_path)
    tenths = np.arange(41)
    assert found[:40].tolist() == (tenths % 10 >= 5).astype(int).tolist()[:40]
    with scenario().start() as run:
        run.step(40)
        assert run.state("robot")[:, 0] == pytest.approx([2.0])


def test_a_choice_stays_for_its_dwell_time(tmp_path: Path) -> None:
    found = switched(tmp_path, dwell=1.2, dwell_nominal=0.7)
    changes = np.flatnonzero(np.diff(found)) + 1
    lengths = np.diff(changes)
    assert (lengths[::2] >= 12).all()
    assert (lengths[1::2] >= 7).all()
    assert found[5:17].all()


def test_a_condition_has_to_be_confirmed(tmp_path: Path) -> None:
    assert np.flatnonzero(switched(tmp_path, confirm=0.3)).min() == 8
    assert not switched(tmp_path, confirm=0.6).any()


def test_the_way_back_has_a_condition_of_its_own(tmp_path: Path) -> None:
    found = switched(tmp_path, back="time > 2.25")
    assert found.tolist()[:32] == [0] * 5 + [1] * 18 + [0] * 2 + [1] + [0] + [1] + [0] + [1] + [0] + [0]


def test_a_run_continues_from_a_capture_while_a_dwell_time_lasts() -> None:
    with scenario(dwell=1.2, confirm=0.2).start() as run:
        run.step(9)
        assert run.awareness("robot.0", "switched")[0] == 1.0
        state = run.capture()
        run.step(20)
        then = run.state("robot").copy(), run.awareness("robot", "switched").copy()
        run.restore(state)
        run.step(20)
        assert np.array_equal(run.state("robot"), then[0])
        assert np.array_equal(run.awareness("robot", "switched"), then[1])


@pytest.mark.parametrize(
    ("changes", "path", "said"),
    [
        ({"guard.with.when": "robustness(seas) < 1"}, "guard.with.when", "seas"),
        ({"guard.with.when": "uncertanty > 1"}, "guard.with.when", "uncertanty"),
        ({"guard.with.back": "always risk > 1"}, "guard.with.back", "condition"),
        ({"guard.with.to": "hlt"}, "guard.with.to", "`hlt`"),
        ({"halt.condition": "risk > 1"}, "guard.with.to", "whatever the switch decides"),
        ({"guard.with.to": "sense", "sense.condition": "switched[0] == 1"}, "guard.with.to", "comes before the switch"),
    ],
)
def test_switches_that_cannot_work_are_refused(changes: dict[str, Any], path: str, said: str) -> None:
    with pytest.raises(sa.ScenarioError) as raised:
        sa.scenario(SCENARIO, {f"agents.robot.components.{key}": value for key, value in changes.items()})
    found = [(each.path, f"{each.message} {each.expected}") for each in raised.value.problems]
    assert any(place.endswith(path) and said in text for place, text in found), found


def test_the_robots_of_the_shipped_scenario_stay_apart_with_the_switch_alone() -> None:
    with_switch = sa.load(SIMPLEX).run(duration=10.0, record=False).summary
    without = (
        sa.load(SIMPLEX, {"agents.watcher.components.guard.with.confirm": 100.0})
        .run(duration=10.0, record=False)
        .summary
    )
    apart = [
        next(each.verdict for each in summary.specifications if each.name == "apart")
        for summary in (with_switch, without)
    ]
    assert apart == ["satisfied", "violated"]
