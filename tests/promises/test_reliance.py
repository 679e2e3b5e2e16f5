"""Predictions, maps and filters that rely on promises."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from promising import promising

import symaware_cli as sa
from symaware_cli.core import Confined
from symaware_cli.geometry import Pieces, separation_from_points


def test_a_point_in_a_convex_set_gets_no_farther_from_a_confined_prediction() -> None:
    random = np.random.default_rng(3)
    pieces = [
        ([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)], 0.0),
        ([(1.0, 2.0)], 1.5),
        ([(0.0, 0.0), (3.0, 1.0)], 0.5),
    ]
    for piece in pieces:
        sets = Pieces.of([piece])
        truth = random.uniform(-2.0, 4.0, (200, 2))
        within = separation_from_points(truth, np.zeros(200), sets.take(np.zeros(200, np.intp))).distance <= 0.0
        truth = truth[within]
        predicted = random.uniform(-6.0, 8.0, (len(truth), 1, 2))
        moved = Confined(np.array([0]), sets, np.array([0.01])).nearest(predicted)
        before, after = (np.hypot(*(each[:, 0] - truth).T) for each in (predicted, moved))
        assert (after <= before + 1e-12).all()
        outside = separation_from_points(moved[:, 0], np.zeros(len(truth)), sets.take(np.zeros(len(truth), np.intp)))
        assert (outside.distance <= 1e-9).all()


def test_a_map_is_evaluated_only_where_the_other_could_be_touched(tmp_path: Path) -> None:
    content = promising(speed=0.6)
    content["agents"]["bob"]["components"]["map"] = {
        "use": "risk.map",
        "with": {"within": [-1.0, 3.0, -1.0, 1.0], "reach": 20.0, "least": 0.005, "record": 0.1},
    }
    counts, maps = {}, {}
    for counted in ("ignored", "paid", "if-kept"):
        content["agents"]["bob"]["components"]["map"]["with"]["promises"] = counted
        sa.scenario(content).run(output=tmp_path / "run.mcap", duration=0.5)
        log = sa.open_log(tmp_path / "run.mcap")
        counts[counted] = log.series("bob", "map.evaluations").values[-1, 0]
        maps[counted] = list(log.tables("bob", "map.map"))[-1].values
    # Cells up to the sum of both radii, 0.8 m, from the edge of the region at 0.
    assert counts == {"ignored": 8 * 4, "paid": 4 * 4, "if-kept": 4 * 4}
    beyond = {key: each[each[:, 0] >= 1.0, 4] for key, each in maps.items()}
    assert beyond["ignored"].max() > 0.5
    assert np.allclose(beyond["paid"], 0.01)
    assert len(beyond["paid"]) == 16
    assert len(beyond["if-kept"]) == 0


def _filtered(content: dict[str, Any]) -> float:
    """Return the deviation of Bob's velocity from his request to drive straight past the region [m/s]."""
    with sa.scenario(content).start() as run:
        greatest = 0.0
        for _ in range(14):
            run.step()
            greatest = max(greatest, float(np.abs(run.control("bob") - [0.0, 1.0]).max()))
        return greatest


def test_the_barrier_filter_passes_beside_the_region_of_an_oncoming_agent() -> None:
    content = promising(speed=0.66)
    bob = content["agents"]["bob"]
    bob["state"] = [1.1, -1.4]
    bob["components"] = {
        "see": {"use": "perception.range", "with": {"range": 20.0}},
        "promises": {"use": "promises.monitor"},
        "drive": {"use": "control.schedule", "with": {"inputs": [{"time": 0.0, "input": [0.0, 1.0]}]}},
        "safe": {"use": "control.barrier-filter", "with": {"cooperative": False, "margin": 0.1}},
    }
    relying = _filtered(content)
    content["promises"] = {}
    assert relying < 0.05 < 0.2 < _filtered(content)


