"""Barrier filters: whoever keeps its constraints keeps its distances, also between two samples."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from numpy.typing import NDArray
from simulating import STEP, Team, execute, made, simulation

from symaware_cli import Entity, Event, GroupComponent, Model, Obstacle
from symaware_cli.engine.components.control.goal import GoToGoal
from symaware_cli.engine.components.perception import OmniscientPerception
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.timing import Timing
from symaware_cli.language.build import build
from symaware_cli.testing import assert_batchable

pytest.importorskip("daqp", reason="DAQP is an extra")

from symaware_cli.planning.control.barrier_filter import BarrierFilter
from symaware_cli.planning.control.barriers import (
    AccelerationInput,
    Encounters,
    HeadingInput,
    VelocityInput,
)

Array = NDArray[np.float64]

DISC = Entity.model_validate({"shape": {"circle": {"radius": 0.3}}})
HOLD = STEP / 1e9
MARKET = CHECKOUT / "scenarios" / "market.yaml"


class Request(GroupComponent):
    """Requests the same control input forever."""

    def __init__(self, control_input: Sequence[Sequence[float]]) -> None:
        super().__init__()
        self.control_input = control_input

    def _compute(self) -> Array:
        return np.array(self.control_input, float)

    def _update(self, value: Array) -> None:
        self._group.control_input = value


class Outcome:
    """What came of a run: barriers and control inputs at each step, events and contacts."""

    def __init__(self, teams: Mapping[str, Team], steps: int, obstacles: Mapping[str, Obstacle] | None = None) -> None:
        ready = simulation(teams, obstacles=obstacles)
        self.barriers: list[Array] = []
        self.inputs: list[Array] = []
        self.events: list[Event] = []
        group = ready.groups[0]
        ready.events.subscribe("stepped", lambda _: self.barriers.append(group.awareness["keep.barrier"][:, 0].copy()))
        ready.events.subscribe("stepped", lambda _: self.inputs.append(group.control_input.copy()))
        for name in (*BarrierFilter.events, "contact"):
            ready.events.subscribe(name, self.events.append)
        execute(ready, steps)

    @property
    def least(self) -> float:
        return float(np.min(self.barriers))

    def named(self, name: str) -> list[Event]:
        return [event for event in self.events if event.name == name]


def keeping(**parameters: Any) -> Callable[[], BarrierFilter]:
    return lambda: made(BarrierFilter, **parameters)


def crowd(model: Model, seed: int, count: int = 6, period: int = 1, speed: float = 1.2, **parameters: Any) -> Team:
    """Agents in random places, not too close, that go to places among which others stand."""
    random = np.random.default_rng(seed)
    places = np.array([[4.0 * (row % 3), 4.0 * (row // 3)] for row in range(count)]) + random.uniform(-1, 1, (count, 2))
    goals = random.permutation(places) + random.uniform(-1, 1, (count, 2))
    state = np.zeros((count, len(model.state)))
    state[:, :2] = places
    if model.heading is not None:
        state[:, model.heading] = random.uniform(-np.pi, np.pi, count)
    return Team(
        {
            "sense": OmniscientPerception,
            "steer": lambda: made(GoToGoal, speed=speed),
            "keep": keeping(**parameters),
        },
        count=count,
        state=state.tolist(),
        knowledge=[{"goal": goal} for goal in goals.tolist()],
        model=model,
        entity=DISC,
        timings={name: Timing(period * STEP) for name in ("steer", "keep")} if period > 1 else {},
    )


PILLARS = {
    f"pillar-{row}": Obstacle.model_validate({"shape": shape, "position": [2.0 + 4.0 * row, 2.0]})
    for row, shape in enumerate(({"circle": {"radius": 0.5}}, {"box": {"length": 1.2, "width": 0.4}}))
}


def check_distances(model: Model, seeds: range, **more: Any) -> None:
    filtered = 0
    for seed in seeds:
        outcome = Outcome({"robot": crowd(model, seed, **{"margin": 0.001, **more})}, 160, PILLARS)
        assert outcome.least >= -1e-7, seed
        assert not outcome.named("contact")
        assert not outcome.named("infeasible")
        filtered += len(outcome.named("filtered"))
    assert filtered > len(seeds)


MODELS = {
    "single integrators": SingleIntegrator(SingleIntegrator.Parameters(max_speed=1.5)),
    "unicycles": Unicycle(Unicycle.Parameters(max_speed=1.5)),
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("gain", [1.0, 20.0])
def test_agents_that_keep_their_distances_never_touch(model: str, gain: float) -> None:
    check_distances(MODELS[model], range(2), gain=gain)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("gain", [0.5, 2.0, 100.0])
def test_agents_that_keep_their_distances_never_touch_for_many_seeds(model: str, gain: float) -> None:
    check_distances(MODELS[model], range(2, 6), gain=gain, margin=0.1)


@pytest.mark.parametrize("model", MODELS)
def test_control_inputs_that_are_held_for_four_steps_keep_the_distances_if_hold_says_so(model: str) -> None:
    check_distances(MODELS[model], range(1), gain=10.0, period=4, hold=4 * HOLD)


def test_pairs_of_double_integrators_that_can_brake_in_time_keep_their_distances() -> None:
    model = DoubleIntegrator(DoubleIntegrator.Parameters(max_acceleration=2.0, max_speed=1.0))
    filtered = 0
    for seed in range(6):
        outcome = Outcome({"robot": crowd(model, seed, 2, speed=1.0, gain=1.0, reach=9.0)}, 160)
        assert outcome.least >= -1e-7, seed
        assert not outcome.named("infeasible")
        filtered += len(outcome.named("filtered"))
    assert filtered > 0


def encounters(apart: Array, keep: float, velocity: Array, shared: bool) -> Encounters:
    distance = np.sqrt((apart * apart).sum())
    return Encounters(
        np.zeros(1, np.intp),
        (apart / distance)[:, None],
        np.array([distance]),
        np.array([keep]),
        velocity[:, None],
        np.array([shared]),
    )


@pytest.mark.parametrize("shared", [True, False])
def test_accelerations_at_their_limit_keep_the_barrier_and_its_rate_until_the_next_sample(shared: bool) -> None:
    random = np.random.default_rng(1)
    greatest, gain, hold, keep = 3.0, 2.0, 0.1, 0.6
    model = DoubleIntegrator(DoubleIntegrator.Parameters(max_acceleration=greatest))
    motion, checked = AccelerationInput(model, gain, hold), 0
    while checked < 400:
        apart, velocities = random.normal(size=2), 2.0 * random.normal(size=(2, 2))
        normal, distance = apart / np.hypot(*apart), np.hypot(*apart)
        if distance < keep or normal @ (velocities[0] - velocities[1]) < -gain * (distance - keep):
            continue
        states = [
            np.concatenate([place, velocity])[None]
            for place, velocity in zip((apart, 0 * apart), velocities, strict=True)
        ]
        inputs = []
        for sign, state, other in zip((1.0, -1.0), states, velocities[::-1], strict=True):
            least = motion.limit(encounters(sign * apart, keep, other, shared), state)[0]
            along = max(least, -greatest) + random.choice([0.0, random.uniform(0, 0.2)])
            if along > greatest:
                break
            across = random.uniform(-1, 1) * np.sqrt(greatest**2 - along**2)
            inputs.append(sign * (along * normal + across * np.array([-normal[1], normal[0]])))
        if not inputs or (shared and len(inputs) < 2):
            continue
        relative = inputs[0] - (inputs[1] if shared else 0.0)
        velocity = velocities[0] - velocities[1]
        for time in np.linspace(0, hold, 11):
            there = apart + velocity * time + 0.5 * relative * time * time
            assert np.hypot(*there) >= keep - 1e-9
        rate = there @ (velocity + relative * hold) / np.hypot(*there)
        assert rate + gain * (np.hypot(*there) - keep) >= -1e-9
        checked += 1


def test_a_request_that_violates_nothing_is_not_touched() -> None:
    request = [[0.1234567, -0.7], [9.0, 3.0]]  # the second one exceeds the limits
    team = Team(
        {"sense": OmniscientPerception, "ask": lambda: Request(request), "keep": keeping()},
        count=2,
        state=[[0.0, 0.0], [50.0, 0.0]],
        model=MODELS["single integrators"],
    )
    outcome = Outcome({"robot": team}, 2)
    assert outcome.inputs[-1].tolist() == request
    assert not outcome.events
    assert outcome.barriers[-1].tolist() == [5.0, 5.0]  # as far as it looks


def facing(request: Sequence[Sequence[float]], **parameters: Any) -> Team:
    return Team(
        {"sense": OmniscientPerception, "ask": lambda: Request(request), "keep": keeping(**parameters)},
        count=2,
        state=[[0.0, 0.0], [2.0, 0.0]],
        model=SingleIntegrator(),
        entity=DISC,
    )


def test_each_of_two_takes_half_of_what_may_be_used_up() -> None:
    outcome = Outcome({"robot": facing([[3.0, 0.5], [-3.0, 0.0]], gain=1.0, margin=0.4, sidestep=0.0)}, 1)
    assert outcome.inputs[0] == pytest.approx(np.array([[0.5, 0.5], [-0.5, 0.0]]))  # h = 2 - 0.6 - 0.4
    assert [event.data["body"] for event in outcome.named("filtered")] == ["robot.1", "robot.0"]


def test_of_others_that_do_not_do_their_half_the_velocity_counts() -> None:
    outcome = Outcome({"robot": facing([[3.0, 0.0], [-0.2, 0.0]], gain=1.0, cooperative=False, sidestep=0.0)}, 2)
    barrier = outcome.barriers[1][0]
    assert outcome.inputs[1][0, 0] == pytest.approx(barrier - 0.2)


def test_agents_in_each_others_way_turn_off_to_the_right() -> None:
    outcome = Outcome({"robot": facing([[1.0, 0.0], [-1.0, 0.0]], gain=1.0, sidestep=0.5)}, 1)
    (_, right), (_, left) = outcome.inputs[0]
    assert right == pytest.approx(-0.5 * 0.3)
    assert left == pytest.approx(0.5 * 0.3)


def test_if_distances_cannot_be_kept_the_event_says_which_was_relaxed_and_obstacles_come_last() -> None:
    wall = {"shape": {"box": {"length": 0.2, "width": 9.0}}}
    pushing = Obstacle.model_validate(
        {**wall, "path": {"times": [0, 10], "positions": [[-2.0, 0.0], [3.0, 0.0]]}},
    )
    team = Team(
        {"sense": OmniscientPerception, "ask": lambda: Request([[0.0, 0.0]]), "keep": keeping(cooperative=False)},
        count=1,
        model=MODELS["single integrators"],
        entity=DISC,
    )
    standing = Team(state=[[1.0, 0.0]], entity=DISC)
    outcome = Outcome({"robot": team, "standing": standing}, 120, {"wall": pushing})
    (event,) = outcome.named("infeasible")
    assert event.data["relaxed"] == "standing"
    assert 0 < event.data["slack"] < 0.5
    assert "standing" in event.text


def test_the_filter_says_once_if_inputs_are_held_for_longer_than_it_assumes() -> None:
    outcome = Outcome({"robot": crowd(MODELS["single integrators"], 0, period=3)}, 12)
    (event,) = outcome.named("held-too-long")
    assert event.data["held"] == pytest.approx(3 * HOLD)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (Bicycle(), "not a model with the control inputs speed, steering_angle"),
        (SingleIntegrator(SingleIntegrator.Parameters(dimensions=3)), "in the plane"),
        (DoubleIntegrator(), "max_acceleration"),
        (Unicycle(Unicycle.Parameters(min_speed=0.2)), "stand still"),
    ],
)
def test_a_model_that_it_cannot_keep_at_a_distance_is_refused(model: Model, message: str) -> None:
    group = Team(model=model).group("robot")
    with pytest.raises(ValueError, match=message):
        made(BarrierFilter).check(group)


def test_the_point_of_a_unicycle_moves_as_its_constraints_assume() -> None:
    random = np.random.default_rng(2)
    motion = HeadingInput(Unicycle(), 1.0, 0.05, 0.2)
    states = np.column_stack([random.normal(size=(20, 2)), random.uniform(-3, 3, 20)])
    inputs, step = random.normal(size=(20, 2)), 1e-6
    before = motion.points(states, states[:, :2])
    after = Unicycle().exact_step(states, inputs, step)
    assert after is not None
    moved = (motion.points(after, after[:, :2]) - before) / step
    directions = random.normal(size=(2, 20))
    rows = motion.along(directions, np.arange(20), states)
    assert (rows * inputs).sum(axis=1) == pytest.approx((moved * directions.T).sum(axis=1), abs=1e-5)


def test_a_gain_above_the_inverse_of_the_hold_has_no_effect() -> None:
    assert VelocityInput(SingleIntegrator(), 1e6, 0.05).gain == pytest.approx(20.0)


def test_the_market_has_no_contacts_with_the_filter_and_some_without() -> None:
    for changes, contacts in (([], False), (["agents.robot.components.keep=null"], True)):
        ready = build(MARKET, changes).simulation
        found: list[Event] = []
        ready.events.subscribe("contact", found.append)
        execute(ready, 250)
        assert bool(found) == contacts


def test_batches_have_the_same_bits() -> None:
    assert_batchable(MARKET, ["run.duration=1.5"])
