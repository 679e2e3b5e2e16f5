"""What an inertial unit feels, against motions whose accelerations and rates are known."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import STEP, Team, simulation

from symaware_cli.engine.components.perception_imu import InertialUnit, rotation_vectors, rotations
from symaware_cli.engine.models.integrator import DoubleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.worlds.physics import PhysicsEnvironment
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment


def felt(
    model: NoisyModel,
    state: Sequence[float],
    control_input: Sequence[float],
    turns: int = 3,
    count: int = 1,
    seed: int = 7,
    environment: PhysicsEnvironment | None = None,
    **parameters: float,
) -> NDArray[np.float64]:
    """What is felt at each turn; shape (turns, n, 6)."""
    team = Team(
        {"feel": lambda: InertialUnit(InertialUnit.Parameters(**parameters))}, count, [state] * count, model=model
    )
    ready = simulation({"robot": team}, seed=seed, environment=environment)
    ready.initialise()
    (group,) = ready.groups
    group.control_input = [control_input] * count
    found = []
    for _ in range(turns):
        ready.entries[0].components[0].compute_and_update()
        found.append(group.awareness["feel"])
        ready.environment.step()
        ready.clock.now += STEP
    return np.array(found)


def test_a_resting_body_measures_the_force_of_the_ground() -> None:
    np.testing.assert_allclose(felt(Unicycle(), [0, 0, 1.0], [0, 0])[:, 0], [[0, 0, 9.81, 0, 0, 0]] * 3, atol=1e-12)


def test_an_accelerating_body_measures_its_acceleration() -> None:
    found = felt(DoubleIntegrator(), [0, 0, 1, 0], [0.5, -0.25])
    np.testing.assert_allclose(found[1:, 0], [[0.5, -0.25, 9.81, 0, 0, 0]] * 2, atol=1e-9)


def test_a_body_on_a_circle_measures_the_centripetal_acceleration() -> None:
    """The centripetal acceleration is speed times turn rate; means over a step differ from it by its square."""
    found = felt(Unicycle(), [0, 0, 0.3], [1.0, 0.5], turns=5)[2:, 0]
    np.testing.assert_allclose(found[:, 1], 0.5, rtol=1e-3)
    np.testing.assert_allclose(found[:, 0], 0.0, atol=0.03)
    np.testing.assert_allclose(found[:, 5], 0.5, rtol=1e-9)


def test_a_quadrotor_feels_its_thrust_along_its_own_axis() -> None:
    """Without drag nothing but the rotors pushes it, whichever way it tilts; gravity is not felt."""
    model = Quadrotor(Quadrotor.Parameters(drag=False))
    state = [0, 0, 1, 0.3, -0.2, 0.7, *[0] * 6]
    found = felt(model, state, [1.1 * model.hover_speed] * 4)[1:, 0]
    np.testing.assert_allclose(found[:, :3], [[0, 0, 1.21 * 9.81]] * 2, atol=1e-6)
    np.testing.assert_allclose(found[:, 3:], 0.0, atol=1e-6)


@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_rotations_turn_and_do_not_stretch(roll: float, pitch: float, yaw: float) -> None:
    (turned,) = rotations(*(np.array([angle]) for angle in (roll, pitch, yaw)))
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turned) == pytest.approx(1.0)
    np.testing.assert_allclose(
        turned[:, 0], [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)], atol=1e-12
    )


@given(st.floats(-3, 3), st.sampled_from([0, 1, 2]))
def test_the_vector_of_a_rotation_is_its_axis_as_long_as_its_angle(angle: float, axis: int) -> None:
    angles = np.zeros((3, 1))
    angles[axis] = angle
    expected = np.zeros(3)
    expected[axis] = angle
    np.testing.assert_allclose(rotation_vectors(rotations(*angles))[0], expected, atol=1e-9)


def test_errors_have_their_deviations_and_each_unit_its_bias() -> None:
    exact = felt(Unicycle(), [0, 0, 0], [0, 0], turns=100, count=40)
    noisy = felt(
        Unicycle(),
        [0, 0, 0],
        [0, 0],
        turns=100,
        count=40,
        acceleration_noise=0.2,
        rate_noise=0.02,
        acceleration_bias=0.5,
        rate_bias=0.05,
    )
    errors = noisy - exact
    spread, bias = errors.std(axis=0).mean(axis=0), errors.mean(axis=0).std(axis=0)
    np.testing.assert_allclose(spread, [0.2] * 3 + [0.02] * 3, rtol=0.1)
    np.testing.assert_allclose(bias, [0.5] * 3 + [0.05] * 3, rtol=0.35)


def test_other_agents_change_nothing_for_an_agent() -> None:
    one, two = (
        felt(Unicycle(), [0, 0, 0], [1, 0], count=count, acceleration_noise=0.2, dropout=0.3) for count in (1, 2)
    )
    np.testing.assert_array_equal(one[:, 0], two[:, 0])


def test_a_missed_turn_is_not_a_number() -> None:
    found = felt(Unicycle(), [0, 0, 0], [0, 0], turns=200, dropout=0.25)
    assert np.isnan(found[:, 0, 0]).mean() == pytest.approx(0.25, abs=0.1)


def test_gravity_is_that_of_the_world_else_that_of_the_model() -> None:
    lunar = Quadrotor(Quadrotor.Parameters(gravity=1.62, drag=False))
    hovering = [lunar.hover_speed] * 4, [0, 0, 5, *[0] * 9]
    np.testing.assert_allclose(felt(lunar, hovering[1], hovering[0])[1:, 0, :3], [[0, 0, 1.62]] * 2, atol=1e-9)
    moon = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=STEP / 1e9, gravity=(0.0, 0.0, -1.62)))
    with moon:
        for model, state, still in ((lunar, hovering[1], hovering[0]), (Unicycle(), [0, 0, 0], [0, 0])):
            found = felt(model, state, still, environment=moon)[1:, 0, :3]
            np.testing.assert_allclose(found, [[0, 0, 1.62]] * 2, atol=1e-6)
    assert felt(Unicycle(), [0, 0, 0], [0, 0], gravity=3.7)[0, 0, 2] == 3.7


def test_in_a_plane_seen_from_the_side_down_is_where_things_fall() -> None:
    side = PymunkEnvironment(PymunkEnvironment.Parameters(time_step=STEP / 1e9, gravity=(0.0, -9.81)))
    found = felt(Unicycle(), [0, 0, np.pi / 2], [0, 0], environment=side)[1:, 0, :3]
    np.testing.assert_allclose(found, [[9.81, 0, 0]] * 2, atol=1e-9)
    above = PymunkEnvironment(PymunkEnvironment.Parameters(time_step=STEP / 1e9))
    np.testing.assert_allclose(felt(Unicycle(), [0, 0, 0], [0, 0], environment=above)[1, 0, :3], [0, 0, 9.81])
