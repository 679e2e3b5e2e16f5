"""Reciprocal avoidance: who keeps to its half-planes meets nobody."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from hypothesis import assume, given
from hypothesis import strategies as st
from simulating import Team, execute, simulation

from symaware_cli import Entity, GroupComponent, Obstacle
from symaware_cli.engine.components.control.velocity_obstacle import VelocityObstacle, reciprocal_constraints
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.components.risk.time_to_collision import time_to_collision
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.run import run
from symaware_cli.language.build import build

DISC = Entity.model_validate({"shape": {"circle": {"radius": 0.3}}})
SCENARIO = CHECKOUT / "scenarios" / "circle-swap.yaml"

SMALL = st.floats(-2, 2).map(lambda value: round(value, 6))


@given(
    st.tuples(st.floats(1.0, 8.0), st.floats(-np.pi, np.pi)),
    st.tuples(SMALL, SMALL),
    st.tuples(SMALL, SMALL),
    st.floats(0.2, 0.99),
    st.floats(0, 1),
    st.tuples(*[st.tuples(st.floats(-2, 2), st.floats(0, 2))] * 2),
)
def test_two_agents_in_their_half_planes_do_not_touch_within_the_horizon(
    place: tuple[float, float],
    velocity: tuple[float, float],
    towards: tuple[float, float],
    size: float,
    share: float,
    choices: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    distance, angle = place
    apart = distance * np.array([[np.cos(angle)], [np.sin(angle)]])
    own, other, radius = np.array([velocity]).T, np.array([towards]).T, np.array([size])
    mine = reciprocal_constraints(apart, other - own, own, radius, 2.0, 0.25, share)
    theirs = reciprocal_constraints(-apart, own - other, other, radius, 2.0, 0.25, 1.0 - share)
    chosen = []
    for (normal, limit), (along, room) in zip((mine, theirs), choices, strict=True):
        assert np.hypot(*normal)[0] == pytest.approx(1.0)
        across = np.array([-normal[1], normal[0]])
        chosen.append(normal * (limit - room - 1e-7) + across * along)
    time = time_to_collision(apart, chosen[1] - chosen[0], radius)[0]
    assert time > 2.0 - 1e-5


@given(st.tuples(SMALL, SMALL), st.tuples(SMALL, SMALL), st.floats(1.0, 8.0))
def test_half_planes_forbid_no_more_than_they_must(
    velocity: tuple[float, float], towards: tuple[float, float], distance: float
) -> None:
    apart, radius = np.array([[distance], [0.0]]), np.array([0.9])
    own, other = np.array([velocity]).T, np.array([towards]).T
    time = time_to_collision(apart, other - own, radius)[0]
    assume(abs(time - 2.0) > 1e-3)
    normal, limit = reciprocal_constraints(apart, other - own, own, radius, 2.0, 0.25, 0.5)
    # Who meets nobody within the horizon may go on as before, and only they.
    assert ((normal * own).sum() <= limit[0] + 1e-9) == (time > 2.0)


def test_bodies_that_overlap_part() -> None:
    apart, nothing = np.array([[0.5], [0.0]]), np.zeros((2, 1))
    normal, limit = reciprocal_constraints(apart, nothing, nothing, np.array([0.6]), 2.0, 0.25, 0.5)
    assert normal[:, 0].tolist() == [1.0, 0.0]
    assert limit[0] == pytest.approx(-0.5 * 0.1 / 0.25)  # half of the overlap, within the time to part


def steering(**parameters: float) -> dict[str, Callable[..., Any]]:
    return {
        "sense": OmniscientPerception,
        "steer": lambda: VelocityObstacle(VelocityObstacle.Parameters(**parameters)),
    }


def meeting(model: NoisyModel, **parameters: Any) -> Team:
    """Two agents that want to go where the other is."""
    rest = [0.0] * (len(model.state) - 2)
    facing = [np.pi] if isinstance(model, Unicycle) else rest
    return Team(
        steering(**parameters),
        2,
        [[-4.0, 0.0, *rest], [4.0, 0.0, *facing]],
        [{"goal": [4.0, 0.0]}, {"goal": [-4.0, 0.0]}],
        model,
        DISC,
    )


@pytest.mark.parametrize("model", [SingleIntegrator(), Unicycle(), DoubleIntegrator()], ids=lambda m: type(m).__name__)
def test_two_agents_that_head_for_each_other_pass_on_the_right_and_arrive(model: NoisyModel) -> None:
    ready = simulation({"robot": meeting(model)})
    middle = []
    ready.events.subscribe("stepped", lambda _: middle.append(ready.environment.snapshot().positions.copy()))
    summary = execute(ready, 300)
    assert summary.contacts == 0
    assert summary.minimum_separation is not None
    assert summary.minimum_separation.value > 0.1
    assert len(summary.goals_reached) == 2
    closest = min(middle, key=lambda places: np.hypot(*(places[0] - places[1])))
    assert closest[0, 1] < -0.1
    assert closest[1, 1] > 0.1


def test_an_agent_alone_moves_straight() -> None:
    team = Team(steering(speed=1.0), 1, [[0.0, 0.0]], [{"goal": [9.0, 3.0]}], entity=DISC)
    ready = simulation({"robot": team})
    ready.initialise()
    for entry in ready.entries:
        entry.components[0].compute_and_update()
    assert ready.groups[0].control_input[0] == pytest.approx(np.array([9, 3]) / np.hypot(9, 3))


def test_an_unperceived_agent_is_not_avoided() -> None:
    blind = {"sense": SelfPerception, "steer": steering()["steer"]}
    team = meeting(SingleIntegrator())
    team.components = blind
    assert execute(simulation({"robot": team}), 200).contacts > 0


@pytest.mark.parametrize("model", [SingleIntegrator(), Unicycle()], ids=lambda m: type(m).__name__)
def test_a_pillar_in_the_way_is_passed_and_one_that_comes_is_dodged(model: NoisyModel) -> None:
    pillar = Obstacle.model_validate({"shape": {"circle": {"radius": 1.0}}, "position": [0.0, 0.0]})
    path = {"times": [0.0, 20.0], "positions": [[4.0, 6.0], [4.0, -6.0]]}
    coming = Obstacle.model_validate({"shape": {"circle": {"radius": 0.4}}, "path": path})
    state = [-5.0, *[0.0] * (len(model.state) - 1)]
    team = Team(steering(), 1, [state], [{"goal": [6.0, 0.0]}], model, DISC)
    summary = execute(simulation({"robot": team}, obstacles={"pillar": pillar, "coming": coming}), 440)
    assert summary.contacts == 0
    assert summary.goals_reached


def velocities(teams: Mapping[str, Any], seed: int = 7) -> dict[str, bytes]:
    """What each agent chooses at first, by id."""
    ready = simulation(teams, seed=seed)
    ready.initialise()
    for entry in ready.entries:
        entry.components[0].compute_and_update()
    return {id: row.tobytes() for group in ready.groups for id, row in zip(group.ids, group.control_input, strict=True)}


def crowd(count: int, centre: tuple[float, float] = (0.0, 0.0), seed: int = 5, **parameters: float) -> Team:
    chance = np.random.default_rng(seed)
    places = chance.uniform(-4, 4, (count, 2)) + centre
    goals = [{"goal": goal} for goal in chance.uniform(-4, 4, (count, 2)) + centre]
    return Team(steering(**parameters), count, places.tolist(), goals, entity=DISC)


def test_no_bit_of_a_choice_depends_on_who_is_far_away_or_on_the_order_of_groups() -> None:
    alone = velocities({"robot": crowd(30), "drone": crowd(8, seed=6)})
    far = crowd(120, (1000.0, 0.0), seed=7)
    together = velocities({"cloud": far, "drone": crowd(8, seed=6), "robot": crowd(30)})
    assert {id: together[id] for id in alone} == alone


def test_only_the_nearest_neighbours_are_avoided_where_there_are_many() -> None:
    near = [[0.0, 0.0], [0.9, 0.0], [-0.9, 0.1], [0.0, 1.2]]
    goals = [{"goal": [5.0, 5.0]}] * 4
    three = velocities({"robot": Team(steering(neighbours=2), 3, near[:3], goals[:3], entity=DISC)})
    four = velocities({"robot": Team(steering(neighbours=2), 4, near, goals, entity=DISC)})
    every = velocities({"robot": Team(steering(neighbours=3), 4, near, goals, entity=DISC)})
    assert four["robot.0"] == three["robot.0"] != every["robot.0"]


def test_the_turn_of_each_agent_is_its_own_and_comes_from_the_seed() -> None:
    assert velocities({"robot": crowd(6)}, seed=1) != velocities({"robot": crowd(6)}, seed=2)
    straight: dict[str, Any] = {"perturbation": 0.0}
    assert velocities({"robot": crowd(6, **straight)}, seed=1) == velocities({"robot": crowd(6, **straight)}, seed=2)


def test_in_space_there_is_no_avoidance() -> None:
    model = SingleIntegrator(SingleIntegrator.Parameters(dimensions=3))
    group = Team({}, 1, [[0.0, 0.0, 0.0]], [{"goal": [1.0, 0.0, 0.0]}], model).group("robot")
    with pytest.raises(ValueError, match="in the plane"):
        VelocityObstacle().check(group)


MODELS = {
    "unicycles": [],
    "single integrators": [
        "agents.robot.model={use: single-integrator}",
        "agents.robot.components.steer.with.margin=0.1",
    ],
}


def swaps(seeds: range, overrides: Sequence[Any]) -> None:
    for seed in seeds:
        built = build(SCENARIO, overrides, seed)
        summary = run(built.simulation, built.steps)
        assert (seed, summary.contacts) == (seed, 0)
        # Now and then two wait for each other until the time is over.
        assert len(summary.goals_reached) >= 48


@pytest.mark.parametrize("overrides", MODELS.values(), ids=MODELS)
def test_fifty_agents_swap_places_on_a_circle_without_a_contact(overrides: list[Any]) -> None:
    swaps(range(3), overrides)


@pytest.mark.slow
@pytest.mark.parametrize("overrides", MODELS.values(), ids=MODELS)
def test_fifty_agents_swap_places_without_a_contact_whatever_the_seed(overrides: Any) -> None:
    swaps(range(8), overrides)


class Straight(GroupComponent):
    """Goes on, whatever is in its way."""

    def _compute(self) -> Any:
        return np.tile([0.0, -1.5], (len(self._group), 1))

    def _update(self, value: Any) -> None:
        self._group.control_input = value


def crossed(**parameters: Any) -> Any:
    """The speeds of one who cruises at 0.3 m/s, and how near somebody comes who crosses its way and does not avoid."""
    slow = Team(
        steering(responsibility=1.0, perturbation=0.0, **parameters),
        state=[[-0.4, 0.0]],
        knowledge=[{"goal": [8.0, 0.0]}],
        entity=DISC,
        model=SingleIntegrator(SingleIntegrator.Parameters(max_speed=5.0)),
    )
    fast = Team({"go": Straight}, state=[[0.0, 4.0]], entity=DISC, model=slow.model)
    ready = simulation({"slow": slow, "fast": fast})
    speeds, distances = [], []

    def look(_: Any) -> None:
        fast_one, slow_one = (ready.environment.state(group)[0] for group in ready.groups)  # by name
        distances.append(np.hypot(*(slow_one - fast_one)))
        speeds.append(np.hypot(*ready.groups[1].control_input[0]))

    ready.events.subscribe("stepped", look)
    assert execute(ready, 120).status == "finished"
    return np.array(speeds), min(distances)


def test_the_greatest_speed_may_be_above_the_one_it_cruises_at() -> None:
    slow, near = crossed(speed=0.3)
    fast, far = crossed(speed=0.3, max_speed=1.2)
    assert slow.max() <= 0.3 + 1e-9
    assert 0.4 < fast.max() <= 1.2 + 1e-9
    assert fast[-20:] == pytest.approx(0.3)
    assert min(near, far) > 0.6


def test_a_greatest_speed_below_the_cruise_speed_is_refused() -> None:
    with pytest.raises(ValueError, match=r"max_speed \(0.5\) must not be less than speed \(1\)"):
        VelocityObstacle.Parameters(max_speed=0.5)
