"""The kinematic world: how it integrates, what it applies, and its noise."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from simulating import Team, made, simulate, untyped

from symaware_cli import Model
from symaware_cli.core import AgentGroup, Entity, GroupComponent, WorldError
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.environments.process_noise import cholesky
from symaware_cli.engine.models.aircraft import DubinsAircraft
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.linear import Linear
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.log.reader import open_log
from symaware_cli.world.integration import euler, rk4


def group_of(
    model: Model, count: int = 1, name: str = "robot", ids: Sequence[str] | None = None, state: Any = None
) -> AgentGroup:
    ids = ids or [f"{name}.{row}" for row in range(count)]
    return AgentGroup(name, ids, model, Entity(), np.zeros((len(ids), len(model.state))) if state is None else state)


def world(*groups: AgentGroup, seed: int = 7, **parameters: Any) -> KinematicEnvironment:
    environment = made(KinematicEnvironment, **parameters)
    environment.initialise(groups, {}, seed)
    return environment


def walk(covariance: Sequence[list[float]] | None = None, time_step: float = 1.0) -> Linear:
    return made(
        Linear,
        time_step=time_step,
        state={"x": "m", "y": "m"},
        control_input={"step_x": "m", "step_y": "m"},
        A=[[1, 0], [0, 1]],
        B=[[1, 0], [0, 1]],
        W=covariance,
    )


class Unsolved(Unicycle):
    """A unicycle that nobody has a closed form for."""

    def successor(
        self, state: NDArray[np.float64], control_input: NDArray[np.float64], step: float, math: ModuleType
    ) -> Any:
        return None


def driven(model: Unicycle, **parameters: Any) -> NDArray[np.float64]:
    """Where a vehicle is after a second at speed 0.8 and turn rate 1.5."""
    group = group_of(model)
    group.control_input = np.array([[0.8, 1.5]])
    environment = world(group, **parameters)
    for _ in range(round(1.0 / parameters.get("time_step", 0.05))):
        environment.step()
    result: NDArray[np.float64] = environment.state(group)[0]
    return result


EXACT = np.array([0.8 / 1.5 * np.sin(1.5), 0.8 / 1.5 * (1 - np.cos(1.5)), 1.5])  # the arc, in closed form


def test_by_default_the_closed_form_moves_those_that_have_one() -> None:
    assert np.allclose(driven(Unicycle(), time_step=1.0), EXACT, rtol=1e-15)
    assert np.allclose(driven(Unicycle(), time_step=0.05), EXACT, rtol=1e-13)


def test_others_are_integrated_by_runge_kutta() -> None:
    assert np.array_equal(driven(Unsolved()), driven(Unicycle(), integrator="rk4"))
    assert np.allclose(driven(Unsolved()), EXACT, rtol=1e-7)


@pytest.mark.parametrize(("integrator", "one_step"), [("rk4", rk4), ("euler", euler)])
def test_each_integrator_is_what_it_is_called(integrator: str, one_step: Callable[..., Any]) -> None:
    state, control_input = np.zeros((1, 3)), np.array([[0.8, 1.5]])
    assert np.array_equal(
        driven(Unicycle(), integrator=integrator, time_step=1.0), one_step(Unicycle(), state, control_input, 1.0)[0]
    )


@pytest.mark.parametrize(("integrator", "order"), [("rk4", 4), ("euler", 1)])
def test_twice_the_substeps_err_less_by_the_order_of_the_integrator(integrator: str, order: int) -> None:
    def error(substeps: int) -> float:
        moved = driven(Unicycle(), integrator=integrator, substeps=substeps, time_step=0.5)
        return float(np.abs(moved - EXACT).max())

    assert error(16) / error(32) == pytest.approx(2.0**order, rel=0.05)


def test_substeps_are_shorter_steps() -> None:
    parts = driven(Unicycle(), integrator="rk4", substeps=4, time_step=0.2)
    assert np.allclose(parts, driven(Unicycle(), integrator="rk4", time_step=0.05), rtol=1e-14)


@pytest.mark.parametrize("integrator", ["exact", "rk4", "euler"])
def test_a_model_in_discrete_time_is_never_integrated(integrator: str) -> None:
    group = group_of(walk())
    group.control_input = np.array([[2.0, -3.0]])
    environment = world(group, time_step=1.0, integrator=integrator, substeps=5)
    environment.step()
    environment.step()
    assert environment.state(group).tolist() == [[4.0, -6.0]]


def test_a_model_in_discrete_time_is_refused_where_the_world_steps_otherwise() -> None:
    with pytest.raises(WorldError, match=r"the model is a map over 1 s, and the environment steps by 0\.05 s"):
        world(group_of(walk()))


@pytest.mark.parametrize("bad", [{"integrator": "magic"}, {"substeps": 0}, {"substeps": 1001}, {"substeps": 1.5}])
def test_parameters_that_make_no_sense_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        made(KinematicEnvironment, **bad)


class Rush(GroupComponent):
    """Asks for more than there is."""

    def _compute(self) -> NDArray[np.float64]:
        return np.array([[9.0, -9.0], [0.5, 0.25]])

    def _update(self, value: NDArray[np.float64]) -> None:
        self._group.control_input = value


def test_requested_and_applied_control_inputs_are_both_in_the_log(tmp_path: Path) -> None:
    team = Team({"rush": Rush}, count=2, model=made(Unicycle, max_speed=1.0, max_turn_rate=2.0))
    simulate({"robot": team}, 3, tmp_path / "run.mcap")
    log = open_log(tmp_path / "run.mcap")
    assert log.series("robot.0", "requested_control").values[0].tolist() == [9.0, -9.0]
    assert log.series("robot.0", "applied_control").values[0].tolist() == [1.0, -2.0]
    assert log.series("robot.1", "applied_control").values[0].tolist() == [0.5, 0.25]


def test_the_world_moves_by_applied_control_inputs() -> None:
    group = group_of(made(SingleIntegrator, max_speed=1.0))
    group.control_input = np.array([[30.0, 40.0]])
    environment = world(group, time_step=1.0)
    environment.step()
    assert np.allclose(environment.applied_input(group), [[0.6, 0.8]])
    assert np.allclose(environment.state(group), [[0.6, 0.8]])
    assert group.control_input.tolist() == [[30.0, 40.0]]


def test_an_aircraft_flies_from_the_first_instant_on() -> None:
    model = made(DubinsAircraft, min_speed=6.0, max_speed=9.0, max_turn_rate=0.1)
    assert world(group_of(model)).snapshot().velocities.tolist() == [[6.0, 0.0]]


def test_a_step_makes_new_arrays_that_nobody_can_write_to() -> None:
    group = group_of(made(Unicycle, process_noise=0.1), 3)
    environment = world(group)
    before = environment.state(group)
    copy = before.copy()
    environment.step()
    assert environment.state(group) is not before
    assert np.array_equal(before, copy)
    for array in (environment.state(group), environment.applied_input(group)):
        assert not array.flags.writeable


def shaken(
    groups: Sequence[AgentGroup], steps: int = 1, seed: int = 7, **parameters: float
) -> dict[str, NDArray[np.float64]]:
    """The noise that each group gathers while it stands still; by group name."""
    environment = world(*groups, seed=seed, **parameters)
    for _ in range(steps):
        environment.step()
    return {group.name: environment.state(group) for group in groups}


def test_adding_agents_changes_nobodys_noise() -> None:
    model = made(DoubleIntegrator, process_noise=0.1)
    few = shaken([group_of(model, 2)], steps=300)["robot"]
    many = shaken([group_of(model, 40), group_of(made(Unicycle, process_noise=0.3), 3, "car")], steps=300)
    assert np.array_equal(many["robot"][:2], few)
    # Nor does the order in which they are told, nor who stands beside whom in the group.
    swapped = group_of(model, ids=["robot.1", "robot.0"])
    assert np.array_equal(shaken([swapped], steps=300)["robot"][::-1], few)


def test_the_same_seed_draws_the_same_noise_and_another_another() -> None:
    model = made(SingleIntegrator, process_noise=0.1)
    one, same, other = (shaken([group_of(model, 5)], 3, seed)["robot"] for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.isin(other, one).any()


@pytest.mark.parametrize("time_step", [0.01, 0.25])
def test_the_spread_after_a_second_does_not_depend_on_the_time_step(time_step: float) -> None:
    model = made(SingleIntegrator, process_noise=[0.5, 2.0])
    gathered = shaken([group_of(model, 4_000)], round(1.0 / time_step), time_step=time_step)["robot"]
    # A random walk: variance sigma^2 t. The mean of 4,000 errs by sigma / 63, their spread by sigma / 89: 4 of these.
    assert np.allclose(gathered.mean(axis=0) / [0.5, 2.0], 0.0, atol=4 / np.sqrt(4_000))
    assert np.allclose(gathered.std(axis=0) / [0.5, 2.0], 1.0, atol=4 / np.sqrt(8_000))
    for column, sigma in enumerate([0.5, 2.0]):
        assert stats.kstest(gathered[:, column], "norm", args=(0.0, sigma)).pvalue > 0.01
    assert abs(untyped(np.corrcoef(gathered.T))[0, 1]) < 4 / np.sqrt(4_000)


def test_noise_is_independent_from_step_to_step() -> None:
    model = made(SingleIntegrator, process_noise=1.0)
    environment = world(group := group_of(model, 200), time_step=1.0)
    path = [environment.state(group)]
    for _ in range(50):
        environment.step()
        path.append(environment.state(group))
    increments = np.diff(np.array(path), axis=0)
    followers = np.corrcoef(increments[:-1].ravel(), increments[1:].ravel())[0, 1]
    assert abs(followers) < 4 / np.sqrt(increments[1:].size)
    assert stats.kstest(increments.ravel(), "norm").pvalue > 0.01


def test_the_noise_of_a_linear_model_has_its_covariance() -> None:
    covariance = [[0.5, 0.3], [0.3, 0.2]]
    gathered = shaken([group_of(walk(covariance), 20_000)], time_step=1.0)["robot"]
    # An entry of the sample covariance of N draws errs by sqrt((w_ij^2 + w_ii w_jj) / N).
    W = np.array(covariance)
    errors = np.sqrt((W**2 + np.outer(np.diag(W), np.diag(W))) / 20_000)
    assert (np.abs(np.cov(gathered.T) - W) < 4 * errors).all()
    assert (np.abs(gathered.mean(axis=0)) < 4 * np.sqrt(np.diag(W) / 20_000)).all()


def test_the_factor_of_a_covariance_is_that_of_numpy_and_exists_for_singular_ones_too() -> None:
    random = np.random.default_rng(2)
    root = random.normal(size=(5, 5))
    assert np.allclose(cholesky(root @ root.T), np.linalg.cholesky(root @ root.T), atol=1e-12)
    for rank in range(5):
        singular = root[:, :rank] @ root[:, :rank].T
        factor = cholesky(singular)
        assert np.allclose(factor @ factor.T, singular, atol=1e-9)
        assert np.array_equal(factor, np.tril(factor))
    gap = np.array([[0.0, 0.0], [0.0, 4.0]])
    assert cholesky(gap).tolist() == [[0.0, 0.0], [0.0, 2.0]]


def test_without_noise_a_state_stays_where_it_is_put() -> None:
    assert not shaken([group_of(made(SingleIntegrator, process_noise=0.0), 3)], 10)["robot"].any()
    only_heading = shaken([group_of(made(Unicycle, process_noise=[0.0, 0.0, 0.2]), 3)], 10)["robot"]
    assert not only_heading[:, :2].any()
    assert only_heading[:, 2].all()


class Alone(Unicycle):
    """A unicycle of which rows might depend on each other, so that its groups are moved one by one."""

    batchable = False


@pytest.mark.parametrize("integrator", ["exact", "rk4"])
def test_groups_with_equal_models_move_as_each_does_by_itself(integrator: str) -> None:
    counts, noise = (1, 4, 2), {"process_noise": 0.1}

    def moved(kind: type[Unicycle], limits: Sequence[float]) -> list[NDArray[np.float64]]:
        groups = []
        for number, (count, limit) in enumerate(zip(counts, limits, strict=True)):
            places = np.arange(3.0 * count).reshape(count, 3) + 0.1 * number
            group = group_of(made(kind, max_speed=limit, **noise), count, f"g{number}", state=places)
            group.control_input = 0.3 * places[:, :2] - 1.0
            groups.append(group)
        groups[1].present = np.array([True, False, True, True])
        environment = world(*groups, integrator=integrator)
        for _ in range(5):
            environment.step()
        return [environment.state(group) for group in groups]

    for limits in ((1.0, 1.0, 1.0), (1.0, 0.5, 1.0)):
        together, apart = moved(Unicycle, limits), moved(Alone, limits)
        assert all(np.array_equal(one, other) for one, other in zip(together, apart, strict=True))
        assert not any(state.flags.writeable for state in together)


@pytest.mark.parametrize("provided", [(), ("wings",), ("wheels", "wings")])
def test_a_model_moves_only_in_worlds_with_the_features_that_it_needs(provided: tuple[str, ...]) -> None:
    class Bird(SingleIntegrator):
        needs = ("wheels", "wings")

    class Sky(KinematicEnvironment):
        pass

    untyped(Sky).provides = provided

    def begin() -> None:
        made(Sky).initialise([group_of(made(Bird))], {}, 7)

    if "wheels" in provided:
        begin()
    else:
        with pytest.raises(WorldError, match="the model needs a world with wheels"):
            begin()
