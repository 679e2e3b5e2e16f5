"""The quadrotor: its equations, and its flight in the world `pybullet`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import Team, made, present, simulate

from symaware_cli import Contact
from symaware_cli.core import AgentGroup, Entity, WorldError
from symaware_cli.engine.components.control.quadrotor_velocity import QuadrotorVelocity
from symaware_cli.engine.components.perception import SelfPerception
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.environments.process_noise import process_noise
from symaware_cli.engine.models.crazyflie import MASS, THRUST
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.log.reader import open_log
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

AWRY = [0.0, 0.0, 1.0, 0.1, -0.2, 0.5, 0.3, 0.2, 0.1, 0.5, -0.4, 0.3]


def resting(*positions: tuple[float, float, float]) -> list[list[float]]:
    return [[*position, *[0.0] * 9] for position in positions]


def flight(
    states: Sequence[list[float]],
    model: Quadrotor | None = None,
    kind: type[ColumnEnvironment] = PyBulletEnvironment,
    **parameters: Any,
) -> tuple[ColumnEnvironment, AgentGroup, Quadrotor]:
    model = model or Quadrotor()
    group = AgentGroup("drone", [f"drone.{row}" for row in range(len(states))], model, Entity(), states)
    environment = made(kind, **{"time_step": 0.025, "substeps": 6, **parameters})
    environment.initialise([group], {}, 1)
    return environment, group, model


def test_four_rotors_at_hover_speed_carry_the_weight() -> None:
    model = Quadrotor()
    assert 4 * THRUST * model.hover_speed**2 == pytest.approx(MASS * 9.81)
    # The Crazyflie's motors reach about 21,700 rpm at 2.25 times its weight.
    assert model.top_speed * 60 / (2 * np.pi) == pytest.approx(21_700, rel=0.01)
    rest = np.array(resting((1, 2, 3))).T
    rates = model.derivative(rest, np.full((4, 1), model.hover_speed), np)
    assert np.allclose(np.concatenate([np.atleast_1d(rate) for rate in rates]), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("faster", "rates"),
    [
        # Numbered clockwise from the front on the right, as seen from above; positive roll lifts the left side,
        # positive pitch lowers the nose, positive yaw turns to the left. The first and the third turn to the left.
        ((2, 3), (1, 0, 0)),
        ((0, 1), (-1, 0, 0)),
        ((1, 2), (0, 1, 0)),
        ((0, 3), (0, -1, 0)),
        ((1, 3), (0, 0, 1)),
        ((0, 2), (0, 0, -1)),
    ],
)
def test_rotors_that_turn_faster_turn_the_vehicle_as_on_the_real_one(
    faster: tuple[int, int], rates: tuple[int, int, int]
) -> None:
    speeds = np.full((4, 1), 1500.0)
    speeds[list(faster)] += 50.0
    derivative = Quadrotor().derivative(np.zeros((12, 1)), speeds, np)
    assert np.sign(np.round([float(np.squeeze(rate)) for rate in derivative[9:12]], 6)).tolist() == list(rates)


def test_casadi_and_numpy_compute_the_same() -> None:
    model = Quadrotor()
    state, speeds = casadi.SX.sym("x", 12), casadi.SX.sym("u", 4)
    rate = casadi.Function("f", [state, speeds], [casadi.vertcat(*model.derivative(state, speeds, casadi))])
    given = np.array([1600.0, 1500.0, 1400.0, 1550.0])
    theirs = np.array(rate(AWRY, given)).ravel()
    mine = model.derivative(np.array(AWRY)[:, None], given[:, None], np)
    assert np.allclose([float(np.squeeze(each)) for each in mine], theirs, rtol=1e-12)


def test_the_body_in_pybullet_flies_as_the_equations_say() -> None:
    errors = []
    for substeps in (6, 60):
        ends = []
        for kind in (PyBulletEnvironment, KinematicEnvironment):
            environment, group, model = flight([AWRY], kind=kind, substeps=substeps)
            with environment:
                assert environment.state(group) == pytest.approx(np.array([AWRY]), abs=1e-9)
                group.control_input = [model.hover_speed * np.array([1.02, 0.99, 1.01, 1.0])]
                for _ in range(16):
                    environment.step()
                ends.append(environment.state(group)[0])
        errors.append(np.abs(ends[0] - ends[1]).max())
    # Another integrator, of the first order: ten times the steps, a tenth of the error.
    assert errors[0] < 0.01
    assert errors[1] < 0.12 * errors[0]


def test_a_hover_hovers() -> None:
    environment, group, model = flight(resting((0, 0, 1)))
    with environment:
        group.control_input = [[model.hover_speed] * 4]
        for _ in range(400):
            environment.step()
        assert abs(environment.state(group)[0, 2] - 1.0) < 1e-6  # after 10 s, and nobody steers
        for _ in range(400):
            group.control_input = model.follow_velocity(environment.state(group), np.zeros((1, 3)))
            environment.step()
        assert np.abs(environment.state(group)[0, :3] - [0, 0, 1]).max() < 1e-6


@pytest.mark.parametrize(("time_step", "substeps"), [(1 / 240, 1), (0.025, 6), (0.02, 5)])
@pytest.mark.parametrize("velocity", [(1.0, 0.0, 0.0), (0.0, -2.0, 0.5), (0.0, 0.0, 1.0)])
def test_a_step_of_the_velocity_settles_within_a_second_and_a_half(
    time_step: float, substeps: int, velocity: tuple[float, float, float], tmp_path: Path
) -> None:
    team = Team(state=resting((0, 0, 2)), model=Quadrotor(), knowledge=[{"velocity": list(velocity)}])
    team.components = {"sense": SelfPerception, "fly": lambda: made(QuadrotorVelocity, yaw=0.5)}
    environment = made(PyBulletEnvironment, time_step=time_step, substeps=substeps)
    with environment:
        simulate({"drone": team}, round(3.0 / time_step), tmp_path / "log.mcap", environment=environment)
    values = open_log(tmp_path / "log.mcap").series("drone", "world").values.reshape(-1, 12)
    settled = values[np.linspace(0, 3, len(values)) > 1.5]
    size = np.linalg.norm(velocity)
    assert np.abs(settled[:, 6:9] - velocity).max() < 0.05 * size
    assert np.abs(values[:, 6:9] @ velocity / size).max() < 1.1 * size  # hardly overshoots
    assert settled[:, 5] == pytest.approx(0.5, abs=0.02)


def test_it_turns_its_nose_where_it_is_told_and_flies_sideways() -> None:
    environment, group, model = flight(resting((0, 0, 1)))
    with environment:
        for _ in range(160):
            state = environment.state(group)
            wanted = 4.0 * (np.array([[0.5, 0.5, 0.0]]) - state[:, 6:9])
            group.control_input = model.accelerate(state, wanted, np.array([2.0]))
            environment.step()
        assert environment.state(group)[0, 5] == pytest.approx(2.0, abs=0.01)
        assert environment.state(group)[0, 6:9] == pytest.approx([0.5, 0.5, 0.0], abs=0.01)


def test_in_a_fall_drag_and_weight_balance() -> None:
    lift = 4 * THRUST * 1000.0**2
    terminal = (MASS * 9.81 - lift) / (10.311e-7 * 4000.0)
    falling = [[0.0, 0.0, 100.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.9 * terminal, 0.0, 0.0, 0.0]]
    environment, group, _ = flight(falling, ground=None)
    time_constant = MASS / (10.311e-7 * 4000.0)
    with environment:
        group.control_input = [[1000.0] * 4]
        for _ in range(400):
            environment.step()
        speed = -environment.state(group)[0, 8]
    assert speed == pytest.approx(terminal * (1.0 - 0.1 * np.exp(-10.0 / time_constant)), rel=1e-3)


def test_the_ground_pushes_back() -> None:
    def climbed(level: float = 0.0, ground: bool = True, **parameters: bool) -> float:
        quadrotor = Quadrotor(Quadrotor.Parameters(**parameters))
        below = {"height": level} if ground else None
        environment, group, model = flight(resting((0, 0, level + 0.03)), quadrotor, ground=below)
        with environment:
            group.control_input = [[model.hover_speed] * 4]
            for _ in range(8):
                environment.step()
            return float(environment.state(group)[0, 2] - level)

    assert climbed() == pytest.approx(0.03, abs=1e-6)
    assert climbed(ground=False, ground_effect=True) == pytest.approx(0.03, abs=1e-6)
    assert climbed(5.0, ground_effect=True) == pytest.approx(climbed(ground_effect=True), abs=1e-9)
    # At a height of 3 cm the thrust grows by 1 / (1 - (2.3 / 12)^2), 3.9 %: 0.38 m/s^2 for 0.2 s.
    assert climbed(ground_effect=True) == pytest.approx(0.03 + 0.5 * 0.38 * 0.04, rel=0.05)


def test_the_downwash_of_a_quadrotor_pushes_only_the_one_below() -> None:
    parameters = Quadrotor.Parameters(downwash=True)
    environment, group, model = flight(resting((0, 0, 1.0), (0, 0, 1.5), (3, 0, 1.0)), Quadrotor(parameters))
    with environment:
        group.control_input = [[model.hover_speed] * 4] * 3
        for _ in range(4):
            environment.step()
        below, above, beside = environment.state(group)[:, 2] - [1.0, 1.5, 1.0]
    # 2267.18 (R / 4 z)^2 = 0.303 N on 27 g for 0.1 s.
    assert below == pytest.approx(-0.5 * 0.3034 / MASS * 0.01, rel=0.06)
    assert above == pytest.approx(0.0, abs=1e-6)
    assert beside == pytest.approx(0.0, abs=1e-6)


def test_a_crash_into_the_ground_is_a_contact() -> None:
    environment, group, _ = flight(resting((0, 0, 0.5)))
    with environment:
        contacts: list[Contact] = []
        for _ in range(40):
            environment.step()
            contacts += environment.contacts()
        assert ("drone.0", "ground", True) in [(each.first, each.second, each.begins) for each in contacts]
        assert contacts[0].impulse > 0.0
        assert 0.0 < environment.state(group)[0, 2] < 0.08


def test_another_gravity_than_that_of_the_world_is_refused() -> None:
    with pytest.raises(WorldError, match=r"set `gravity` to 9\.81, too"):
        flight(resting((0, 0, 1)), Quadrotor(Quadrotor.Parameters(gravity=1.62)))
    environment, group, model = flight(
        resting((0, 0, 1)), Quadrotor(Quadrotor.Parameters(gravity=1.62)), gravity=(0, 0, -1.62)
    )
    with environment:
        group.control_input = [[model.hover_speed] * 4]
        for _ in range(100):
            environment.step()
        assert environment.state(group)[0, 2] == pytest.approx(1.0, abs=1e-6)


def test_a_plane_is_no_place_to_fly() -> None:
    with pytest.raises(WorldError, match="cannot move in a plane"):
        flight(resting((0, 0, 1)), kind=PymunkEnvironment)


def test_a_quadrotor_flies_alike_alone_and_among_others() -> None:
    states = resting(*((2.0 * number, 0.0, 1.0) for number in range(5)))
    wanted = np.array([[0.3 * number, 0.1, 0.2] for number in range(5)])

    def flown(chosen: Sequence[int]) -> NDArray[np.float64]:
        environment, group, model = flight([states[number] for number in chosen])
        with environment:
            for _ in range(40):
                group.control_input = model.follow_velocity(environment.state(group), wanted[chosen])
                environment.step()
            return environment.state(group)

    together = flown([0, 1, 2, 3, 4])
    for number in range(5):
        assert flown([number])[0].tobytes() == together[number].tobytes()


def test_process_noise_moves_the_body_after_each_step() -> None:
    model = made(Quadrotor, process_noise=[0.1, 0.2, 0.05, *[0.1] * 3, *[0.3] * 3, *[0.5] * 3])
    quiet, group, _ = flight([AWRY, AWRY])
    shaken, restless, _ = flight([AWRY, AWRY], model=model)
    with quiet, shaken:
        for each in (group, restless):
            each.control_input = [[model.hover_speed] * 4] * 2
        for environment in (quiet, shaken):
            environment.step()
        drawn = present(process_noise(restless, 0.025, 1)).draw(0)
        assert shaken.state(restless) - quiet.state(group) == pytest.approx(drawn, abs=1e-9)
        assert shaken.snapshot().velocities == pytest.approx(shaken.state(restless)[:, 6:9])


def test_it_wanders_in_every_world_alike() -> None:
    spreads = []
    for kind in (PyBulletEnvironment, KinematicEnvironment):
        model = made(Quadrotor, process_noise=[0.2, 0.2, 0.2, *[0.0] * 9])
        places = resting(*((4.0 * row, 0, 100) for row in range(50)))
        environment, group, _ = flight(places, model=model, kind=kind)
        with environment:
            group.control_input = [[model.hover_speed] * 4] * 50
            for _ in range(40):
                environment.step()
            spreads.append((environment.state(group) - np.array(places))[:, :3].std())
    assert spreads == pytest.approx([0.2, 0.2], rel=0.15)  # after one second
    assert spreads[0] == pytest.approx(spreads[1], rel=0.01)  # they draw the same numbers


@pytest.mark.parametrize("kind", [PyBulletEnvironment, KinematicEnvironment])
def test_it_accepts_shares_of_the_greatest_speed_instead(kind: type[ColumnEnvironment]) -> None:
    ends = []
    for unit in ("speed", "normalised"):
        model = made(Quadrotor, input=unit)
        environment, group, _ = flight([AWRY], model=model, kind=kind)
        with environment:
            for _ in range(40):
                group.control_input = model.follow_velocity(environment.state(group), np.array([[1.0, 0.0, 0.5]]))
                environment.step()
            ends.append(environment.state(group))
        top = model.input_bounds()[1][0]
        assert environment.applied_input(group).max() <= top
        assert top == (1.0 if unit == "normalised" else pytest.approx(2274.5, abs=0.1))
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert [quantity.unit for quantity in model.control_input] == ["1"] * 4


def test_it_brings_a_body_and_others_keep_clear_of_the_shape_in_the_scenario() -> None:
    _, group, _ = flight([AWRY], kind=KinematicEnvironment)
    assert (group.entity.radius, group.entity.mass) == (0.07, MASS)
    guarded = AgentGroup("drone", ["drone"], Quadrotor(), Entity(shape={"circle": {"radius": 0.3}}), [AWRY])
    assert (guarded.entity.radius, guarded.entity.mass) == (0.3, MASS)


@pytest.mark.parametrize(("time_step", "warnings"), [(0.025, 0), (0.05, 1)])
def test_its_controller_warns_once_of_turns_that_are_too_rare(time_step: float, warnings: int, tmp_path: Path) -> None:
    team = Team(state=resting((0, 0, 2)), model=Quadrotor(), knowledge=[{"velocity": [0, 0, 0]}])
    team.components = {"sense": SelfPerception, "fly": lambda: made(QuadrotorVelocity)}
    with made(PyBulletEnvironment, time_step=time_step) as environment:
        simulate({"drone": team}, 4, tmp_path / "log.mcap", environment=environment)
    events = [event for event in open_log(tmp_path / "log.mcap").events() if event.name == "turns-too-rare"]
    assert [(event.level, event.data["period"]) for event in events] == [("WARNING", 0.05)] * warnings
