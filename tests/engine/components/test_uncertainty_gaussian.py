"""Gaussian beliefs against the textbook's recursion, and against the truth: are they as sure as they may be?"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.stats import chi2
from simulating import STEP, Team, present, simulation, untyped

from symaware_cli import Obstacle, Snapshot
from symaware_cli.core import Observation, Tracks
from symaware_cli.engine.components.kalman import Belief, Tracker, corrected, predicted
from symaware_cli.engine.components.perception import OmniscientPerception
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.components.uncertainty_gaussian import GaussianUncertainty
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.linear import Linear
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.language.build import build

SECONDS = STEP / 1e9


def sense(**parameters: Any) -> dict[str, Callable[..., Any]]:
    return {"sense": lambda: RangePerception(RangePerception.Parameters(**parameters))}


def believe(**parameters: Any) -> dict[str, Callable[..., Any]]:
    return {"believe": lambda: GaussianUncertainty(GaussianUncertainty.Parameters(**parameters))}


def drifting(time_step: float = SECONDS, intensity: float = 0.3, slowing: float = 1.0) -> Linear:
    """What trackers assume of others: straight on, but for white noise of acceleration, sampled exactly.

    What the velocity is multiplied by at each step would be new to them.
    """
    noise = intensity**2 * np.array([[time_step**3 / 3, time_step**2 / 2], [time_step**2 / 2, time_step]])
    return Linear(
        Linear.Parameters(
            time_step=time_step,
            state={"x": "m", "y": "m", "velocity_x": "m/s", "velocity_y": "m/s"},
            control_input={"nothing": "1"},
            A=np.kron([[1, time_step], [0, slowing]], np.eye(2)).tolist(),
            B=[[0.0]] * 4,
            W=np.kron(noise, np.eye(2)).tolist(),
        )
    )


class Run:
    """A simulation that is led by hand."""

    def __init__(self, teams: Mapping[str, Team], **options: Any) -> None:
        self._begin(simulation(teams, **options))

    @classmethod
    def of(cls, ready: Simulation) -> Self:
        run = cls.__new__(cls)
        run._begin(ready)
        return run

    def _begin(self, ready: Simulation) -> None:
        self.simulation = ready
        self.simulation.initialise()
        self.group = {group.name: group for group in self.simulation.groups}

    @property
    def world(self) -> Snapshot:
        return self.simulation.environment.snapshot()

    def turn(self) -> None:
        for entry in self.simulation.entries:
            for component in entry.components:
                component.compute_and_update()

    def step(self) -> None:
        self.simulation.environment.step()
        self.simulation.clock.now += self.simulation.environment.time_step

    def truth(self, name: str) -> NDArray[np.float64]:
        return self.simulation.environment.state(self.group[name])

    def covariance(self, name: str) -> NDArray[np.float64]:
        """The uncertainty of the own states; shape (n, nx, nx)."""
        times, values = present(self.group[name].awareness.uncertainty.shared)
        assert times.tolist() == [self.simulation.clock.now]
        count = self.group[name].awareness.state.shape[1]
        return values.reshape(-1, count, count)


# --- the textbook -----------------------------------------------------------------------------------------------------


class Textbook:
    """The recursion of one filter as it stands on the page, with inverses and Joseph's form."""

    def __init__(self, mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> None:
        self.mean, self.covariance = np.array(mean, float), np.array(covariance, float)

    def predict(self, mean: NDArray[np.float64], transition: NDArray[np.float64], noise: NDArray[np.float64]) -> None:
        self.mean = mean
        self.covariance = transition @ self.covariance @ transition.T + noise

    def correct(self, measured: NDArray[np.float64], noise: NDArray[np.float64], angles: tuple[int, ...] = ()) -> None:
        innovation = measured - self.mean
        for angle in angles:
            innovation[angle] = np.angle(np.exp(1j * innovation[angle]))
        gain = self.covariance @ np.linalg.inv(self.covariance + noise)
        rest = np.eye(len(self.mean)) - gain
        self.mean = self.mean + gain @ innovation
        self.covariance = rest @ self.covariance @ rest.T + gain @ noise @ gain.T


MODELS = {
    "unicycle": (Unicycle(Unicycle.Parameters(process_noise=[0.05, 0.04, 0.2])), [0.2, 0.1, 0.05]),
    "double-integrator": (DoubleIntegrator(DoubleIntegrator.Parameters(process_noise=0.1)), [0.2, 0.1, 0.3, 0.4]),
    "linear": (drifting(slowing=0.6), [0.2, 0.1, 0.3, 0.4]),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_belief_of_oneself_is_that_of_the_textbook(name: str) -> None:
    model, deviation = MODELS[name]
    nx, nu = len(model.state), len(model.control_input)
    chance = np.random.default_rng(5)
    start = chance.uniform(-3, 3, (4, nx))
    components = sense(range=1.0, self_noise=deviation) | believe(initial_deviation=0.3)
    run = Run({"robot": Team(components, count=4, state=start.tolist(), model=model)})
    group, awareness = run.group["robot"], run.group["robot"].awareness
    first = untyped(run.simulation.entries[1].components[0])._own.at_present().state
    assert 0.01 < np.abs(first - start).max() < 1.5
    filters = [Textbook(mean, 0.09 * np.eye(nx)) for mean in first]
    noise = model.noise_covariance(SECONDS)
    for number in range(60):
        run.turn()
        for row, book in enumerate(filters):
            if number:
                control = group.control_input[row : row + 1]
                after = present(model.exact_step(book.mean[None], control, SECONDS))[0]
                if name == "linear":
                    transition = np.array(model.parameters.A)
                else:
                    transition = expm(model.jacobian(0.5 * (book.mean + after)[None], control)[0] * SECONDS)
                assert noise is not None
                book.predict(after, transition, noise)
            assert awareness.observation is not None
            assert awareness.observation.state is not None
            book.correct(awareness.observation.state[row], np.diag(np.square(deviation)), model.angles)
            np.testing.assert_allclose(awareness.state[row], book.mean, rtol=0, atol=1e-10)
            np.testing.assert_allclose(run.covariance("robot")[row], book.covariance, rtol=0, atol=1e-10)
        if number % 10 == 0:
            group.control_input = model.limit(chance.uniform(-1, 1, (4, nu)))
        run.step()


def test_errors_are_carried_as_the_step_of_the_world_carries_them() -> None:
    """The transition against differences of the closed form; the middle of the step makes it right to second order."""
    for speed, turn_rate in [(1.0, 0.0), (2.0, 1.5), (-0.5, -2.0)]:
        model = Unicycle(Unicycle.Parameters(min_speed=-1, max_speed=2))
        state, control = np.array([[1.0, -2.0, 0.7]]), np.array([[speed, turn_rate]])
        for time, bound in [(0.1, 1e-3), (0.05, 1.3e-4), (0.025, 1.7e-5)]:
            belief = predicted(model, Belief(state, np.diag([0.0, 0.0, 1.0])[None]), control, time)
            nudge = [0, 0, 1e-6]
            ahead, behind = (
                present(model.exact_step(state + by, control, time)) for by in (np.array(nudge), -np.array(nudge))
            )
            column = (ahead - behind)[0] / 2e-6
            np.testing.assert_allclose(belief.covariance[0], np.outer(column, column), atol=bound)


def test_the_belief_of_others_is_that_of_the_textbook() -> None:
    chance = np.random.default_rng(8)
    state = np.column_stack([chance.uniform(0, 6, (12, 2)), chance.uniform(-3, 3, 12)])
    deviations = {"position_noise": 0.15, "velocity_noise": 0.25}
    components = sense(range=3.0, dropout=0.4, **deviations) | believe(acceleration_noise=0.7, memory=0.4)
    run = Run({"robot": Team(components, count=12, state=state.tolist(), model=Unicycle())})
    group, awareness = run.group["robot"], run.group["robot"].awareness
    transition = np.kron([[1, SECONDS], [0, 1]], np.eye(2))
    noise = 0.49 * np.kron([[SECONDS**3 / 3, SECONDS**2 / 2], [SECONDS**2 / 2, SECONDS]], np.eye(2))
    errors = np.diag([0.15**2, 0.15**2, 0.25**2, 0.25**2])
    filters: dict[tuple[np.int64, np.int64], Textbook] = {}
    ages: dict[tuple[np.int64, np.int64], int] = {}
    for number in range(80):
        if number % 10 == 0:
            group.control_input = np.column_stack([np.full(12, 1.0), chance.uniform(-2, 2, 12)])
        run.turn()
        for pair, book in filters.items():
            book.predict(transition @ book.mean, untyped(transition), untyped(noise))
            ages[pair] += 1
        assert awareness.observation is not None
        seen = awareness.observation.tracks
        measured = np.hstack([seen.positions, seen.velocities])
        for pair, value in zip(zip(seen.observers, seen.others, strict=True), measured, strict=True):
            if pair in filters:
                filters[pair].correct(value, errors)
            else:
                filters[pair] = Textbook(value, errors)
            ages[pair] = 0
        filters = {pair: book for pair, book in filters.items() if ages[pair] * STEP <= 0.4e9}
        tracks = awareness.tracks
        assert tracks is not None
        pairs = list(zip(tracks.observers, tracks.others, strict=True))
        assert pairs == sorted(filters)
        for place, pair in enumerate(pairs):
            assert tracks is not None
            believed = np.concatenate([tracks.positions[place], tracks.velocities[place]])
            np.testing.assert_allclose(believed, filters[pair].mean, rtol=0, atol=1e-10)
            assert tracks.covariances is not None
            np.testing.assert_allclose(tracks.covariances[place], filters[pair].covariance, rtol=0, atol=1e-10)
            assert tracks.ages[place] == pytest.approx(ages[pair] * SECONDS)
        run.step()


# --- covariances are covariances --------------------------------------------------------------------------------------

deviations = st.sampled_from([0.0, 0.0, 1e-9, 1e-3, 1.0, 1e6])


def assert_is_covariance(matrices: NDArray[np.float64]) -> None:
    """Symmetric to the bit, and no negative eigenvalue of the correlations but by rounding."""
    assert np.array_equal(matrices, matrices.transpose(0, 2, 1))
    diagonal = matrices[:, np.arange(matrices.shape[1]), np.arange(matrices.shape[1])]
    assert (diagonal >= 0).all()
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    lowest = np.linalg.eigvalsh(matrices / scale[:, :, None] / scale[:, None, :]).min()
    assert lowest >= -1e-9


@given(st.integers(0, 2**32 - 1), st.sampled_from(list(MODELS)), st.lists(deviations, min_size=8, max_size=8))
@settings(max_examples=60)
def test_the_covariance_of_oneself_is_always_one(seed: int, name: str, drawn: list[float]) -> None:
    model, _ = MODELS[name]
    nx, chance = len(model.state), np.random.default_rng(seed)
    belief = Belief(chance.uniform(-5, 5, (3, nx)), np.tile(np.diag(np.square(drawn[:nx])), (3, 1, 1)))
    for _ in range(40):
        control = chance.uniform(-1, 1, (3, len(model.control_input)))
        belief = predicted(model, belief, control, SECONDS)
        assert_is_covariance(belief.covariance)
        if chance.random() < 0.5:
            belief = corrected(model, belief, belief.state + 0.1, np.array(drawn[-nx:]))
            assert_is_covariance(belief.covariance)
    assert np.isfinite(belief.state).all()


@given(st.integers(0, 2**32 - 1), deviations, deviations, deviations)
@settings(max_examples=60)
def test_the_covariances_of_others_always_are(seed: int, position: float, velocity: float, acceleration: float) -> None:
    chance = np.random.default_rng(seed)
    tracker = Tracker(3, 10, 2, acceleration**2, 10**9, np.inf)
    now = 0
    for _ in range(40):
        now += int(chance.integers(0, 3)) * STEP
        pairs = np.argwhere(chance.random((3, 10)) < 0.4)
        seen = Tracks.of(
            now, 3, pairs[:, 0], pairs[:, 1], chance.normal(size=(len(pairs), 2)), chance.normal(size=(len(pairs), 2))
        )
        tracker.observe(Observation(now, None, np.zeros(2), seen, position, velocity))
        for ahead in (0, STEP):
            tracks = tracker.tracks(now + ahead, now)
            assert np.isfinite(tracks.positions).all()
            assert tracks.covariances is not None
            assert_is_covariance(tracks.covariances)


def test_exact_measurements_give_exact_beliefs() -> None:
    components = sense(range=9.0) | believe(initial_deviation=1.0, acceleration_noise=0.0)
    run = Run({"robot": Team(components, count=4, model=Unicycle(Unicycle.Parameters(process_noise=0.1)))})
    group = run.group["robot"]
    group.control_input = [[1.0, 0.5]] * 4
    for _ in range(5):
        run.turn()
        assert np.array_equal(group.awareness.state, run.truth("robot"))
        assert not run.covariance("robot").any()
        tracks = group.awareness.tracks
        assert tracks is not None
        np.testing.assert_allclose(tracks.positions, run.world.positions[tracks.others], rtol=0, atol=1e-15)
        assert tracks.covariances is not None
        assert not tracks.covariances.any()
        run.step()


def test_elements_that_are_measured_exactly_are_known_exactly_beside_others_that_are_not() -> None:
    components = sense(range=1.0, self_noise=[0.1, 0.0, 0.2]) | believe()
    run = Run({"robot": Team(components, count=4, model=Unicycle(Unicycle.Parameters(process_noise=0.1)))})
    for _ in range(5):
        run.turn()
        run.step()
    run.turn()
    assert np.array_equal(run.group["robot"].awareness.state[:, 1], run.truth("robot")[:, 1])
    covariance = run.covariance("robot")
    assert not covariance[:, 1].any()
    assert (covariance[:, 0, 0] > 0).all()
    assert (covariance[:, 2, 2] > 0).all()


def test_headings_are_compared_the_short_way_round() -> None:
    before = Belief(np.array([[0.0, 0.0, 3.1]]), np.eye(3)[None])
    after = corrected(Unicycle(), before, np.array([[0.0, 0.0, -3.1]]), np.ones(3))
    assert after.state[0, 2] == pytest.approx(np.pi)
    turns_on = corrected(Unicycle(), before, np.array([[0.0, 0.0, 3.2 + 6 * np.pi]]), np.ones(3))
    assert turns_on.state[0, 2] == pytest.approx(3.15)


# --- honesty ----------------------------------------------------------------------------------------------------------


def share_inside(errors: NDArray[np.float64], covariances: NDArray[np.float64], probability: float = 0.95) -> float:
    """How many errors (n, k) lie in the ellipse that holds them with a probability, if the covariances are right."""
    distances = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])
    return float((distances <= chi2.ppf(probability, errors.shape[1])).mean())