def planning(**given: Any) -> dict[str, Any]:
    """Return a scenario in which Bob passes beside the region with a maximal risk of coming closer than 1 m to Adam."""
    content = promising()
    drive = content["agents"]["adam"]["components"]["drive"]["with"]
    drive["inputs"] = [{"time": 0.0, "input": [0.8, 0.0]}, {"time": 1.1, "input": [0.0, 0.0]}]
    plan = {"specifications": ["apart"], "maximal_risk": 0.05, "horizon": 1.5, "steps": 15, "neighbours": 0, **given}
    content["agents"]["bob"] |= {
        "state": [1.6, -2.0],
        "model": {"use": "single-integrator", "with": {"max_speed": 1.0, "process_noise": 0.03}},
        "knowledge": {"goal": [1.6, 3.0]},
        "components": {
            "see": {"use": "perception.range", "with": {"range": 20.0, "position_noise": 0.05, "velocity_noise": 0.1}},
            "filter": {"use": "uncertainty.gaussian"},
            "promises": {"use": "promises.monitor"},
            "plan": {"use": "control.mpc", "with": plan},
        },
    }
    content["specifications"] = {"apart": {"pairs": [["adam", "bob"]], "formula": "always distance > 1"}}
    content["run"]["duration"] = 3.0
    return content


def planned(content: dict[str, Any], folder: Path) -> tuple[float, float, list[str]]:
    """Return how far Bob swerves [m], the risk spent after the first step, and what is said about reliance."""
    sa.scenario(content).run(output=folder / "run.mcap")
    log = sa.open_log(folder / "run.mcap")
    swerve = float(np.abs(log.series("bob", "state").values[:, 0] - 1.6).max())
    said = [each.text for each in log.events() if each.name == "promise-relied-on"]
    return swerve, float(log.series("bob", "plan.risk_budget").values[0, 1]), said


def test_a_maximal_risk_pays_for_the_promises_that_its_plans_rely_on(tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    found = {each: planned(planning(promises=each), tmp_path) for each in ("ignored", "paid", "if-kept")}
    assert found["paid"][0] < 0.7 * found["ignored"][0]
    assert found["if-kept"][0] < 0.7 * found["ignored"][0]
    assert found["paid"][1] - found["if-kept"][1] == pytest.approx(0.01)
    assert found["paid"][2] == ["relies on `stay` of adam: `plan` includes 0.01 for it"]
    assert found["if-kept"][2] == ["relies on `stay` of adam: `plan` holds if it is kept"]
    assert found["ignored"][2] == []


def test_promises_that_cost_all_of_a_maximal_risk_do_not_count(tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    content = planning(maximal_risk=0.01)
    content["run"]["duration"] = 0.3
    _, spent, said = planned(content, tmp_path)
    assert spent < 0.01
    assert said == []


def test_a_plan_is_paid_anew_when_a_promise_is_not_relied_on_any_more() -> None:
    pytest.importorskip("casadi")
    content = planning()
    content["agents"]["adam"]["components"]["drive"]["with"]["inputs"] = [{"time": 0.0, "input": [2.5, 0.0]}]
    with sa.scenario(content).start() as run:
        component = next(each for each in run._simulation.entries if each.name == "plan").components[0]
        run.step(2)
        assert len(vars(component)["_relied"]) == 1
        run.step(6)
        assert run.awareness("bob", "trust").tolist() == [0.0, 0.0]
        assert vars(component)["_relied"] == ()


def test_an_expected_place_outside_of_the_region_is_moved_to_its_edge() -> None:
    content = promising(speed=0.6)
    bob = content["agents"]["bob"]
    bob["components"] = {
        "see": {"use": "perception.range", "with": {"range": 20.0}},
        "promises": {"use": "promises.monitor"},
        "risk": {
            "use": "risk.specification",
            "with": {"specifications": ["apart"], "horizon": 4.0, "samples": 10},
        },
    }
    content["specifications"] = {"apart": {"pairs": [["adam", "bob"]], "formula": "always distance > 1"}}
    with sa.scenario(content).start() as run:
        run.step(2)
        assert abs(float(run.awareness("bob", "risk")[0]) - 0.01) < 1e-12
    content["promises"] = {}
    with sa.scenario(content).start() as run:
        run.step(2)
        assert float(run.awareness("bob", "risk")[0]) == 1.0
