"""Risk: the time until bodies touch, and the probability that they do."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from simulating import Team, simulation, untyped

from symaware_cli import Entity, GroupComponent, TimeSeries, Tracks
from symaware_cli.engine.components.perception import OmniscientPerception
from symaware_cli.engine.components.risk.body_pairs import PairRisk
from symaware_cli.engine.components.risk.collision import Collision
from symaware_cli.engine.components.risk.gaussian import collision_probability
from symaware_cli.engine.components.risk.time_to_collision import TimeToCollision, time_to_collision
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle

DISC = Entity.model_validate({"shape": {"circle": {"radius": 0.5}}})


def team(
    positions: Sequence[list[float]],
    velocities: Sequence[list[float]],
    risk: type[PairRisk] = TimeToCollision,
    **parameters: float,
) -> Team:
    """Agents of half a metre that move, and estimate their risk from perfect perception."""
    components: dict[str, Callable[[], GroupComponent]] = {
        "sense": OmniscientPerception,
        "risk": lambda: risk(risk.Parameters(**parameters)),
    }
    made = Team(components, len(positions), positions, entity=DISC)
    untyped(made).velocities = velocities
    return made


def risks(teams: Mapping[str, Any]) -> dict[str, float]:
    """The risk of each agent by id, where everybody moves as told."""
    ready = simulation(teams)
    ready.initialise()
    for group in ready.groups:
        group.control_input = teams[group.name].velocities
    ready.environment.step()
    ready.clock.now += ready.environment.time_step
    for entry in ready.entries:
        entry.components[0].compute_and_update()
    found: dict[str, float] = {}
    for group in ready.groups:
        assert group.awareness.risk.shared is not None
        times, values = group.awareness.risk.shared
        assert times.tolist() == [ready.clock.now]
        found |= dict(zip(group.ids, values[:, 0, 0].tolist(), strict=True))
    return found


def one_encounter(
    apart: ArrayLike, closing: ArrayLike, radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    return np.array([apart], float).T, np.array([closing], float).T, np.array([radius], float)


# --- the time until bodies touch --------------------------------------------------------------------------------------


def test_two_discs_that_head_for_each_other_touch_when_the_gap_is_used_up() -> None:
    assert time_to_collision(*one_encounter([10, 0], [-2, 0], 1)) == [4.5]
    assert time_to_collision(*one_encounter([0, 0, 10], [0, 0, -2], 1)) == [4.5]


@pytest.mark.parametrize(
    ("apart", "closing", "time"),
    [
        ([10, 0], [2, 0], np.inf),  # apart from each other
        ([10, 0], [0, 0], np.inf),  # both stand
        ([10, 1.5], [-2, 0], np.inf),  # past each other
        ([0.5, 0], [2, 0], 0.0),  # they overlap, although they part
        ([0, 0], [0, 0], 0.0),
    ],
)
def test_there_is_no_time_where_nothing_touches_and_none_left_where_bodies_overlap(
    apart: list[float], closing: list[int], time: float
) -> None:
    assert time_to_collision(*one_encounter(apart, closing, 1)) == [time]


def test_points_touch_nothing() -> None:
    assert time_to_collision(*one_encounter([10, 0], [-2, 0], 0)) == [np.inf]
    assert time_to_collision(*one_encounter([0, 0], [0, 0], 0)) == [np.inf]


PLACES = st.tuples(*[st.floats(-20, 20)] * 2)
SPEEDS = st.tuples(*[st.floats(-3, 3).map(lambda speed: round(speed, 6))] * 2)


@given(PLACES, SPEEDS, st.floats(0.1, 3))
def test_at_that_time_the_distance_is_the_sum_of_the_radii_and_was_greater_before(
    place: tuple[float, float], velocity: tuple[float, float], radius: float
) -> None:
    apart, closing = np.array(place), np.array(velocity)
    (time,) = time_to_collision(*one_encounter(apart, closing, radius))
    distance = np.hypot(*apart)
    if time == 0.0:
        assert distance < radius * (1 + 1e-12)
    elif np.isfinite(time):
        assert np.hypot(*(apart + closing * time)) == pytest.approx(radius, rel=1e-6)
        before = apart + closing * time * np.linspace(0, 1, 50)[:, None]
        assert np.hypot(*before.T).min() >= radius * (1 - 1e-6)
    else:
        later: Any = apart + closing * np.linspace(0, 100, 2000)[:, None]
        assert np.hypot(*later.T).min() >= radius * (1 - 1e-6)


def test_the_risk_falls_from_one_to_none_with_the_time_of_the_soonest_encounter() -> None:
    still = [[0.0, 0.0]] * 3
    moving = [[0.0, 0.0], [-1.0, 0.0], [0.0, -1.0]]
    assert risks({"robot": team([[0, 0], [5, 0], [0, 3]], still, horizon=5.0)}) == dict.fromkeys(
        ["robot.0", "robot.1", "robot.2"], 0.0
    )
    found = risks({"robot": team([[0, 0], [5.05, 0], [0, 3.05]], moving, horizon=5.0)})
    assert found == pytest.approx({"robot.0": 1 - 2 / 5, "robot.1": 1 - 4 / 5, "robot.2": 1 - 2 / 5})


def test_the_margin_widens_the_bodies_and_the_reach_ends_the_view() -> None:
    moving = [[0.0, 0.0], [-1.0, 0.0]]
    places = [[0.0, 0.0], [5.05, 0.0]]
    assert risks({"robot": team(places, moving, horizon=5.0, margin=1.0)})["robot.0"] == pytest.approx(1 - 3 / 5)
    assert risks({"robot": team(places, moving, horizon=5.0, reach=4.9)})["robot.0"] == 0.0


@pytest.mark.parametrize("clear", [0.3, 1.7])
def test_the_margin_is_the_distance_that_counts_as_a_collision(clear: float) -> None:
    """Of two that pass each other at a distance of so much between their outlines, for certain."""
    places, moving = [[0.0, 0.0], [4.0, 1.0 + clear]], [[0.0, 0.0], [-2.0, 0.0]]
    for margin, risk in ((0.0, 0.0), (clear - 0.1, 0.0), (clear + 0.1, 1.0)):
        found = risks({"robot": team(places, moving, Collision, horizon=5.0, margin=margin)})
        assert found == pytest.approx({"robot.0": risk, "robot.1": risk}, abs=1e-6)


@pytest.mark.parametrize("risk", [TimeToCollision, Collision])
def test_no_bit_of_an_agents_risk_depends_on_who_is_far_away_or_on_the_order_of_groups(risk: type[PairRisk]) -> None:
    chance = np.random.default_rng(5)
    places, speeds = chance.uniform(-6, 6, (30, 2)).tolist(), chance.uniform(-1, 1, (30, 2)).tolist()
    near = {"robot": team(places[:20], speeds[:20], risk), "drone": team(places[20:], speeds[20:], risk)}
    alone = risks(near)
    assert len(set(alone.values())) > (5 if risk is TimeToCollision else 1)
    far = team((chance.uniform(-5, 5, (90, 2)) + 1000).tolist(), chance.uniform(-1, 1, (90, 2)).tolist(), risk)
    together = risks({"cloud": far, "drone": near["drone"], "robot": near["robot"]})
    assert {id: together[id] for id in alone} == alone


# --- the probability of a collision -----------------------------------------------------------------------------------


def by_sampling(
    apart: Sequence[float],
    velocity: Sequence[float],
    radius: float,
    covariance: Any,
    horizon: float,
    count: int = 1_000_000,
) -> float:
    """The part of sampled relative positions from which the distance comes below the radius within the horizon."""
    sampled = np.random.default_rng(11).multivariate_normal(apart, covariance, size=count, method="eigh")
    closing = np.array(velocity, float)
    time = np.clip(-(sampled @ closing) / max(closing @ closing, 1e-300), 0, horizon)
    nearest = sampled + time[:, None] * closing
    return float((np.einsum("ij,ij->i", nearest, nearest) < radius**2).mean())


GEOMETRIES = {
    "head-on": ([6, 0.3], [-2, 0], 1.0, [[0.5, 0.1], [0.1, 0.4]], 5.0),
    "past each other": ([4, 2], [-2, 0.1], 1.0, [[0.3, -0.2], [-0.2, 0.5]], 5.0),
    "the horizon ends before": ([6, 0.3], [-2, 0], 1.0, [[0.5, 0.1], [0.1, 0.4]], 2.0),
    "slow": ([1.5, 0.5], [-0.01, 0.005], 1.0, [[0.5, 0.2], [0.2, 0.3]], 5.0),
    "at rest": ([1.2, 0.5], [0, 0], 1.0, [[0.5, 0.2], [0.2, 0.3]], 5.0),
    "diverging": ([1.5, 0.5], [2, 1], 1.0, [[0.5, 0.2], [0.2, 0.3]], 5.0),
    "overlapping": ([0.5, 0], [1, 0], 1.0, [[0.3, 0], [0, 0.3]], 5.0),
    "large covariance": ([3, 1], [-1, -1], 0.5, [[40, 5], [5, 30]], 5.0),
    "tiny covariance": ([3, 0.999], [-1, 0], 1.0, [[1e-6, 0], [0, 1e-6]], 5.0),
    "certain along, not across": ([3, 0.8], [-1, 0], 1.0, [[1e-12, 0], [0, 0.1]], 5.0),
    "a needle askew": ([1, 0.5], [0.1, 0.1], 0.5, [[0.3, 0.17], [0.17, 0.1]], 1.0),
    "in space": ([4, 1, -1], [-2, 0, 0.3], 1.2, [[0.5, 0.1, 0], [0.1, 0.4, 0.2], [0, 0.2, 0.6]], 5.0),
    "in space at rest": ([1, 1, -1], [0, 0, 0], 1.2, [[0.5, 0.1, 0], [0.1, 0.4, 0.2], [0, 0.2, 0.6]], 5.0),
    "in space, from below": ([0, 0.2, -3], [0, 0, 1], 0.7, [[0.5, 0, 0], [0, 0.2, 0], [0, 0, 0.3]], 2.5),
}


@pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES)
def test_the_probability_agrees_with_sampling(
    geometry: tuple[list[float], list[float], float, list[list[float]], float],
) -> None:
    apart, closing, radius, covariance, horizon = geometry
    sampled = by_sampling(*geometry)
    arguments = one_encounter(apart, closing, radius)
    (probability,) = collision_probability(*arguments, np.array([covariance], float), horizon)
    # Four standard errors of a million samples, at most 0.002.
    assert probability == pytest.approx(sampled, abs=4 * np.sqrt(max(sampled * (1 - sampled), 1e-6) / 1e6))


Encounter = tuple[Any, Any, float, Any]

SQUARES = st.tuples(*[st.floats(-2, 2)] * 4)
ENCOUNTERS = st.tuples(PLACES, SPEEDS, st.floats(0.1, 3), SQUARES)


def probability_of(
    encounter: Encounter,
    horizon: float = 3.0,
    radius: float | None = None,
) -> float:
    apart, closing, known, square = encounter
    square = np.array(square).reshape(2, 2)
    arguments = one_encounter(apart, closing, known if radius is None else radius)
    return float(collision_probability(*arguments, (square @ square.T)[None], horizon)[0])


def error_of(encounter: Encounter) -> float:
    """How wrong a probability may be: more where somebody is certain in one direction and not in the other.

    Such a density is like a blade, which nodes in rows askew to it see badly.
    """
    return 1e-2 if np.linalg.cond(np.array(encounter[3]).reshape(2, 2)) > 20 else 1e-4


@given(ENCOUNTERS, st.floats(0, 5), st.floats(0, 2))
def test_the_probability_grows_with_the_horizon_and_with_the_bodies(
    encounter: Encounter,
    more_time: float,
    more_radius: float,
) -> None:
    probability = probability_of(encounter)
    assert 0.0 <= probability <= 1.0
    error = error_of(encounter)
    assert probability_of(encounter, 3.0 + more_time) >= probability - error
    assert probability_of(encounter, 3.0, encounter[2] + more_radius) >= probability - error


@given(ENCOUNTERS, st.floats(-3.2, 3.2))
def test_the_probability_does_not_depend_on_where_north_is(encounter: Encounter, angle: float) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    apart, closing, radius, square = encounter
    turned = (turn @ apart, turn @ closing, radius, turn @ np.array(square).reshape(2, 2))
    assert probability_of(turned) == pytest.approx(probability_of(encounter), abs=error_of(encounter))


@given(PLACES, SPEEDS, st.floats(0.1, 3))
def test_without_doubt_the_probability_says_whether_bodies_touch_in_time(
    apart: tuple[float, float], closing: tuple[float, float], radius: float
) -> None:
    time = time_to_collision(*one_encounter(apart, closing, radius))[0]
    # Not where they graze each other, or touch at the very end.
    closer, farther = (
        time_to_collision(*one_encounter(apart, closing, radius * scale))[0] for scale in (1 - 1e-9, 1 + 1e-9)
    )
    assume((closer <= 3.0) == (farther <= 3.0))
    assert probability_of((apart, closing, radius, (0, 0, 0, 0))) == (time <= 3.0)


def believing(
    covariances: Sequence[NDArray[np.float64]],
    own: ArrayLike | None = None,
    model: Any = None,
    velocity: tuple[float, float] = (0.0, 0.0),
    **parameters: float,
) -> NDArray[np.float64]:
    """The risk of an agent at the origin that believes in two others at (2, 0), one of them surely elsewhere."""
    model = model or SingleIntegrator()
    risk = Collision(Collision.Parameters(**parameters))
    state = [0.0] * len(model.state)
    ready = simulation({"robot": Team({"risk": lambda: risk}, 3, [state] * 3, model=model, entity=DISC)})
    ready.initialise()
    (group,) = ready.groups
    others = np.array([[2.0, 0.0], [2.0, 0.0]])
    group.awareness.seen = Tracks.of(
        0, 3, np.array([0, 0]), np.array([1, 2]), others, np.tile(velocity, (2, 1)), np.array(covariances)
    )
    if own is not None:
        group.awareness.uncertainty.set(0, np.tile(np.ravel(own), (3, 1))[:, None])
    risk.compute_and_update()
    assert group.awareness.risk.shared is not None
    return group.awareness.risk.shared[1][:, 0, 0]


ROLLING = {"risk": lambda: Collision(Collision.Parameters(horizon=8.0))}
NOTHING, METRE = np.zeros((4, 4)), np.diag([1.0, 1.0, 0.0, 0.0])


def test_risks_of_several_encounters_add_up_to_one_at_most() -> None:
    one, both = believing([METRE, NOTHING]), believing([METRE, METRE])
    assert 0.05 < one[0] < 0.5
    assert both[0] == pytest.approx(2 * one[0])
    assert believing([METRE, METRE], margin=9.0)[0] == 1.0
    assert both[1:].tolist() == [0.0, 0.0]  # who believes in nobody fears nobody


def test_uncertainty_of_the_own_position_counts_like_that_of_others() -> None:
    known = believing([METRE, NOTHING], own=np.zeros((2, 2)))[0]
    assert believing([METRE, NOTHING])[0] == known
    shared = believing([0.4 * METRE, NOTHING], own=0.6 * np.eye(2))[0]
    # One's own doubt bears on the second encounter as well; alone, both have the same part in it.
    either = 0.5 * believing([NOTHING, NOTHING], own=0.6 * np.eye(2))[0]
    assert shared == pytest.approx(known + either)


def test_an_uncertain_heading_makes_predicted_positions_uncertain() -> None:
    def risk(deviation: float) -> float:
        own = np.diag([0.01, 0.01, deviation**2])
        ready = simulation({"robot": Team(ROLLING, 2, [[0, 0, 0], [6, 1.4, 0]], model=Unicycle(), entity=DISC)})
        ready.initialise()
        (group,) = ready.groups
        group.control_input = [[1.0, 0.0], [0.0, 0.0]]
        group.awareness.world = ready.environment.snapshot()
        group.awareness.uncertainty.set(0, np.tile(own.ravel(), (2, 1))[:, None])
        ready.entries[0].components[0].compute_and_update()
        assert group.awareness.risk.shared is not None
        return float(group.awareness.risk.shared[1][0, 0, 0])

    # It would pass at 1.4 m; to touch, it must err by 4 degrees.
    assert risk(0.0) < 0.01
    assert 0.1 < risk(np.radians(5)) < 0.5


def test_doubt_of_a_velocity_counts_and_never_too_little() -> None:
    sure, unsure = np.diag([0.01, 0.01, 0, 0]), np.diag([0.01, 0.01, 0.25, 0.25])
    arguments: dict[str, Any] = {"velocity": (-1.0, 0.8), "horizon": 4.0}
    sampled = np.random.default_rng(4).multivariate_normal([2, 0, -1, 0.8], unsure, size=1_000_000)
    place, speed = sampled[:, :2], sampled[:, 2:]
    time = np.clip(-np.einsum("ij,ij->i", place, speed) / np.einsum("ij,ij->i", speed, speed), 0, 4)
    touching = (np.hypot(*(place + time[:, None] * speed).T) < 1.0).mean()
    found = believing([unsure, NOTHING], **arguments)[0]
    assert believing([sure, NOTHING], **arguments)[0] < touching < found < 1.5 * touching


def test_an_uncertainty_that_is_no_covariance_of_the_state_is_refused() -> None:
    with pytest.raises(ValueError, match="the uncertainty of `robot` has 3 elements, not 2 x 2"):
        believing([NOTHING, NOTHING], own=[1.0, 2.0, 3.0])


def test_the_uncertainty_of_single_agents_counts_like_that_of_the_group() -> None:
    risk = Collision(Collision.Parameters())
    ready = simulation({"robot": Team({"risk": lambda: risk}, 2, [[0, 0], [2, 0]], entity=DISC)})
    ready.initialise()
    (group,) = ready.groups
    group.awareness.world = ready.environment.snapshot()
    group.agents[0].self_awareness.uncertainty = TimeSeries.sampled([0], np.eye(2).reshape(1, -1))
    risk.compute_and_update()
    assert group.awareness.risk.shared is not None
    first, second = group.awareness.risk.shared[1][:, 0, 0].tolist()
    assert first == pytest.approx(by_sampling([2, 0], [0, 0], 1.0, np.eye(2), 3.0), abs=0.002)
    assert second == 0.0