def is_honest(share: float) -> bool:
    return 0.93 <= share <= 0.97


def test_a_thousand_agents_are_as_sure_of_themselves_as_they_may_be() -> None:
    noise = {"process_noise": [0.05, 0.05, 0.1]}
    model = Unicycle(Unicycle.Parameters(**noise))
    chance = np.random.default_rng(2)
    state = np.column_stack([10.0 * np.arange(1000), np.zeros(1000), chance.uniform(-3, 3, 1000)]).tolist()
    start = {"initial_deviation": [0.3, 0.3, 0.1]}
    seeing = Team(sense(range=1.0, self_noise=[0.2, 0.2, 0.1]) | believe(**start), 1000, state, model=model)
    late = replace(seeing, components=sense(range=1.0, self_noise=[0.2, 0.2, 0.1], delay=0.4) | believe(**start))
    blind = replace(seeing, components=believe(**start))
    run = Run({"seeing": seeing, "late": late, "blind": blind})
    for number in range(61):
        run.turn()
        if number % 15 == 0:
            spread = {}
            for name, group in run.group.items():
                errors, covariance = group.awareness.state - run.truth(name), run.covariance(name)
                assert is_honest(share_inside(errors, covariance)), (name, number)
                assert is_honest(share_inside(errors[:, :2], covariance[:, :2, :2])), (name, number)
                spread[name] = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1]).mean()
            assert number == 0 or spread["seeing"] < spread["late"] < spread["blind"]
        for group in run.group.values():
            group.control_input = np.column_stack([np.ones(1000), chance.uniform(-1, 1, 1000)])
        run.step()


