"""The controller plans, sets uncertainty and risk, keeps to its budget, and refuses unsuitable groups."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from symaware_cli.testing import assert_repeatable

if TYPE_CHECKING:
    from simulating import Command

    from tests.conftest import Flight, Fly

AVOIDANCE = "intent-avoidance.yaml"
CONTROLLER = "agents.ownship.components.steer.with"


def series(flight: Flight, kind: str) -> dict[int, NDArray[np.float64]]:
    """The values of a series of the ownship, by the second at which it was set."""
    messages = flight.log.messages(f"/agents/ownship/{kind}")
    return {message.time // 10**9: np.asarray(message.decode().values) for message in messages}


def test_the_intent_is_the_plan_and_the_next_state_is_its_second(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml")
    plans = series(flight, "intent")
    assert {plan.shape for plan in plans.values()} == {(31, 3)}
    for k, plan in plans.items():
        np.testing.assert_allclose(plan[0], flight.own[k], atol=1e-6)
        np.testing.assert_allclose(plan[1], flight.own[k + 1], atol=1e-6)


def test_the_uncertainty_is_a_named_position_for_each_scenario_at_the_times_of_the_plan(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml")
    metadata = flight.log.channels["/agents/ownship/uncertainty"].metadata
    names = [f"{axis}.{j}" for j in range(28) for axis in "xy"]
    assert (metadata["columns"], metadata["units"]) == (",".join(names), ",".join(["m"] * 56))
    for k, fan in series(flight, "uncertainty").items():
        assert fan.shape == (31, 56)
        np.testing.assert_allclose(fan[0], np.tile(flight.intruder[k, :2], 28), atol=1e-9)


def test_the_plan_keeps_the_separation_from_every_scenario_that_counts(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml")
    plans, fans = series(flight, "intent"), series(flight, "uncertainty")
    for k in range(1, 82):
        scenarios = fans[k].reshape(31, 28, 2)
        separation = np.hypot(*(scenarios - plans[k][:, None, :2]).transpose(2, 0, 1))
        assert separation[1:-1].min() >= 44.7213
        assert separation[-1, -1] >= 44.7213


def test_the_risk_is_the_share_of_scenarios_within_the_margin(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml")
    plans, fans, risks = (series(flight, kind) for kind in ("intent", "uncertainty", "risk"))
    shares = {}
    for k, plan in plans.items():
        separation = np.hypot(*(fans[k].reshape(31, 28, 2) - plan[:, None, :2]).transpose(2, 0, 1)).min(axis=0)
        shares[k] = np.mean(separation < 60.0)
        assert risks[k].tolist() == [[pytest.approx(shares[k])]]
    assert shares[81] == 0.0
    assert max(shares.values()) > 0.5


def test_an_agent_that_does_not_avoid_others_still_estimates_the_risk(fly: Fly) -> None:
    assert series(fly("no-avoidance.yaml"), "risk")[38] == [[1.0]]


def test_a_budget_that_is_too_small_falls_back_to_the_shifted_plan_with_an_event(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml", f"{CONTROLLER}.iterations=12", "run.duration=20")
    fallen = {event.time // 10**9: event for event in flight.events("fell-back")}
    assert 0 in fallen
    event = fallen[0]
    assert (event.source, event.level) == ("agents.ownship.steer", "WARNING")
    # Of the first solver from eight guesses, the last of them a safe manoeuvre, and the second from one; solvers may
    # count one more.
    assert 9 * 12 <= event.data["iterations"] <= 9 * 13
    # The first plan is to fly straight on at full speed.
    np.testing.assert_allclose(flight.own[1], (9, 0, 0), atol=1e-9)
    plans = series(flight, "intent")
    for k in fallen.keys() - {0}:
        np.testing.assert_allclose(plans[k][:-1], plans[k - 1][1:], atol=1e-9)
    assert len(fallen) < 20, "it never recovers"


def test_a_run_without_failures_has_no_such_event(fly: Fly) -> None:
    flight = fly("intent-avoidance.yaml")
    assert flight.events("fell-back") == flight.events("too-close") == []


def test_steps_nearer_than_the_separation_are_events_and_the_summary_counts_them_with_the_fall_backs(
    fly: Fly, command: Command, scenarios: Path
) -> None:
    overrides = [f"{CONTROLLER}.robust_horizon=0"]
    flight = fly("noisy.yaml", *overrides, seed=5)
    close = {event.time // 10**9: event.data["distance"] for event in flight.events("too-close")}
    # What the controller perceives is the world before it acts: the last state is nobody's any more.
    expected = {k: d for k, d in enumerate(flight.separation[:-1]) if d < 44.72}
    assert close == pytest.approx(expected)
    assert close
    sets = [word for override in overrides for word in ("--set", override)]
    line = ["run", scenarios / "noisy.yaml", "--seed", 5, "--no-record", *sets]
    summary = json.loads(command(*line, "--json").stdout)
    assert summary["warnings"] == {"fell-back": len(flight.events("fell-back"))}
    assert summary["errors"] == {"too-close": len(close)}
    printed = command(*line).stdout
    assert f"{summary['warnings']['fell-back']} fell-back" in printed
    assert f"{len(close)} too-close" in printed


def test_an_agent_that_need_not_keep_clear_is_never_too_close(fly: Fly) -> None:
    flight = fly("no-avoidance.yaml")
    assert flight.separation.min() < 44.0
    assert flight.events("too-close") == []


def test_speed_and_turn_rate_stay_within_the_limits_of_the_model_and_tighter_ones(fly: Fly) -> None:
    control = fly("intent-avoidance.yaml").log.series("ownship", "requested_control").values
    assert (control >= np.array([6.0, -0.1]) - 1e-6).all()
    assert (control <= np.array([9.0, 0.1]) + 1e-6).all()
    tighter = fly(
        "demo.yaml", f"{CONTROLLER}.max_speed=8", f"{CONTROLLER}.max_turn_rate=0.05", "run.duration=20"
    ).log.series("ownship", "requested_control")
    assert tighter.values[:, 0].max() <= 8.0 + 1e-6
    assert np.abs(tighter.values[:, 1]).max() <= 0.05 + 1e-6


def test_a_horizon_of_one_step_works(fly: Fly) -> None:
    fly("demo.yaml", f"{CONTROLLER}.horizon=1", "run.duration=5")


def test_on_a_virtual_clock_and_at_a_pace_it_flies_the_same(fly: Fly) -> None:
    flight = fly("demo.yaml")
    paced = fly("demo.yaml", "run.mode=asynchronous", "run.pace=100", "run.duration=20")
    np.testing.assert_array_equal(paced.own, flight.own[:21])


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["agents.ownship.knowledge.target=[420, 560]"], "`target` must be x [m], y [m] and heading [rad]"),
        (
            ["agents.ownship.model={use: single-integrator}", "agents.ownship.state=[0, 0]"],
            "the model must have the state x, y, heading",
        ),
        ([f"{CONTROLLER}.max_speed=5"], "no speed or no turn rate is left"),
        ([f"{CONTROLLER}.third_branch=fourth"], "paper"),
    ],
)
def test_unsuitable_models_and_knowledge_are_refused_before_the_run(
    overrides: Sequence[str], said: str, command: Command, scenarios: Path
) -> None:
    done = command("validate", scenarios / AVOIDANCE, *(word for override in overrides for word in ("--set", override)))
    assert done.returncode == 2
    assert said in done.stderr


def test_the_noisy_encounter_can_be_repeated(scenarios: Path) -> None:
    assert_repeatable(scenarios / "noisy.yaml", ["run.duration=30"])
