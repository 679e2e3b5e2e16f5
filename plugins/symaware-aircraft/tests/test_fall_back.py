"""Where no plan is found, a manoeuvre keeps the distance if one exists; a run that comes too close exits with 3."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray
from symaware_aircraft.manoeuvres import clearance, manoeuvres, safest
from symaware_aircraft.prediction import rollout
from symaware_aircraft.tree import ScenarioTree

from symaware_cli.engine.models.aircraft import DubinsAircraft
from symaware_cli.planning.optimal_control import Plan
from symaware_cli.planning.optimal_control.dynamics import Dynamics

if TYPE_CHECKING:
    from simulating import Command

    from tests.conftest import Fly

Array = NDArray[np.float64]

RHO = 44.72135955
STEER = "agents.ownship.components.steer.with"
#: Where the encounter of without-intent.yaml begins for the ownship, x [m], y [m] and heading [rad].
STARTS = [(x, 230.0, -1.5707963) for x in (-8.0, 0.0, 2.0, 4.0, 5.0, 6.0, 8.0, 12.0)]
HORIZONS = (0, 1, 2, 3)
#: Encounters in which plans that are found lead to where no manoeuvre keeps the distance.
TRAPPED = {(12.0, 1), (12.0, 2)}


def keeps_apart(fly: Fly, start: tuple[float, float, float], robust_horizon: int, *others: str) -> None:
    flight = fly(
        "without-intent.yaml",
        f"agents.ownship.state={list(start)}",
        f"{STEER}.robust_horizon={robust_horizon}",
        *others,
    )
    assert flight.separation.min() >= RHO - 1e-4
    assert flight.events("too-close") == []


def test_a_head_on_encounter_without_a_robust_plan_keeps_the_distance(fly: Fly) -> None:
    start = (5.0, 230.0, -1.5707963)
    keeps_apart(fly, start, 3, f"{STEER}.iterations=20", "run.duration=20")
    overrides = (f"agents.ownship.state={list(start)}", f"{STEER}.robust_horizon=3", f"{STEER}.iterations=20")
    fallen = fly("without-intent.yaml", *overrides, "run.duration=20").events("fell-back")
    assert fallen, "it does not show the fall-back"
    assert all(("can be kept" in event.text) == (event.data["clearance"] < RHO) for event in fallen)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "robust_horizon"),
    # Every start with every second horizon, in turn the even and the odd ones.
    [
        (start, horizon)
        for (place, start), horizon in product(enumerate(STARTS), HORIZONS)
        if (start[0], horizon) not in TRAPPED and (place + horizon) % 2
    ],
)
def test_encounters_keep_the_distance(fly: Fly, start: tuple[float, float, float], robust_horizon: int) -> None:
    keeps_apart(fly, start, robust_horizon)


@pytest.mark.slow
@pytest.mark.parametrize(("x", "robust_horizon"), sorted(TRAPPED))
def test_plans_that_lead_too_close_are_reported_as_errors(fly: Fly, x: float, robust_horizon: int) -> None:
    start = next(each for each in STARTS if each[0] == x)
    overrides = (f"agents.ownship.state={list(start)}", f"{STEER}.robust_horizon={robust_horizon}")
    flight = fly("without-intent.yaml", *overrides)
    assert (flight.separation[:-1].min() < RHO - 1e-4) == bool(flight.events("too-close"))


@pytest.mark.slow
@pytest.mark.parametrize("start", [(5.0, 170.0, -1.5707963), (30.0, 230.0, -1.5707963)])
def test_an_agent_that_starts_too_near_or_is_followed_reports_that_it_is_too_close(
    fly: Fly, start: tuple[float, float, float]
) -> None:
    """The intruder turns towards it all the time, which is more than the scenario tree assumes."""
    overrides = (f"agents.ownship.state={list(start)}", f"{STEER}.robust_horizon=3", f"{STEER}.iterations=20")
    flight = fly("without-intent.yaml", *overrides)
    assert flight.separation.min() < RHO
    least = min(event.data["clearance"] for event in flight.events("fell-back"))
    # What the simulation of the manoeuvres says is kept.
    assert flight.separation.min() == pytest.approx(least, abs=0.5)


def test_a_run_that_comes_too_close_exits_with_3_and_counts_the_steps(command: Command, scenarios: Path) -> None:
    """They start so near to each other that nothing helps."""
    sets = ["--set", "agents.ownship.state=[5, 60, -1.5707963]", "--set", f"{STEER}.iterations=20"]
    line = ["run", scenarios / "without-intent.yaml", "--no-record", "--set", "run.duration=6", *sets]
    done = command(*line, "--json")
    assert done.returncode == 3, done.stderr
    summary = json.loads(done.stdout)
    assert summary["errors"]["too-close"] > 0
    assert summary["warnings"]["fell-back"] > 0
    assert "too-close" in command(*line).stdout


def encounter(seed: int) -> tuple[Array, Plan, Array, tuple[Array, Array], Array]:
    """A state, the rest of a plan, scenarios, which of them count, and the control inputs of the manoeuvres."""
    draw = np.random.default_rng(seed)
    steps, tree = 20, ScenarioTree(20, int(draw.integers(0, 3)), 0.07, "paper")
    other = np.array([*draw.uniform(-150, 150, 2), draw.uniform(-np.pi, np.pi)])
    scenarios = rollout(other, 10.0, tree.turn_rates(draw.uniform(-0.05, 0.05, steps)), 1.0)[:, :, :2]
    dynamics = Dynamics(
        DubinsAircraft(DubinsAircraft.Parameters(min_speed=6.0, max_speed=9.0, max_turn_rate=0.1)), 1.0, "euler"
    )
    inputs = np.column_stack([draw.uniform(6, 9, steps), draw.uniform(-0.1, 0.1, steps)])
    state = np.array([0.0, 0.0, draw.uniform(-np.pi, np.pi)])
    rest = Plan(dynamics.rollout(state, inputs), inputs, dynamics, steps)
    bounds = np.array([6.0, -0.1]), np.array([9.0, 0.1])
    return state, rest, scenarios, tree.counting, manoeuvres(bounds, steps)


@pytest.mark.parametrize("seed", range(30))
def test_the_chosen_motion_keeps_the_distance_whenever_one_does(seed: int) -> None:
    state, rest, scenarios, counting, inputs = encounter(seed)
    plan, kept = safest(state, inputs, rest, scenarios, counting, RHO, np.array([0.0, -200.0]))
    # Simulated one by one, here.
    least = []
    for sequence in (rest.inputs, *inputs):
        motion = rollout(state, sequence[:, 0], sequence[None, :, 1], 1.0)[0, :, :2]
        least.append(min(np.hypot(*(motion[1:] - each[1:]).T).min() for each in scenarios))
    own = rollout(state, plan.inputs[:, 0], plan.inputs[None, :, 1], 1.0)[0]
    np.testing.assert_allclose(plan.states, own, atol=1e-9)
    assert kept == pytest.approx(clearance(own[None], scenarios, counting)[0])
    assert kept == pytest.approx(min(np.hypot(*(own[1:, :2] - each[1:]).T).min() for each in scenarios))
    assert kept >= min(max(least), RHO) - 1e-9
    if least[0] >= RHO:
        np.testing.assert_array_equal(plan.inputs, rest.inputs)


def test_both_kinds_of_encounters_are_drawn() -> None:
    found = [
        safest(state, inputs, rest, scenarios, counting, RHO, np.zeros(2))[1] >= RHO
        for state, rest, scenarios, counting, inputs in map(encounter, range(30))
    ]
    assert 0 < sum(found) < 30
