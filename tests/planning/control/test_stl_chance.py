"""Plans with a maximal risk: their risk against samples, its account over a run, and what happens without a plan."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from symaware_cli import RunResult, ScenarioError, load
from symaware_cli.log.digest import digest
from symaware_cli.planning.control.stl_chance import ChosenSides, StlChance
from symaware_cli.planning.optimal_control import LinearDynamics

pytest.importorskip("highspy", reason="HiGHS is an extra")

Array = NDArray[np.float64]

STEPS, SAMPLES = 12, 20_000

#: Acceleration over steps of 0.5 s, along one axis, of at most 1 m/s^2.
CART = LinearDynamics(
    np.array([[1.0, 0.5], [0.0, 1.0]]),
    np.array([[0.125], [0.5]]),
    np.zeros(2),
    np.array([-1.0]),
    np.array([1.0]),
    np.zeros((0, 1)),
    np.zeros(0),
)
NOISE = np.array([[0.0004, 0.0001], [0.0001, 0.0009]])
#: Half spaces of position and velocity at some instants, with a plan in their middle.
SIDES = ChosenSides(
    np.array([[1.0, 0.0], [-1.0, 0.0], [0.6, 0.8], [0.0, -1.0]]),
    np.array([0.08, 0.12, 0.1, 0.06]),
    np.array([1, 3, 7, STEPS]),
    np.zeros(4),
    ("",) * 4,
)
STILL = np.zeros((STEPS + 1, 2)), np.zeros((STEPS, 1))


def sampled(chance: StlChance, believed: Array, measured: Array) -> Array:
    """Samples of x - z while a plan is followed, shape (SAMPLES, STEPS + 1, 2).

    The belief is what a Kalman filter makes of measurements of the state with this covariance, once it has settled.
    """
    generator = np.random.default_rng(5)
    gain = chance.deviations(STEPS, believed).gain
    A, B = CART.A, CART.B
    belief = np.zeros((SAMPLES, 2))
    state = belief + generator.multivariate_normal(np.zeros(2), believed, SAMPLES)
    found = [state]
    for _ in range(STEPS):
        inputs = belief @ gain.T
        state = state @ A.T + inputs @ B.T + generator.multivariate_normal(np.zeros(2), NOISE, SAMPLES)
        belief = belief @ A.T + inputs @ B.T
        if measured.any():
            predicted = A @ believed @ A.T + NOISE
            correction = predicted @ np.linalg.inv(predicted + measured)
            seen = state + generator.multivariate_normal(np.zeros(2), measured, SAMPLES)
            belief = belief + (seen - belief) @ correction.T
        else:
            belief = state
        found.append(state)
    return np.stack(found, axis=1)


def settled(measured: Array) -> Array:
    """The covariance of the belief of a Kalman filter after many measurements."""
    covariance = measured
    for _ in range(1000):
        predicted = CART.A @ covariance @ CART.A.T + NOISE
        covariance = predicted - predicted @ np.linalg.inv(predicted + measured) @ predicted
    return covariance


@pytest.mark.parametrize("error", [0.0, 0.03], ids=["exact", "estimated"])
def test_the_probability_of_leaving_each_half_space_is_exact(error: float) -> None:
    measured = error**2 * np.eye(2)
    believed = settled(measured) if error else np.zeros((2, 2))
    chance = StlChance(CART, NOISE, 0.1, "normal")
    off = sampled(chance, believed, measured)
    margins = np.einsum("ki,nki->nk", SIDES.normals, off[:, SIDES.instants]) + SIDES.offsets
    shares = (margins < 0.0).mean(axis=0)
    risk = 0.0
    for place, share in enumerate(shares.tolist()):
        chosen = slice(place, place + 1)
        one = ChosenSides(*(each[chosen] for each in SIDES))  # type: ignore[arg-type] # arrays and a tuple
        expected = chance.remaining(one, *STILL, 0, np.zeros(2), believed)[1].total
        assert share == pytest.approx(expected, abs=4.0 * np.sqrt(expected / SAMPLES) + 1e-3)
        risk += expected
    assert 0.02 < (margins < 0.0).any(axis=1).mean() < risk


def test_without_normal_noise_the_bound_is_above_every_share() -> None:
    normal, other = StlChance(CART, NOISE, 0.1, "normal"), StlChance(CART, NOISE, 0.1, "chebyshev")
    exact = np.zeros((2, 2))
    risks = [each.remaining(SIDES, *STILL, 0, np.zeros(2), exact)[1].total for each in (normal, other)]
    assert risks[0] < risks[1]


def test_the_risk_of_the_rest_is_on_average_that_of_the_plan_less_what_was_taken() -> None:
    chance, exact = StlChance(CART, NOISE, 0.1, "normal"), np.zeros((2, 2))
    before = chance.remaining(SIDES, *STILL, 0, np.zeros(2), exact)[1]
    generator = np.random.default_rng(3)
    after = generator.multivariate_normal(np.zeros(2), NOISE, 1000)
    rest = np.array([chance.remaining(SIDES, *STILL, 1, state, exact)[1].total for state in after])
    expected = before.total - before.following
    assert rest.mean() == pytest.approx(expected, abs=4.0 * rest.std() / np.sqrt(len(rest)))


def boat(folder: Path, noise: float = 0.1, **given: Any) -> Path:
    """Write a scenario of a point that passes a region to avoid, and has to be elsewhere in time."""
    formula = "always not inside(position, water) and eventually[0, 3] inside(position, pier)"
    document = {
        "symaware": 1,
        "name": "boat",
        "run": {"duration": 3.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.5}},
        "regions": {"water": {"box": [1, 2, -3, 0.2]}, "pier": {"box": [2.2, 5, -1, 1]}},
        "specifications": {"crossed": {"each": "boat", "formula": formula}},
        "agents": {
            "boat": {
                "model": {"use": "single-integrator", "with": {"max_speed": 1.2, "process_noise": noise}},
                "state": [0, 0],
                "components": {
                    "sense": {"use": "perception.self"},
                    "plan": {
                        "use": "control.stl",
                        "with": {
                            "specifications": ["crossed"],
                            "robustness_weight": 0.0,
                            "effort_weight": 0.1,
                            **given,
                        },
                    },
                },
            }
        },
    }
    file = folder / "boat.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    return file


def played(folder: Path, seed: int = 1, **given: Any) -> RunResult:
    return load(boat(folder, **given)).run(seed=seed, output=folder / f"{seed}.mcap")


def test_a_plan_takes_the_risk_that_it_may_and_no_more(tmp_path: Path) -> None:
    efforts = []
    for greatest in (0.02, 0.06, 0.2):
        (tmp_path / str(greatest)).mkdir()
        result = played(tmp_path / str(greatest), maximal_risk=greatest)
        (planned,) = [event for event in result.events if event.name == "planned"]
        assert 0.5 * greatest < planned.data["risk"] <= greatest
        efforts.append(float(np.square(result.series("boat", "applied_control").values).sum()))
        budget = np.asarray(result.series("boat", "plan.risk_budget").values)
        # What was spent only grows, and is at most what the plan had, but for what gusts add to it.
        assert (np.diff(budget[:, 1]) >= 0.0).all()
    assert efforts[0] > efforts[1] > efforts[2]


def test_the_share_of_violations_is_below_the_maximal_risk(tmp_path: Path) -> None:
    scenario = load(boat(tmp_path, maximal_risk=0.2))
    verdicts = [scenario.run(seed=seed, record=False).summary.specifications[0].verdict for seed in range(5)]
    assert sum(each != "satisfied" for each in verdicts) <= 3  # the 99 % point of Binomial(5, 0.2)


@pytest.mark.slow
def test_over_many_seeds_violations_are_as_many_as_allowed_and_not_far_fewer(tmp_path: Path) -> None:
    scenario = load(boat(tmp_path, maximal_risk=0.1))
    verdicts = [scenario.run(seed=seed, record=False).summary.specifications[0].verdict for seed in range(400)]
    assert 10 < sum(each != "satisfied" for each in verdicts) <= 55  # the 99 % point of Binomial(400, 0.1)


def test_without_a_plan_of_so_little_risk_the_event_says_what_is_left_and_what_is_spent(tmp_path: Path) -> None:
    result = played(tmp_path, maximal_risk=0.01, noise=0.5)
    (event,) = [event for event in result.events if event.name == "infeasible"]
    assert event.data == {"conflict": ["crossed"], "left": 0, "allowed": 0.01, "spent": 0.0}


@pytest.mark.parametrize("other", [{"horizon": 2.0}, {"deviations": 2.0}])
def test_a_maximal_risk_is_that_of_the_whole_run_and_determines_margins(
    tmp_path: Path, other: dict[str, float]
) -> None:
    with pytest.raises(ScenarioError, match=next(iter(other))):
        load(boat(tmp_path, maximal_risk=0.1, **other)).validate()


def test_equal_runs_with_a_maximal_risk_have_equal_logs(tmp_path: Path) -> None:
    digests = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        digests.append(digest(played(tmp_path / name, maximal_risk=0.1).log).combined)
    assert digests[0] == digests[1]


def test_the_risk_of_a_pair_is_that_of_both_and_half_of_it_is_for_each() -> None:
    chance, exact = StlChance(CART, NOISE, 0.1, "normal"), np.zeros((2, 2))
    own = sampled(chance, exact, exact)[:, 5, 0]
    other = np.random.default_rng(8).normal(0.0, 0.1, SAMPLES)
    side = (np.array([[1.0, 0.0]]), np.array([0.2]), np.array([5]), np.array([0.01]), ("robot.1",))
    risk = chance.remaining(ChosenSides(*side), *STILL, 0, np.zeros(2), exact)[1].total
    share = (own - other + 0.2 < 0.0).mean()
    assert risk == pytest.approx(2.0 * share, abs=8.0 * np.sqrt(share / SAMPLES))


def meeting(folder: Path, noise: float, sense: dict[str, Any], **given: Any) -> Path:
    """Write a scenario of two robots that meet at a place, and stay apart."""
    document = {
        "symaware": 1,
        "name": "meeting",
        "run": {"duration": 3.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.5}},
        "specifications": {
            "apart": {"pairs": "robot", "formula": "always distance > 1"},
            "meet": {"each": "robot", "formula": "eventually[2, 3] (x > -0.8 and x < 0.8)"},
        },
        "agents": {
            "robot": {
                "count": 2,
                "model": {"use": "single-integrator", "with": {"max_speed": 2.0, "process_noise": noise}},
                "state": [[-2.0, 0.0], [2.0, 0.1]],
                "components": {
                    "sense": sense,
                    "plan": {"use": "control.stl", "with": {"specifications": ["apart", "meet"], **given}},
                },
            }
        },
    }
    file = folder / "meeting.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    return file


ALL = {"use": "perception.omniscient"}


def test_two_agents_plan_around_each_other(tmp_path: Path) -> None:
    result = load(meeting(tmp_path, 0.0, ALL, interval=0.5, robustness=0.02)).run(record=False)
    assert {each.name: each.verdict for each in result.summary.specifications} == {
        "apart": "satisfied",
        "meet": "satisfied",
    }


def test_pairs_are_kept_with_a_maximal_risk_and_it_is_said_what_is_assumed_of_others(tmp_path: Path) -> None:
    scenario = load(meeting(tmp_path, 0.03, ALL, maximal_risk=0.1, interval=1.0))
    (said,) = [each.message for each in scenario.validate().warnings if "guaranteed" in each.message]
    assert "`apart`" in said
    result = scenario.run(output=tmp_path / "meeting.mcap")
    assert {each.verdict for each in result.summary.specifications} == {"satisfied"}
    assert all(event.data["risk"] <= 0.1 for event in result.events if event.name == "planned")


@pytest.mark.parametrize(
    "sense", [{"use": "perception.range", "with": {"range": 9.0, "self_noise": 0.1}}, {"use": "perception.self"}]
)
def test_a_maximal_risk_needs_to_know_how_uncertain_states_are(tmp_path: Path, sense: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError, match="maximal_risk"):
        load(meeting(tmp_path, 0.03, sense, maximal_risk=0.1)).validate()


def test_in_worlds_of_forces_nothing_is_guaranteed_and_it_is_said(tmp_path: Path) -> None:
    pytest.importorskip("pymunk", reason="Pymunk is an extra")
    file = boat(tmp_path, noise=0.0, maximal_risk=0.1)
    document = yaml.safe_load(file.read_text())
    document["environment"] = {"use": "pymunk", "with": {"time_step": 0.5}}
    document["agents"]["boat"]["entity"] = {"shape": {"circle": {"radius": 0.1}}, "mass": 1.0}
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    assert [each for each in load(file).validate().warnings if "not guaranteed" in each.message]
