"""The racecar: on its wheels in the world `pybullet`, and as the bicycle that it is elsewhere."""

import gc

import numpy as np
import pytest

from symaware_cli.core import AgentGroup, Entity, WorldError
from symaware_cli.environments.kinematic import KinematicEnvironment
from symaware_cli.environments.planar import PymunkEnvironment
from symaware_cli.environments.spatial import PyBulletEnvironment
from symaware_cli.models.racecar import TRACK, WHEELBASE, Racecar, hinge_angles


def made(kind, **parameters):
    return kind(kind.Parameters(**parameters))


def road(states, model=None, kind=PyBulletEnvironment, **parameters):
    model = model or Racecar()
    group = AgentGroup("car", [f"car.{row}" for row in range(len(states))], model, Entity(), states)
    environment = made(kind, **{"time_step": 0.02, "substeps": 5, **parameters})
    environment.initialise([group], {}, 1)
    return environment, group


def driven(environment, group, control_input, time):
    group.control_input = np.broadcast_to(np.array(control_input, float), (len(group), 2))
    for _ in range(round(time / 0.02)):
        environment.step()
    return environment.state(group)


@pytest.mark.parametrize("state", [[1.0, 2.0, 0.5, 0.0, 0.0], [-3.0, 0.0, -2.5, 1.5, 0.3], [0.0, 0.0, 7.0, 0.0, -0.2]])
def test_it_starts_exactly_where_the_file_says(state):
    environment, group = road([state])
    with environment:
        assert environment.state(group)[0] == pytest.approx(state, abs=1e-9)
        assert environment.contacts() == []  # that it stands on the road is no news


def test_it_stays_where_it_stands():
    environment, group = road([[1.0, 2.0, 0.5, 0.0, 0.0]])
    with environment:
        state = driven(environment, group, [0.0, 0.0], 2.0)
        assert state[0] == pytest.approx([1.0, 2.0, 0.5, 0.0, 0.0], abs=0.002)


def test_it_reaches_its_speed_and_stops():
    environment, group = road([[0.0] * 5])
    with environment:
        state = driven(environment, group, [1.5, 0.0], 2.0)
        assert state[0, 3] == pytest.approx(1.5, rel=0.03)
        assert abs(state[0, 1]) < 0.05
        assert environment.snapshot().velocities[0] == pytest.approx([1.5, 0.0], abs=0.05)
        assert driven(environment, group, [0.0, 0.0], 2.0)[0, 3] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("angle", [0.2, -0.4])
def test_at_low_speed_it_goes_round_as_a_bicycle(angle):
    environment, group = road([[0.0] * 5])
    with environment:
        before = driven(environment, group, [0.5, angle], 2.0)[0]
        after = driven(environment, group, [0.5, angle], 2.0)[0]
    assert after[4] == pytest.approx(angle, abs=0.01)
    turned = (after[2] - before[2]) / 2.0
    assert turned == pytest.approx(before[3] * np.tan(angle) / WHEELBASE, rel=0.05)


def test_the_inner_wheel_steers_more():
    left, right = hinge_angles(0.3)
    radius = WHEELBASE / np.tan(0.3)
    assert np.tan(left) == pytest.approx(WHEELBASE / (radius - TRACK / 2))
    assert np.tan(right) == pytest.approx(WHEELBASE / (radius + TRACK / 2))
    assert hinge_angles(-0.3) == pytest.approx([-right, -left])


def test_on_ice_it_slides_straight_on():
    def turned(friction):
        environment, group = road([[0.0, 0.0, 0.0, 3.0, 0.0]], ground={"friction": friction})
        with environment:
            return driven(environment, group, [3.0, 0.4], 1.0)[0, 2]

    assert turned(0.05) < 0.3 * turned(1.0)


def test_elsewhere_it_is_a_bicycle_that_lags_behind():
    environment, group = road([[0.0] * 5], kind=KinematicEnvironment, substeps=1)
    state = driven(environment, group, [1.0, 0.3], 0.2)
    assert state[0, 3] == pytest.approx(1.0 - np.exp(-1.0), rel=1e-5)
    assert state[0, 4] == pytest.approx(0.3 * (1.0 - np.exp(-4.0)), rel=1e-3)
    before = driven(environment, group, [1.0, 0.3], 2.0)[0]
    after = driven(environment, group, [1.0, 0.3], 1.0)[0]
    assert after[2] - before[2] == pytest.approx(np.tan(0.3) / WHEELBASE, rel=1e-3)


def test_it_runs_into_what_stands_in_its_way_and_there_is_a_contact():
    environment, group = road([[0.0] * 5, [1.5, 0.0, 0.0, 0.0, 0.0]])
    with environment:
        group.control_input = [[2.0, 0.0], [0.0, 0.0]]
        contacts = []
        for _ in range(100):
            environment.step()
            contacts += environment.contacts()
    hit = next(each for each in contacts if each.begins)
    assert (hit.first, hit.second) == ("car.0", "car.1")


def test_a_plane_has_no_wheels():
    with pytest.raises(WorldError, match="`speed`, `steering_angle` too"):
        road([[0.0] * 5], kind=PymunkEnvironment)


def resident():
    with open("/proc/self/status", encoding="ascii") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024


def test_a_car_more_takes_less_than_five_megabytes():
    """The original framework took 52 MB a car."""
    first, _ = road([[0.0] * 5])
    gc.collect()
    before = resident()
    environment, _ = road([[2.0 * number, 0.0, 0.0, 0.0, 0.0] for number in range(10)])
    with first, environment:
        assert (resident() - before) / 10 < 5.0
