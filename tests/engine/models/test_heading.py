"""Unicycle, bicycle and Dubins aircraft against circles and a tight solution of their equations."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from simulating import made, present

from symaware_cli.engine.models.aircraft import DubinsAircraft
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.heading import HeadingModel, sinc
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.world.integration import euler, rk4

AIRCRAFT = {"min_speed": 6.0, "max_speed": 9.0, "max_turn_rate": 0.1}
# The equations of motion, written here once more and for one vehicle.
EQUATIONS = {
    "unicycle": (
        made(Unicycle),
        lambda x, u: [u[0] * np.cos(x[2]), u[0] * np.sin(x[2]), u[1]],
        [[0.9, 1.7], [-0.3, -0.4], [1.0, 0.0], [0.0, 2.0], [0.7, 1e-7]],
    ),
    "bicycle": (
        made(Bicycle, wheelbase=2.6),
        lambda x, u: [u[0] * np.cos(x[2]), u[0] * np.sin(x[2]), u[0] / 2.6 * np.tan(u[1])],
        [[0.9, 0.5], [-0.3, -0.4], [1.0, 0.0], [0.0, 0.3], [20.0, 1e-7]],
    ),
    "dubins-aircraft": (
        made(DubinsAircraft, **AIRCRAFT),
        lambda x, u: [u[0] * np.cos(x[2]), u[0] * np.sin(x[2]), u[1]],
        [[9.0, 0.1], [6.0, -0.07], [7.5, 0.0], [8.0, 1e-9]],
    ),
    "dubins-aircraft 3": (
        made(DubinsAircraft, **AIRCRAFT, dimensions=3),
        lambda x, u: [u[0] * np.cos(x[3]), u[0] * np.sin(x[3]), u[2], u[1]],
        [[9.0, 0.1, 2.0], [6.0, -0.07, -1.0], [7.5, 0.0, 0.0]],
    ),
}
every_vehicle = pytest.mark.parametrize(("model", "equation", "inputs"), EQUATIONS.values(), ids=EQUATIONS)


@every_vehicle
@pytest.mark.parametrize("step", [0.05, 1.0, 10.0])
def test_the_closed_form_is_the_solution_of_the_equations(
    model: HeadingModel, equation: Callable[..., Any], inputs: list[list[float]], step: float
) -> None:
    start = np.linspace(0.5, 2.0, len(model.state))

    def moving(u: list[float], _: float, x: NDArray[np.float64]) -> Any:
        return equation(x, u)

    for control_input in inputs:
        # DOP853 at rtol 1e-12 is good for about 1e-11 over the path lengths here, up to 200 m.
        solved = solve_ivp(partial(moving, control_input), (0.0, step), start, "DOP853", rtol=1e-12, atol=1e-12)
        after = present(model.exact_step(start[None], np.array([control_input]), step))[0]
        assert np.allclose(after, solved.y[:, -1], rtol=1e-10, atol=1e-10)


@every_vehicle
def test_euler_errs_in_proportion_to_the_step_and_runge_kutta_to_its_fourth_power(
    model: HeadingModel, equation: Callable[..., Any], inputs: list[list[float]]
) -> None:
    start, control_input = np.linspace(0.5, 2.0, len(model.state))[None], np.array(inputs[:1])
    # Half a turn, whatever the vehicle.
    duration = 3.0 / model.motion(control_input[0], np)[1]
    exact = present(model.exact_step(start, control_input, duration))

    def error(integrate: Callable[..., Any], steps: int) -> float:
        state = start
        for _ in range(steps):
            state = integrate(model, state, control_input, duration / steps)
        return float(np.abs(state - exact).max())

    assert error(euler, 200) / error(euler, 400) == pytest.approx(2.0, rel=0.05)
    assert error(rk4, 20) / error(rk4, 40) == pytest.approx(16.0, rel=0.05)
    assert error(rk4, 400) < 1e-9 * 100.0


@pytest.mark.parametrize("turn_rate", [0.0, 1e-300, 1e-200, 1e-16, 1e-12, 1e-9, 1e-8, 1e-7, 1e-5, 1e-3, -1e-6])
def test_the_arc_loses_no_digits_for_small_turn_rates(turn_rate: float) -> None:
    # x = sin(w h) / w and y = (1 - cos(w h)) / w for v = 1 from the origin, by their power series, at h = 1:
    # x = 1 - w^2/6 + w^4/120, y = w/2 - w^3/24 + w^5/720. The quotients themselves would be wrong by 1e-16 / w.
    after = present(made(Unicycle).exact_step(np.zeros((1, 3)), np.array([[1.0, turn_rate]]), 1.0))[0]
    w = turn_rate
    assert after[0] == pytest.approx(1 - w**2 / 6 + w**4 / 120, rel=4e-16)
    assert after[1] == pytest.approx(w / 2 - w**3 / 24 + w**5 / 720, rel=4e-16)


def test_sinc_is_that_of_numpy() -> None:
    angles = np.concatenate([np.linspace(-20, 20, 4001), [0.0, -0.0, 1e-320, 1e-200, -1e-9]])
    assert np.allclose(sinc(angles, np), np.sinc(angles / np.pi), rtol=1e-13, atol=1e-15)


def test_a_unicycle_on_the_unit_circle_is_where_the_circle_is() -> None:
    # At speed 1 and turn rate 1 from (1, 0) looking along y: (cos t, sin t).
    state, control_input = np.array([[1.0, 0.0, np.pi / 2]]), np.array([[1.0, 1.0]])
    for k in range(1, 201):
        state = present(made(Unicycle).exact_step(state, control_input, 0.05))
        assert np.allclose(state[0], [np.cos(0.05 * k), np.sin(0.05 * k), np.pi / 2 + 0.05 * k], rtol=0.0, atol=1e-13)


def test_the_rear_axle_of_a_bicycle_rounds_a_circle_of_wheelbase_by_tangent() -> None:
    # With tan(steering) = L / R the rear axle stays at R from the centre, which lies R to the left.
    model, radius = made(Bicycle, wheelbase=2.6, max_speed=5.0), 10.0
    control_input = np.array([[5.0, np.arctan(2.6 / radius)]])
    state = np.array([[0.0, 0.0, 0.0]])
    for _ in range(300):
        state = present(model.exact_step(state, control_input, 0.05))
        assert np.hypot(state[0, 0], state[0, 1] - radius) == pytest.approx(radius, rel=1e-12)
    assert state[0, 2] == pytest.approx(5.0 * 15.0 / radius)


def test_the_bicycle_of_a_textbook_turns_by_a_known_angle() -> None:
    # LaValle, Planning Algorithms, (13.15): heading' = speed / wheelbase * tan(steering) = 2 / 0.5 * tan(pi / 4) = 4.
    rates = made(Bicycle, wheelbase=0.5).derivative(np.zeros((3, 1)), np.array([[2.0], [np.pi / 4]]), np)
    assert np.allclose(np.array(rates)[:, 0], [2.0, 0.0, 4.0])


def test_aircraft_flown_by_euler_at_one_second_are_those_of_the_recorded_intruder() -> None:
    # The intruder of the intent-aware avoidance case, at 10 m/s by Euler with 1 s: turn rates 0.07 for 7 s, 0.24 * 0.07
    # once, 0 until 74 s, -0.07 until 82 s.
    # The sampled path is recorded to end at (609.9, 449.9, -0.05).
    model = made(DubinsAircraft, min_speed=10.0, max_speed=10.0, max_turn_rate=0.07)
    turn_rates = [0.07] * 7 + [0.24 * 0.07] + [0.0] * 66 + [-0.07] * 8
    state = np.array([[-120.0, 90.0, 0.0]])
    for turn_rate in turn_rates:
        state = euler(model, state, model.limit(np.array([[10.0, turn_rate]])), 1.0)
    assert np.allclose(state[0], [609.9, 449.9, -0.05], atol=0.06)


def test_an_aircraft_does_not_stop() -> None:
    model = made(DubinsAircraft, **AIRCRAFT, dimensions=3, max_climb_rate=2.0)
    asked = np.array([[0.0, 0.0, 0.0], [-5.0, 9.0, -9.0], [99.0, -9.0, 9.0], [7.0, 0.05, 1.0]])
    assert model.limit(asked).tolist() == [[6.0, 0.0, 0.0], [6.0, 0.1, -2.0], [9.0, -0.1, 2.0], [7.0, 0.05, 1.0]]
    state = np.zeros((4, 4))
    braked = model.limit(model.slowed(state, model.limit(asked), np.zeros(4)))
    assert braked[:, 0].tolist() == [6.0] * 4
    assert braked[:, 1:].tolist() == model.limit(asked)[:, 1:].tolist()


def test_an_aircraft_in_space_follows_a_velocity_in_the_plane_and_a_climb_rate() -> None:
    model = made(DubinsAircraft, **AIRCRAFT, dimensions=3, steering_gain=0.5)
    state = np.array([[0.0, 0.0, 100.0, 0.3]])
    wanted = np.array([[7.0 * np.cos(0.5), 7.0 * np.sin(0.5), -1.5]])
    assert np.allclose(model.follow_velocity(state, wanted), [[7.0, 0.5 * 0.2, -1.5]])
    # Too slow and too fast for it; the turn stays.
    assert np.allclose(model.follow_velocity(state, 0.1 * wanted), [[6.0, 0.1, -0.15]])
    assert np.allclose(model.follow_velocity(state, 9.0 * wanted), [[9.0, 0.1, -13.5]])


@pytest.mark.parametrize("kind", [Unicycle, Bicycle])
def test_inputs_are_saturated_one_by_one(kind: type[HeadingModel]) -> None:
    turning = {"max_turn_rate": 0.5} if kind is Unicycle else {"max_steering_angle": 0.5}
    model = made(kind, min_speed=-0.5, max_speed=1.5, **turning)
    limited = model.limit(np.array([[9.0, -9.0], [-9.0, 9.0], [0.1, 0.2]]))
    assert limited.tolist() == [[1.5, -0.5], [-0.5, 0.5], [0.1, 0.2]]


@pytest.mark.parametrize("kind", [Unicycle, Bicycle, DubinsAircraft])
@pytest.mark.parametrize(
    ("heading", "direction", "error"),
    [(3.0, -3.0, 2 * np.pi - 6.0), (0.0, 1.0, 1.0), (7.0, 0.5, 0.5 - 7.0 + 2 * np.pi)],
)
def test_a_vehicle_turns_the_short_way(
    kind: type[HeadingModel], heading: float, direction: float, error: float
) -> None:
    model = made(kind, **AIRCRAFT, steering_gain=0.5) if kind is DubinsAircraft else made(kind, steering_gain=0.5)
    state, wanted = np.array([[0.0, 0.0, heading]]), 7.0 * np.array([[np.cos(direction), np.sin(direction)]])
    followed = model.follow_velocity(state, wanted)
    # Whatever steers it, the turn rate is gain times error where it drives at the wanted speed; a unicycle turns first.
    turn_rate = model.motion(followed[0], np)[1]
    assert turn_rate == pytest.approx(0.5 * error)


def test_a_bicycle_has_to_roll_to_turn_and_a_unicycle_does_not() -> None:
    state, wanted = np.array([[0.0, 0.0, 0.0]]), np.array([[-1.0, 0.0]])
    assert made(Unicycle).follow_velocity(state, wanted)[0, 0] == pytest.approx(0.0, abs=1e-15)
    assert made(Bicycle).follow_velocity(state, wanted)[0, 0] == 1.0


def test_a_bicycle_slowed_down_stays_on_its_way() -> None:
    model = made(Bicycle)
    state, control_input = np.array([[0.0, 0.0, 0.4]]), np.array([[1.0, 0.5]])
    slowed = model.slowed(state, control_input, np.array([0.25]))
    assert np.allclose(
        present(model.exact_step(state, control_input, 1.0)), present(model.exact_step(state, slowed, 4.0)), rtol=1e-14
    )
