"""The racecar: on its wheels in the world `pybullet`, and as the bicycle that it is elsewhere."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest
from leftovers import grows_forever, resident
from numpy.typing import NDArray
from simulating import made, present, untyped

from symaware_cli import Contact
from symaware_cli.core import AgentGroup, Entity, WorldError
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.environments.process_noise import process_noise
from symaware_cli.engine.models.racecar import TRACK, WHEELBASE, Racecar, hinge_angles
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment


def road(
    states: Sequence[list[float]],
    model: Racecar | None = None,
    kind: type[ColumnEnvironment] = PyBulletEnvironment,
    **parameters: Any,
) -> tuple[ColumnEnvironment, AgentGroup]:
    model = model or Racecar()
    group = AgentGroup("car", [f"car.{row}" for row in range(len(states))], model, Entity(), states)
    environment = made(kind, **{"time_step": 0.02, "substeps": 5, **parameters})
    environment.initialise([group], {}, 1)
    return environment, group


def driven(
    environment: ColumnEnvironment, group: AgentGroup, control_input: Sequence[float | list[float]], time: float
) -> NDArray[np.float64]:
    group.control_input = np.broadcast_to(np.array(control_input, float), (len(group), 2))
    for _ in range(round(time / 0.02)):
        environment.step()
    return environment.state(group)


@pytest.mark.parametrize("state", [[1.0, 2.0, 0.5, 0.0, 0.0], [-3.0, 0.0, -2.5, 1.5, 0.3], [0.0, 0.0, 7.0, 0.0, -0.2]])
def test_it_starts_exactly_where_the_file_says(state: list[float]) -> None:
    environment, group = road([state])
    with environment:
        assert environment.state(group)[0] == pytest.approx(state, abs=1e-9)
        assert environment.contacts() == []  # that it stands on the road is no news


def test_it_drives_on_the_ground_however_high_that_is() -> None:
    environment, group = road([[0.0] * 5], ground={"height": 2.0})
    with environment:
        assert environment.contacts() == []
        state = driven(environment, group, [1.5, 0.0], 2.0)
        assert environment.contacts() == []
        assert state[0, 3] == pytest.approx(1.5, rel=0.03)
        assert environment.body_positions(["car.0"])[0, 2] == pytest.approx(2.001, abs=2e-3)


def test_without_a_ground_it_cannot_drive() -> None:
    with pytest.raises(WorldError, match="the vehicles of `car` drive on the ground, and there is none") as caught:
        road([[0.0] * 5], ground=None)
    assert caught.value.path == ("environment", "with", "ground")


def test_it_stays_where_it_stands() -> None:
    environment, group = road([[1.0, 2.0, 0.5, 0.0, 0.0]])
    with environment:
        state = driven(environment, group, [0.0, 0.0], 2.0)
        assert state[0] == pytest.approx([1.0, 2.0, 0.5, 0.0, 0.0], abs=0.002)


def test_it_reaches_its_speed_and_stops() -> None:
    environment, group = road([[0.0] * 5])
    with environment:
        state = driven(environment, group, [1.5, 0.0], 2.0)
        assert state[0, 3] == pytest.approx(1.5, rel=0.03)
        assert abs(state[0, 1]) < 0.05
        assert environment.snapshot().velocities[0] == pytest.approx([1.5, 0.0], abs=0.05)
        assert driven(environment, group, [0.0, 0.0], 2.0)[0, 3] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("angle", [0.2, -0.4])
def test_at_low_speed_it_goes_round_as_a_bicycle(angle: float) -> None:
    environment, group = road([[0.0] * 5])
    with environment:
        before = driven(environment, group, [0.5, angle], 2.0)[0]
        after = driven(environment, group, [0.5, angle], 2.0)[0]
    assert after[4] == pytest.approx(angle, abs=0.01)
    turned = (after[2] - before[2]) / 2.0
    assert turned == pytest.approx(before[3] * np.tan(angle) / WHEELBASE, rel=0.05)


def test_the_inner_wheel_steers_more() -> None:
    left, right = hinge_angles(0.3)
    radius = WHEELBASE / np.tan(0.3)
    assert np.tan(left) == pytest.approx(WHEELBASE / (radius - TRACK / 2))
    assert np.tan(right) == pytest.approx(WHEELBASE / (radius + TRACK / 2))
    assert hinge_angles(-0.3) == pytest.approx([-right, -left])


def test_on_ice_it_slides_straight_on() -> None:
    def turned(friction: float) -> float:
        environment, group = road([[0.0, 0.0, 0.0, 3.0, 0.0]], ground={"friction": friction})
        with environment:
            return float(driven(environment, group, [3.0, 0.4], 1.0)[0, 2])

    assert turned(0.05) < 0.3 * turned(1.0)


def test_elsewhere_it_is_a_bicycle_that_lags_behind() -> None:
    environment, group = road([[0.0] * 5], kind=KinematicEnvironment, substeps=1)
    state = driven(environment, group, [1.0, 0.3], 0.2)
    assert state[0, 3] == pytest.approx(1.0 - np.exp(-1.0), rel=1e-5)
    assert state[0, 4] == pytest.approx(0.3 * (1.0 - np.exp(-4.0)), rel=1e-3)
    before = driven(environment, group, [1.0, 0.3], 2.0)[0]
    after = driven(environment, group, [1.0, 0.3], 1.0)[0]
    assert after[2] - before[2] == pytest.approx(np.tan(0.3) / WHEELBASE, rel=1e-3)


def test_it_runs_into_a_body_in_its_way_and_there_is_a_contact() -> None:
    environment, group = road([[0.0] * 5, [1.5, 0.0, 0.0, 0.0, 0.0]])
    with environment:
        group.control_input = [[2.0, 0.0], [0.0, 0.0]]
        contacts: list[Contact] = []
        for _ in range(100):
            environment.step()
            contacts += environment.contacts()
    hit = next(each for each in contacts if each.begins)
    assert (hit.first, hit.second) == ("car.0", "car.1")


def test_a_plane_has_no_wheels() -> None:
    with pytest.raises(WorldError, match="`speed`, `steering_angle` too"):
        road([[0.0] * 5], kind=PymunkEnvironment)


def test_cars_drive_the_same_to_the_last_bit_whoever_drove_before() -> None:
    def lap() -> bytes:
        environment, group = road([[0.0] * 5, [1.0, 0.1, 3.0, 0.0, 0.0]])
        with environment:
            return driven(environment, group, [[2.0, 0.3], [1.0, -0.2]], 1.0).tobytes()

    alone = lap()
    others = [road([[0.0] * 5], visuals=visuals) for visuals in (False, True)]
    for environment, group in others:
        driven(environment, group, [1.0, 0.0], 0.1)
    among = lap()
    for environment, _ in others:
        environment.close()
    assert alone == among == lap()


def growth(visuals: Any) -> Any:
    """MB for each car beyond the first; of two worlds that differ by ten cars."""
    held, worlds = [resident()], []
    for count in (1, 1, 11):
        worlds.append(road([[2.0 * number, 0.0, 0.0, 0.0, 0.0] for number in range(count)], visuals=visuals)[0])
        held.append(resident())
    _, one, eleven = np.diff(held)
    return (eleven - one) / 10e6


@pytest.mark.parametrize("visuals", [False, True])
def test_a_car_more_takes_less_than_five_megabytes(visuals: bool) -> None:
    """The original framework took 52 MB a car."""
    # In a process of its own, where no memory lies about that others have let go of.
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        assert process.submit(growth, visuals).result() < 5.0


def test_worlds_of_cars_that_were_seen_leave_nothing_behind() -> None:
    def one() -> None:
        environment, group = road([[0.0] * 5, [2.0, 0.0, 0.0, 0.0, 0.0]], visuals=True)
        with environment:
            driven(environment, group, [1.0, 0.1], 0.04)
            environment.camera_image([1, 1, 1], [0, 0, 0], (32, 24), 1.0)

    assert not grows_forever(one, repeats=5, each=200_000)


def test_process_noise_moves_the_car_after_each_step() -> None:
    states = [[1.0, 2.0, 0.5, 1.0, 0.2], [-3.0, 0.0, 4.0, 0.0, -0.1]]
    model = made(Racecar, process_noise=[0.2, 0.2, 0.5, 0.3, 0.2])
    quiet, group = road(states)
    shaken, restless = road(states, model=model)
    with quiet, shaken:
        for environment in (quiet, shaken):
            environment.step()
        drawn = present(process_noise(restless, 0.02, 1)).draw(0)
        assert shaken.state(restless) - quiet.state(group) == pytest.approx(drawn, abs=1e-6)


def test_the_body_that_comes_with_the_model_collides() -> None:
    engine = pytest.importorskip("pybullet")
    environment, group = road([[0.0] * 5])
    with environment:
        world = untyped(environment)
        body, client = world._bodies_of("car")[0], world._id
        links = [
            link
            for link in range(engine.getNumJoints(body, client))
            if engine.getCollisionShapeData(body, link, client)
        ]
        boxes = np.array([engine.getAABB(body, link, client) for link in links])
        mass = sum(
            engine.getDynamicsInfo(body, link, client)[0] for link in range(-1, engine.getNumJoints(body, client))
        )
    assert group.entity.shape is not None
    assert group.entity.shape.polygon is not None
    corners = np.array(group.entity.shape.polygon.vertices)
    assert corners.min(axis=0) == pytest.approx(boxes[:, 0, :2].min(axis=0), abs=0.01)
    assert corners.max(axis=0) == pytest.approx(boxes[:, 1, :2].max(axis=0), abs=0.01)
    assert group.entity.mass == pytest.approx(mass, rel=0.001)


def test_cars_that_meet_head_on_are_at_risk_though_nobody_said_how_large_they_are() -> None:
    states = [[0.0, 0.0, 0.0, 1.0, 0.0], [2.0, 0.05, np.pi, 1.0, 0.0]]
    environment, group = road(states, kind=KinematicEnvironment, substeps=1)
    group.control_input = [[1.0, 0.0]] * 2
    touched: list[Contact] = []
    for _ in range(50):
        environment.step()
        touched += environment.contacts()
    assert touched
