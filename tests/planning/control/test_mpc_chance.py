"""Chance constraints of `control.mpc`: what a plan keeps away, what risk is counted, and what if there is no plan."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.stats import norm

pytest.importorskip("casadi", reason="CasADi is an extra")

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError

Array = NDArray[np.float64]

STEP, NOISE, STEPS, RISK = 0.1, 0.1, 5, 0.05


def scenario(formula: str, *, duration: float = STEP, state: Any = (0.0, 0.0), **steer: Any) -> dict[str, Any]:
    """A robot that is drawn along x, in noise."""
    given = {"horizon": STEPS * STEP, "steps": STEPS, "speed": 2.0, "neighbours": 0, "correction": 0.0}
    chance = {"specifications": ["safe"], "maximal_risk": RISK, "risk_allocation": "uniform"}
    return {
        "symaware": 1,
        "name": "wall",
        "seed": 1,
        "run": {"duration": duration},
        "environment": {"use": "kinematic", "with": {"time_step": STEP}},
        "regions": {"pond": {"circle": {"centre": [1, 0], "radius": 0.3}}},
        "specifications": {"safe": {"each": "robot", "formula": formula}},
        "agents": {
            "robot": {
                "model": {"use": "single-integrator", "with": {"max_speed": 2.0, "process_noise": NOISE}},
                "state": list(state),
                "knowledge": {"goal": [5, 0]},
                "components": {
                    "sense": {"use": "perception.self"},
                    "steer": {"use": "control.mpc", "with": {**given, **chance, **steer}},
                },
            }
        },
    }


def run(folder: Path, content: dict[str, Any]) -> tuple[Array, Array, list[Any]]:
    """The first plan (steps + 1, 2), the risk planned and spent at each step, and the controller's events."""
    (folder / "wall.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    log = folder / "wall.mcap"
    log.unlink(missing_ok=True)
    assert execute(build(folder / "wall.yaml"), log).status == "finished"
    read = open_log(log)
    events = [event for event in read.events() if event.source == "agents.robot.steer"]
    plan = next((each.values for each in read.predictions("robot", "intent")), np.empty((0, 2)))
    return plan, read.series("robot", "steer.risk_budget").values, events


def test_a_plan_keeps_away_by_the_quantile_of_its_part_of_the_risk(tmp_path: Path) -> None:
    plan, risk, events = run(tmp_path, scenario("always x < 0.6", duration=STEPS * STEP))
    deviations = NOISE * np.sqrt(STEP * np.arange(1, STEPS + 1))
    limits = 0.6 - norm.isf(0.98 * RISK / STEPS) * deviations
    assert not events
    assert (plan[1:, 0] <= limits).all()
    assert plan[-1, 0] == pytest.approx(limits[-1], abs=1e-3)
    assert risk[0, 0] == pytest.approx(norm.sf((0.6 - plan[1:, 0]) / deviations).sum())
    assert risk[0, 1] == pytest.approx(norm.sf((0.6 - plan[1, 0]) / deviations[0]))


def test_a_bound_without_a_distribution_keeps_farther_away(tmp_path: Path) -> None:
    part = 0.98 * RISK / STEPS
    content = scenario("always x < 1.0", duration=STEPS * STEP, risk_bound="chebyshev", input_weight=1e-4)
    plan, _, events = run(tmp_path, content)
    assert not events
    away = np.sqrt((1 - part) / part) * NOISE * np.sqrt(STEP * STEPS)
    assert plan[-1, 0] == pytest.approx(1.0 - away, abs=1e-3)


def test_iterative_allocation_goes_nearer_at_no_more_risk(tmp_path: Path) -> None:
    ends = {}
    for allocation in ("uniform", "iterative"):
        plan, risk, _ = run(tmp_path, scenario("always x < 0.6", duration=0.5, risk_allocation=allocation))
        ends[allocation] = plan[-1, 0]
        assert risk[0, 0] <= RISK
    assert ends["iterative"] > ends["uniform"] + 0.01


def test_each_plan_may_take_its_share_of_the_rest_of_the_run(tmp_path: Path) -> None:
    """With a run twice as long as the horizon, a plan has half of the risk, also for staying where it ends."""
    plan, _, _ = run(tmp_path, scenario("always x < 0.6", duration=2 * STEPS * STEP))
    away = norm.isf(0.98 * RISK / 2 / (2 * STEPS)) * NOISE * np.sqrt(2 * STEP * STEPS)
    assert plan[-1, 0] == pytest.approx(0.6 - away, abs=1e-3)


@pytest.mark.parametrize("steps", [1, 3, 12])
def test_the_rest_of_a_plan_is_affordable_at_every_turn_whatever_the_horizon(tmp_path: Path, steps: int) -> None:
    content = scenario("always x < 0.6", duration=2.0, correction=2.0, horizon=steps * STEP, steps=steps)
    for seed in range(2):
        content["seed"] = seed
        _, risk, events = run(tmp_path, content)
        assert "infeasible" not in {event.name for event in events}
        assert risk[0, 0] <= RISK


@pytest.mark.parametrize("runs", [3, pytest.param(150, marks=pytest.mark.slow)])
def test_the_risk_counted_in_runs_is_no_more_than_allowed_on_average(tmp_path: Path, runs: int) -> None:
    """Until it is violated. In a single run it may be more, after gusts; the account has included that."""
    content = scenario("always x < 0.6", duration=1.5, risk_allocation="iterative", correction=2.0)
    spent = []
    for seed in range(runs):
        _, risk, events = run(tmp_path, {**content, "seed": seed})
        assert (np.diff(risk[:, 1]) >= 0.0).all()
        assert not events
        beyond = open_log(tmp_path / "wall.mcap").series("robot", "state").values[:-1, 0] >= 0.6
        spent.append(risk[beyond.argmax() - 1 if beyond.any() else -1, 1])
    # The mean of so many runs exceeds that of all by 2.6 standard errors once in 200 times.
    error = np.std(spent, ddof=1) / np.sqrt(runs)
    assert 0.001 < np.mean(spent) <= RISK + 2.6 * error


def test_a_window_that_is_over_no_longer_holds_the_agent_back(tmp_path: Path) -> None:
    content = scenario("always[0, 0.3] x < 0.1", duration=1.0)
    plan, risk, events = run(tmp_path, content)
    assert not events
    assert plan[3, 0] < 0.1 < plan[4, 0]
    assert (risk[4:, 0] == 0.0).all()


@pytest.mark.parametrize(
    ("formula", "keeps"),
    [
        ("always not inside(position, pond)", lambda plan: np.hypot(plan[:, 0] - 1, plan[:, 1]) > 0.3),
        ("always (x < 0.5 or y > 0.2)", lambda plan: (plan[:, 0] < 0.5) | (plan[:, 1] > 0.2)),
        ("always not (x > 0.4 and y < 3)", lambda plan: plan[:, 0] < 0.4),
        ("not eventually 2 * x - y > 1", lambda plan: 2 * plan[:, 0] - plan[:, 1] < 1),
        ("always[0, 9] always[0, 1] -1 < y < 0.5 and always x < 0.5", lambda plan: plan[:, 0] < 0.5),
    ],
)
def test_a_kept_condition_may_be_piecewise_linear(tmp_path: Path, formula: str, keeps: Any) -> None:
    plan, risk, events = run(tmp_path, scenario(formula, duration=1.0))
    assert not events
    assert keeps(plan).all()
    assert risk[0, 0] > 1e-6


@pytest.mark.parametrize(("fallback", "second"), [("best-effort", -0.2), ("slow-down", 0.0)])
def test_a_violated_condition_is_named_with_its_time_and_the_fallback_acts(
    tmp_path: Path, fallback: str, second: float
) -> None:
    """One step is too short for a distance that so little risk needs."""
    content = scenario("always[0.1, 0.1] x < -0.15", duration=0.1, fallback=fallback)
    (tmp_path / "near").mkdir()
    (event,) = (each for each in run(tmp_path / "near", content)[2] if each.name == "infeasible")
    assert event.data["specification"] == "safe"
    assert event.data["time"] == pytest.approx(STEP)
    assert event.data["risk"] > event.data["allowed"]
    assert event.data["spent"] == 0.0
    applied = open_log(tmp_path / "near" / "wall.mcap").series("robot", "requested_control").values[0, 0] * STEP
    assert applied == pytest.approx(second, abs=1e-6)


@pytest.mark.parametrize(
    ("formula", "changes", "said"),
    [
        ("eventually x > 1", {}, "only `always`"),
        ("always (x > 1 implies eventually x < 0)", {}, "only `always`"),
        ("always speed < 1", {}, "not linear in the state"),
        ("always x < 1", {"steps": 2}, "as long as those of the world, 0.1 s"),
        ("always x < 1", {"specifications": []}, "needs `specifications`"),
        ("always x < 1", {"maximal_risk": None}, "needs a `maximal_risk`"),
        ("always x < 1", {"specifications": ["save"]}, "did you mean `safe`"),
    ],
)
def test_an_unsuitable_chance_constraint_is_refused_in_the_file(
    tmp_path: Path, formula: str, changes: dict[str, Any], said: str
) -> None:
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(scenario(formula, **changes), sort_keys=False))
    with pytest.raises(ScenarioError, match=said):
        build(tmp_path / "bad.yaml")


def test_a_model_that_is_not_linear_is_refused(tmp_path: Path) -> None:
    content = scenario("always x < 1")
    content["agents"]["robot"] |= {"model": {"use": "unicycle"}, "state": [0, 0, 0]}
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(ScenarioError, match="only with a model that is linear"):
        build(tmp_path / "bad.yaml")
