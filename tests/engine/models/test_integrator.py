"""The integrators against their closed forms, worked out by hand."""

import numpy as np
import pytest
from simulating import made, present

from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.world.integration import euler, rk4


def test_a_point_goes_where_its_velocity_takes_it() -> None:
    model = made(SingleIntegrator)
    assert model.exact_step(np.array([[1.0, 2.0]]), np.array([[0.5, -2.0]]), 4.0).tolist() == [[3.0, -6.0]]
    space = made(SingleIntegrator, dimensions=3)
    assert space.exact_step(np.zeros((1, 3)), np.array([[1.0, 2.0, 3.0]]), 2.0).tolist() == [[2.0, 4.0, 6.0]]


def test_a_pushed_point_falls_along_a_parabola() -> None:
    # p = p0 + v0 t + a t^2 / 2, v = v0 + a t with p0 = 0, v0 = (1, 2), a = (2, -1), t = 3.
    after = made(DoubleIntegrator).exact_step(np.array([[0.0, 0.0, 1.0, 2.0]]), np.array([[2.0, -1.0]]), 3.0)
    assert after is not None
    assert after.tolist() == [[12.0, 1.5, 7.0, -1.0]]
    # Free fall from 5 m for 1 s: down by g / 2.
    state = np.array([[0.0, 0.0, 5.0, 3.0, 0.0, 0.0]])
    after = made(DoubleIntegrator, dimensions=3).exact_step(state, np.array([[0.0, 0.0, -9.81]]), 1.0)
    assert np.allclose(present(after), [[3.0, 0.0, 5.0 - 9.81 / 2, 3.0, 0.0, -9.81]], rtol=1e-15)


def test_runge_kutta_is_exact_for_the_integrators_and_euler_errs_in_proportion_to_the_step() -> None:
    model = made(DoubleIntegrator)
    start, push = np.array([[0.0, 0.0, 1.0, 2.0]]), np.array([[2.0, -1.0]])
    exact = model.exact_step(start, push, 1.0)
    assert exact is not None
    assert np.allclose(rk4(model, start, push, 1.0), exact, rtol=1e-15)

    def error(steps: int) -> float:
        state = start
        for _ in range(steps):
            state = euler(model, state, push, 1.0 / steps)
        return float(np.abs(state - exact).max())

    # By hand: it lacks a step^2 / 2 in each step, together a t step / 2 = 1 / steps.
    assert error(10) == pytest.approx(0.1)
    assert error(20) == pytest.approx(0.05)


@pytest.mark.parametrize(("kind", "limit"), [(SingleIntegrator, "max_speed"), (DoubleIntegrator, "max_acceleration")])
def test_an_input_beyond_the_limit_keeps_its_direction(kind: type[NoisyModel], limit: str) -> None:
    assert np.allclose(made(kind, **{limit: 1.0}).limit(np.array([[3.0, 4.0], [0.3, 0.4]])), [[0.6, 0.8], [0.3, 0.4]])
    space = made(kind, **{limit: 3.0}, dimensions=3)
    assert np.allclose(space.limit(np.array([[2.0, 4.0, 4.0], [1.0, 2.0, 2.0]])), [[1.0, 2.0, 2.0]] * 2)
    assert np.array_equal(made(kind).limit(np.array([[300.0, 400.0]])), [[300.0, 400.0]])


def test_the_speed_of_a_pushed_point_is_limited_only_where_it_follows_a_velocity() -> None:
    model = made(DoubleIntegrator, max_speed=1.0, velocity_gain=2.0)
    state = np.array([[0.0, 0.0, 0.0, 0.0]])
    # The wanted (3, 4) is shortened to (0.6, 0.8); the acceleration is the gain times what is missing to that.
    assert np.allclose(model.follow_velocity(state, np.array([[3.0, 4.0]])), [[1.2, 1.6]])
    fast = model.exact_step(state, model.limit(np.array([[5.0, 0.0]])), 1.0)
    assert fast is not None
    assert fast[0, 2] == 5.0


def test_a_pushed_point_nears_a_wanted_velocity_exponentially() -> None:
    # v' = gain (wanted - v) has the solution wanted (1 - exp(-gain t)); with inputs held for h, 1 - (1 - gain h)^k.
    model = made(DoubleIntegrator, velocity_gain=2.0)
    state = np.zeros((1, 4))
    for _ in range(1000):
        state = present(model.exact_step(state, model.follow_velocity(state, np.array([[1.0, -2.0]])), 0.001))
    assert np.allclose(state[0, 2:], np.array([1.0, -2.0]) * (1 - 0.998**1000), rtol=1e-12)
    assert np.allclose(state[0, 2:], np.array([1.0, -2.0]) * (1 - np.exp(-2.0)), rtol=1e-3)


def test_a_pushed_point_slowed_to_nothing_brakes_to_rest() -> None:
    model = made(DoubleIntegrator, velocity_gain=2.0)
    state = np.array([[0.0, 0.0, 3.0, -1.0]])
    for _ in range(400):
        state = present(model.exact_step(state, model.slowed(state, np.array([[9.0, 9.0]]), np.zeros(1)), 0.05))
    assert np.allclose(state[0, 2:], 0.0, atol=1e-12)


def test_names_follow_the_dimensions() -> None:
    assert [quantity.name for quantity in made(DoubleIntegrator, dimensions=3).state] == [
        *("x", "y", "z"),
        *("velocity_x", "velocity_y", "velocity_z"),
    ]
    assert made(SingleIntegrator, dimensions=3).position == (0, 1, 2)
    assert made(SingleIntegrator).position == (0, 1)