WALL_AWAY = -100.0


def watching(
    count: int, spacing: float = 1000.0, *, hidden: tuple[float, float] = (1.5, 3.0), **perception: float
) -> dict[str, dict[str, Any]]:
    """Watchers, each with somebody to watch 20 m away, and a wall that stands between them for a time [s]."""
    watchers = Team(
        sense(range=200.0, occlusion=True, position_noise=0.3, velocity_noise=0.2, **perception)
        | believe(acceleration_noise=0.3),
        count,
        [[spacing * number, 0.0] for number in range(count)],
        model=SingleIntegrator(),
    )
    watched = Team(
        {}, count, [[spacing * number, 20.0, 0.4, 0.0] for number in range(count)], model=drifting(intensity=0.3)
    )
    times = [0.0, hidden[0] - 0.001, hidden[0], hidden[1] - 0.001, hidden[1]]
    places = [[0.0, y] for y in (WALL_AWAY, WALL_AWAY, 10.0, 10.0, WALL_AWAY)]
    wall = Obstacle(
        shape={"wall": {"points": [[-500.0, 0.0], [spacing * count, 0.0]]}},
        path={"times": times, "positions": places},
    )
    return {"teams": {"watcher": watchers, "watched": watched}, "obstacles": {"wall": wall}}


def tracked(run: Any, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Errors (n, 4) and covariances (n, 4, 4) of what each watcher believes of whom it watches, and the age."""
    tracks, truth = run.group["watcher"].awareness.tracks, run.truth("watched")
    start = run.simulation.environment.roster.start("watched")
    assert tracks.others.tolist() == [start + row for row in range(count)]
    errors = np.hstack([tracks.positions, tracks.velocities]) - truth
    return errors, tracks.covariances, tracks.ages


@pytest.mark.parametrize(("delay", "dropout"), [(0.0, 0.0), (0.2, 0.0), (0.0, 0.5)])
def test_a_thousand_agents_are_as_sure_of_others_as_they_may_be_in_sight_and_out_of_it(
    delay: float, dropout: float
) -> None:
    scene = watching(1000, delay=delay, dropout=dropout)
    run = Run(scene.pop("teams"), **scene)
    spread = {}
    for number in range(81):
        run.turn()
        # In sight; just hidden, half-way and at the end of it; in sight again.
        if number in (20, 28, 35, 45, 59, 70, 80):
            errors, covariances, ages = tracked(run, 1000)
            assert is_honest(share_inside(errors, covariances)), number
            assert is_honest(share_inside(errors[:, :2], covariances[:, :2, :2])), number
            spread[number] = np.sqrt(covariances[:, 0, 0]).mean()
            if not dropout:
                hidden_since = max(0, min(number, 59 + delay / SECONDS) - 29 - delay / SECONDS)
                back = number - delay / SECONDS >= 60
                assert ages == pytest.approx(delay + (0 if back else hidden_since) * SECONDS), number
        run.step()
    assert spread[28] < spread[45] < spread[59] > spread[80]
    assert spread[59] > 2 * spread[28]
    assert spread[80] == pytest.approx(spread[28], rel=0.1)


@pytest.mark.slow
def test_over_four_hundred_seeds_agents_are_as_sure_as_they_may_be_of_themselves_and_of_others() -> None:
    """Three agents in each run, so that 0.93 to 0.97 is three standard errors of 1,200 around 0.95."""
    model = Unicycle(Unicycle.Parameters(process_noise=[0.05, 0.05, 0.1]))
    moments = (9, 15, 19, 26)  # in sight; hidden, half-way and at the end of it; in sight again
    own: dict[int, list[Any]] = {at: [] for at in moments}
    other: dict[int, list[Any]] = {at: [] for at in moments}
    for seed in range(400):
        scene = watching(3, hidden=(0.5, 1.0))
        walker = Team(
            sense(range=1.0, self_noise=[0.2, 0.2, 0.1]) | believe(initial_deviation=0.1),
            3,
            [[500 * number, 900, 0] for number in range(3)],
            model=model,
        )
        run = Run(scene.pop("teams") | {"walker": walker}, seed=seed, **scene)
        run.group["walker"].control_input = [[1.0, 0.3]] * 3
        for number in range(moments[-1] + 1):
            run.turn()
            if number in moments:
                wrong = run.group["walker"].awareness.state - run.truth("walker")
                own[number].extend(zip(wrong, run.covariance("walker"), strict=True))
                errors, covariances, ages = tracked(run, 3)
                assert ages == pytest.approx({15: 6, 19: 10}.get(number, 0) * SECONDS)
                other[number].extend(zip(errors, covariances, strict=True))
            run.step()
    for number in moments:
        for gathered in (own[number], other[number]):
            errors, covariances = (np.array(part) for part in zip(*gathered, strict=True))
            assert is_honest(share_inside(errors, covariances)), number
            assert is_honest(share_inside(errors[:, :2], covariances[:, :2, :2])), number


# --- late, seldom, never ----------------------------------------------------------------------------------------------


def test_a_late_observation_is_taken_account_of_where_it_belongs() -> None:
    """Errors are those of the instant that is seen: what is believed late is what was believed then, carried on."""
    late = 4
    model = Unicycle(Unicycle.Parameters(process_noise=0.1))
    noise = {"range": 5.0, "self_noise": 0.1, "position_noise": 0.1, "velocity_noise": 0.1}
    past = []
    for delay in (0.0, late * SECONDS):
        components = sense(**noise, delay=delay) | believe(initial_deviation=0.2)
        run = Run({"robot": Team(components, count=3, model=model)})
        group, chance = run.group["robot"], np.random.default_rng(4)
        inputs: list[NDArray[np.float64]] = []
        for number in range(20):
            run.turn()
            if not delay:
                past.append((group.awareness.state, run.covariance("robot"), group.awareness.tracks))
            elif number >= late:
                state, covariance, tracks = past[number - late]
                belief = Belief(state, covariance)
                for control_input in inputs[-late:]:
                    belief = predicted(model, belief, control_input, SECONDS)
                np.testing.assert_allclose(group.awareness.state, belief.state, atol=1e-12)
                np.testing.assert_allclose(run.covariance("robot"), belief.covariance, atol=1e-12)
                assert tracks is not None
                ahead = tracks.positions + late * SECONDS * tracks.velocities
                assert group.awareness.tracks is not None
                np.testing.assert_allclose(group.awareness.tracks.positions, ahead, atol=1e-12)
                assert group.awareness.tracks.ages == pytest.approx(late * SECONDS)
            group.control_input = np.column_stack([np.ones(3), chance.uniform(-2, 2, 3)])
            inputs.append(group.control_input)
            run.step()


def test_before_anything_is_seen_and_without_a_perception_the_model_is_all_there_is() -> None:
    model = Unicycle()
    delayed = Team(sense(range=9.0, self_noise=1.0, delay=99.0) | believe(), count=2, model=model)
    blind = Team(believe(), count=2, model=model)
    run = Run({"delayed": delayed, "blind": blind})
    for group in run.group.values():
        group.control_input = [[1.0, 0.7], [0.5, -0.3]]
    for _ in range(10):
        run.turn()
        run.step()
    run.turn()
    for name, group in run.group.items():
        np.testing.assert_allclose(group.awareness.state, run.truth(name), atol=1e-12)
        assert not run.covariance(name).any()
        assert group.awareness.tracks is not None
        assert len(group.awareness.tracks) == 0


def test_nothing_is_held_on_to_for_longer_than_it_is_needed() -> None:
    run = Run({"robot": Team(believe(), count=2), "late": Team(sense(range=1.0, delay=0.2) | believe(), count=2)})
    for _ in range(50):
        run.turn()
        run.step()
    believing = {entry.group.name: entry.components[-1] for entry in run.simulation.entries if entry.name == "believe"}
    blind, late = believing["robot"], believing["late"]
    assert len(untyped(blind)._own._inputs) == 0
    assert len(untyped(late)._own._inputs) == 4


def test_turns_that_are_seldom_believe_the_same_of_oneself() -> None:
    """As long as the control input stays the same."""
    model = drifting()
    run = Run({"often": Team(believe(initial_deviation=0.1), model=model), "seldom": Team(believe(), model=model)})
    often, seldom = (entry.components[0] for entry in run.simulation.entries)
    untyped(seldom)._own._belief = untyped(often)._own._belief
    for number in range(13):
        often.compute_and_update()
        if number % 4 == 0:
            seldom.compute_and_update()
            np.testing.assert_allclose(run.covariance("seldom"), run.covariance("often"), atol=1e-15)
            np.testing.assert_allclose(
                run.group["seldom"].awareness.state, run.group["often"].awareness.state, atol=1e-15
            )
        run.step()


def test_an_observation_counts_once() -> None:
    """However many turns pass before the next one."""
    run = Run({"robot": Team(sense(range=2.0, self_noise=0.1, position_noise=0.1) | believe(initial_deviation=1.0), 2)})
    run.turn()
    (_, belief) = run.simulation.entries
    state, covariance, tracks = (
        run.group["robot"].awareness.state,
        run.covariance("robot"),
        run.group["robot"].awareness.tracks,
    )
    for _ in range(5):
        belief.components[0].compute_and_update()
    assert np.array_equal(run.group["robot"].awareness.state, state)
    assert np.array_equal(run.covariance("robot"), covariance)
    assert tracks is not None
    assert tracks.covariances is not None
    assert np.array_equal(present(present(run.group["robot"].awareness.tracks).covariances), tracks.covariances)
    variances = []
    for number in range(9):
        run.step()
        if number % 4 == 3:
            run.turn()
        else:
            belief.components[0].compute_and_update()
        variances.append(present(present(run.group["robot"].awareness.tracks).covariances)[0, 0, 0])
    # What is not seen becomes less sure at every turn between two observations.
    assert (np.diff(variances) > 0).tolist() == [True, True, False, True, True, True, False, True]


def passing(**parameters: float) -> list[int]:
    """Somebody who is in range for a while, then never again; how many are known at each step."""
    watcher = Team(sense(range=1.01, position_noise=0.01) | believe(**parameters), state=[[0.0, 0.0]])
    run = Run({"watcher": watcher, "visitor": Team(state=[[0.0, 0.0]])})
    run.group["visitor"].control_input = [[2.0, 0.0]]
    known = []
    for _ in range(60):
        run.turn()
        known.append(len(present(run.group["watcher"].awareness.tracks)))
        run.step()
    return known


def test_an_agent_out_of_sight_is_remembered_for_the_memory() -> None:
    # Seen up to step 10, at 1 m.
    assert passing(memory=0.0) == [1] * 11 + [0] * 49
    assert passing(memory=0.5) == [1] * 21 + [0] * 39
    assert passing(memory=99.0) == [1] * 60


def test_an_agent_with_a_too_uncertain_belief_is_given_up() -> None:
    # Out of sight the variance of the position is at most 0.01^2 + q t^3 / 3, and 0.2 m are reached before 0.5 s.
    known = passing(memory=99.0, max_deviation=0.2, acceleration_noise=1.0)
    assert sum(known) in (20, 21)
    assert known == sorted(known, reverse=True)


def test_an_agent_that_comes_back_is_recognised() -> None:
    run = Run(watching(1).pop("teams"), obstacles=watching(1)["obstacles"])
    variances = []
    for _ in range(70):
        run.turn()
        variances.append(tracked(run, 1)[1][0, 0, 0])
        run.step()
    hidden = variances[30:60]
    assert (np.diff(hidden) > 0).all()
    # Better than what is measured once: 0.3 m.
    assert variances[60] < 0.3**2 < variances[59]


def test_agents_far_away_change_nothing() -> None:
    model = Unicycle(Unicycle.Parameters(process_noise=0.1))
    noise = {"range": 5.0, "self_noise": 0.1, "position_noise": 0.1, "velocity_noise": 0.1, "dropout": 0.3}
    team = Team(sense(**noise) | believe(initial_deviation=0.2), count=5, model=model)
    far = [[1e4 + row, 0.0, 0.0] for row in range(80)]
    told: list[list[bytes]] = []
    for teams in (
        {"robot": team},
        {"robot": replace(team, count=85, state=[*([float(row), 0.0, 0.0] for row in range(5)), *far])},
        {"zebra": replace(team, count=80, state=far), "robot": team, "ant": replace(team, count=80, state=far)},
    ):
        run = Run(teams)
        for group in run.group.values():
            group.control_input = [[0.5, 0.5]] * len(group)
        told.append([])
        for _ in range(10):
            run.turn()
            awareness = run.group["robot"].awareness
            assert awareness.tracks is not None
            rows = awareness.tracks.observers < 5
            assert awareness.tracks.covariances is not None
            told[-1] += [
                awareness.state[:5].tobytes(),
                run.covariance("robot")[:5].tobytes(),
                awareness.tracks.positions[rows].tobytes(),
                awareness.tracks.covariances[rows].tobytes(),
            ]
            run.step()
    assert told[0] == told[1] == told[2]


def test_beliefs_share_no_memory_with_the_world() -> None:
    run = Run({"robot": Team(sense(range=5.0) | believe(), count=3), "blind": Team(believe(), count=3)})
    for _ in range(3):
        run.turn()
        for name, group in run.group.items():
            assert group.awareness.tracks is not None
            for own in (group.awareness.state, group.awareness.tracks.positions, group.awareness.tracks.velocities):
                for theirs in (run.truth(name), run.world.positions, run.world.velocities):
                    assert not np.shares_memory(own, theirs)
        run.step()


def test_an_agent_with_perfect_perception_does_not_lose_sight_of_others() -> None:
    team = Team({"sense": OmniscientPerception, "estimate": GaussianUncertainty}, count=3)
    run = Run({"robot": team})
    for _ in range(3):
        run.turn()
        assert run.group["robot"].others(100.0).others.tolist() == [1, 2, 0, 2, 0, 1]
        run.step()


def test_a_list_of_deviations_fits_the_state() -> None:
    with pytest.raises(ValueError, match="`initial_deviation` is a list of 3, and the state has 2 elements: x, y"):
        GaussianUncertainty(GaussianUncertainty.Parameters(initial_deviation=[1, 2, 3])).check(Team().group("robot"))


def test_noisy_shows_beliefs_that_grow_unsure_behind_a_wall_and_are_honest_there(scenarios: Path) -> None:
    run = Run.of(build(scenarios / "noisy.yaml").simulation)
    roster = run.simulation.environment.roster
    spread: dict[str, list[Any]] = {"straight": [], "turner": []}
    errors: dict[str, list[Any]] = {"straight": [], "turner": []}
    inside: dict[str, list[Any]] = {"straight": [], "turner": []}
    for _ in range(360):
        run.turn()
        tracks = run.group["watcher"].awareness.tracks
        assert tracks is not None
        for place, other in enumerate(tracks.others):
            name = roster.ids[other]
            assert tracks is not None
            assert tracks.covariances is not None
            error, covariance = tracks.positions[place] - run.truth(name)[0, :2], tracks.covariances[place, :2, :2]
            spread[name].append(np.sqrt(covariance[0, 0]))
            errors[name].append(np.linalg.norm(error))
            inside[name].append(share_inside(error[None], covariance[None]))
        run.step()
    for name in spread:
        longest = int(np.argmax(spread[name]))
        assert 2.0 < spread[name][longest] < 5.0
        assert spread[name][longest + 5] < 0.3
        # The four seconds before it comes back, and all the time.
        assert np.mean(inside[name][longest - 80 : longest + 1]) == 1.0
        assert np.mean(inside[name]) > 0.85
    assert max(errors["straight"]) < 2.0 < 5.0 < max(errors["turner"])
