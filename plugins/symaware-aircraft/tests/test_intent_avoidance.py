"""Case study I reproduces the published results.

The golden numbers and the two recorded trajectories in data/ are of the published runs of the intent-aware collision
avoidance case study (the robust and the single-scenario MPC, N = 30, nominal intruder).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tests.conftest import Fly

CONTROLLER = "agents.ownship.components.steer.with"
INTRUDER = "agents.intruder.components.fly.with"
#: rho = sqrt(2000) m, less what solvers may err by.
SEPARATION = 44.7213


def recorded(name: str) -> NDArray[np.float64]:
    """A recorded trajectory: k, the poses of the ownship and the intruder, and the control input of the ownship."""
    path = Path(__file__).parent / "data" / f"intent_avoidance_{name}.csv"
    return np.loadtxt(path, delimiter=",", skiprows=1)


def test_the_intruder_flies_as_recorded(fly: Fly) -> None:
    np.testing.assert_allclose(fly("intent-avoidance.yaml").intruder, recorded("scenario_tree")[:, 4:7], atol=1e-6)


def test_the_robust_run_follows_the_recorded_one_with_its_solver(fly: Fly) -> None:
    flight = fly("as-recorded.yaml")
    apart = np.hypot(*(flight.own[:, :2] - recorded("scenario_tree")[:, 1:3]).T)
    assert apart.max() < 0.1
    assert flight.separation.min() == pytest.approx(44.7215, abs=1e-4)
    assert flight.separation.argmin() == 54
    np.testing.assert_allclose(flight.own[-1], (405.70, 508.38, 1.2549), atol=0.1)


def test_the_run_with_a_single_scenario_follows_the_recorded_one_with_its_solver(fly: Fly) -> None:
    flight = fly("as-recorded.yaml", f"{CONTROLLER}.robust_horizon=0")
    apart = np.hypot(*(flight.own[:, :2] - recorded("single_scenario")[:, 1:3]).T)
    assert apart.max() < 0.1
    assert flight.separation.min() == pytest.approx(44.7214, abs=1e-4)
    assert flight.separation.argmin() == 44
    np.testing.assert_allclose(flight.own[-1], (403.17, 512.05, 1.1797), atol=0.1)


@pytest.mark.parametrize("overrides", [(), (f"{CONTROLLER}.third_branch=paper",), (f"{CONTROLLER}.robust_horizon=0",)])
def test_the_fast_solver_is_as_safe_and_gets_as_far(fly: Fly, overrides: Sequence[str]) -> None:
    # The program is not convex: fatrop finds another path than IPOPT.
    flight = fly("intent-avoidance.yaml", *overrides)
    assert SEPARATION <= flight.separation.min() < 44.73
    to_go = [np.hypot(*(own[-1, :2] - (420, 560))) for own in (flight.own, recorded("scenario_tree")[:, 1:4])]
    assert to_go[0] < to_go[1] + 5.0


def test_with_a_short_horizon_it_is_safe_too(fly: Fly) -> None:
    assert fly("demo.yaml").separation.min() >= SEPARATION


def test_without_the_separation_they_all_but_meet(fly: Fly) -> None:
    assert list(fly("no-avoidance.yaml").log.contacts())
    assert not list(fly("intent-avoidance.yaml").log.contacts())
    separation = fly("no-avoidance.yaml").separation
    assert separation.min() == pytest.approx(8.1, abs=0.05)
    assert separation.argmin() == 40


def test_an_agent_that_knows_that_the_intruder_turns_does_not_deviate(fly: Fly) -> None:
    knowing, assuming = fly("with-intent.yaml"), fly("without-intent.yaml")
    assert np.abs(knowing.own[:, 0]).max() < 0.01
    assert knowing.separation.min() >= SEPARATION
    assert np.abs(assuming.own[:, 0]).max() > 10.0
    assert assuming.separation.min() >= SEPARATION
    for flight in (knowing, assuming):
        assert np.hypot(*flight.own[-1, :2]) < 1.0


@pytest.mark.parametrize(
    "overrides",
    [
        *([f"agents.ownship.state=[{x}, 230, -1.5708]"] for x in (-5, -1, 0.1, 1, 5)),
        [f"{CONTROLLER}.robust_horizon=3"],
        [f"{CONTROLLER}.robust_horizon=3", "agents.ownship.state=[1, 230, -1.5708]"],
        [f"{CONTROLLER}.solver=recorded"],
        [f"{CONTROLLER}.solver=recorded", "agents.ownship.state=[0.1, 230, -1.5708]"],
    ],
    ids=" ".join,
)
def test_a_head_on_encounter_is_solved_from_one_of_the_guesses(fly: Fly, overrides: Sequence[str]) -> None:
    flight = fly("without-intent.yaml", *overrides)
    assert flight.separation.min() >= SEPARATION
    assert flight.events("fell-back") == flight.events("too-close") == []
    assert np.hypot(*flight.own[-1, :2]) < 1.0


def test_under_turn_noise_a_single_scenario_fails_where_the_tree_does_not(fly: Fly) -> None:
    single = fly("noisy.yaml", f"{CONTROLLER}.robust_horizon=0", seed=1)
    assert single.separation.min() < SEPARATION
    assert single.events("fell-back")
    assert fly("noisy.yaml", seed=1).separation.min() >= SEPARATION


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "realisation"),
    [
        *(("intent-avoidance.yaml", realisation) for realisation in range(1, 21)),
        *(("as-recorded.yaml", realisation) for realisation in (1, 7, 14, 20)),
    ],
)
def test_every_realisation_keeps_the_separation(fly: Fly, scenario: str, realisation: int) -> None:
    bias = 1e-4 * (realisation - 10)
    separation = fly(scenario, f"{INTRUDER}.turn_bias={bias:.4f}").separation.min()
    assert SEPARATION <= separation < 44.7256


@pytest.mark.slow
def test_under_turn_noise_the_tree_keeps_the_separation_for_every_seed(fly: Fly) -> None:
    separations = [fly("noisy.yaml", seed=seed).separation.min() for seed in range(20)]
    assert min(separations) >= SEPARATION


def test_four_intruders_are_all_kept_clear_of(fly: Fly) -> None:
    flight = fly("four-intruders.yaml")
    threats = fly("four-intruders.yaml", f"{CONTROLLER}.avoid=false")
    for number in range(4):
        intruder = flight.log.series(f"intruder.{number}", "world").values
        assert np.hypot(*(flight.own - intruder)[:, :2].T).min() >= SEPARATION
        assert np.hypot(*(threats.own - intruder)[:, :2].T).min() < SEPARATION
    assert np.hypot(*(flight.own[-1, :2] - (420, 560))) < 90.0
