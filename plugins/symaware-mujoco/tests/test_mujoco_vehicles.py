"""Vehicles in MuJoCo: closed forms of wheels and rotors, captured and restored states, and agents that enter."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from symaware_mujoco.world import MujocoEnvironment

import symaware_cli as sa
from symaware_cli.assets import asset
from symaware_cli.core import AgentGroup, Entity, Obstacle, WorldError
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.environments.process_noise import process_noise
from symaware_cli.engine.models.crazyflie import MASS, THRUST
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.racecar import WHEELBASE, Racecar
from symaware_cli.log.digest import digest

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

ROOT = Path(__file__).parents[3]
AWRY = [0.0, 0.0, 1.0, 0.1, -0.2, 0.5, 0.3, 0.2, 0.1, 0.5, -0.4, 0.3]


def world(model: Any, states: Any, kind: Any = MujocoEnvironment, **parameters: Any) -> tuple[Any, AgentGroup]:
    ids = [f"one.{row}" for row in range(len(states))]
    group = AgentGroup("one", ids, model, Entity(), np.array(states, float))
    environment = kind(kind.Parameters.model_validate({"time_step": 0.02, "substeps": 5, **parameters}))
    environment.initialise([group], {}, 1)
    return environment, group


def driven(environment: Any, group: AgentGroup, control_input: Any, time: float) -> NDArray[np.float64]:
    group.control_input = np.broadcast_to(np.array(control_input, float), (len(group), len(group.model.control_input)))
    for _ in range(round(time / 0.02)):
        environment.step()
    return np.array(environment.state(group))


def resting(*positions: tuple[float, float, float]) -> list[list[float]]:
    return [[*position, *[0.0] * 9] for position in positions]


# -- wheels


@pytest.mark.parametrize("state", [[1.0, 2.0, 0.5, 0.0, 0.0], [-3.0, 0.0, -2.5, 1.5, 0.3], [0.0, 0.0, 7.0, 0.0, -0.2]])
def test_a_car_starts_in_the_state_of_the_scenario(state: list[float]) -> None:
    environment, group = world(Racecar(), [state])
    assert environment.state(group)[0] == pytest.approx(state, abs=1e-9)
    assert environment.contacts() == []


def test_a_car_reaches_its_speed_on_ground_of_any_height_and_stops() -> None:
    environment, group = world(Racecar(), [[0.0] * 5], ground={"height": 2.0})
    state = driven(environment, group, [1.5, 0.0], 2.0)
    assert state[0, 3] == pytest.approx(1.5, rel=1e-3)
    assert abs(state[0, 1]) < 1e-3
    assert environment.body_positions(["one.0"])[0, 2] == pytest.approx(2.0, abs=1e-3)
    assert environment.snapshot().velocities[0] == pytest.approx([1.5, 0.0], abs=1e-3)
    assert environment.contacts() == []
    assert driven(environment, group, [0.0, 0.0], 2.0)[0, 3] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("angle", [0.2, -0.4])
def test_a_slow_car_turns_by_its_speed_times_the_tangent_over_the_wheelbase(angle: float) -> None:
    environment, group = world(Racecar(), [[0.0] * 5])
    before = driven(environment, group, [0.5, angle], 2.0)[0]
    after = driven(environment, group, [0.5, angle], 2.0)[0]
    assert after[3] == pytest.approx(0.5, rel=0.01)
    assert after[4] == pytest.approx(angle, abs=0.001)
    assert (after[2] - before[2]) / 2.0 == pytest.approx(before[3] * np.tan(angle) / WHEELBASE, rel=0.01)


def test_a_car_accelerates_by_the_torque_of_its_motors() -> None:
    environment, group = world(Racecar(Racecar.Parameters(motor_torque=0.1)), [[0.0] * 5])
    # Two motors of 0.1 N m on wheels of 0.05 m; four wheels turn with the car.
    inertia = 5.89202 + 4 * 0.00041226 / 0.05**2
    state = driven(environment, group, [3.0, 0.0], 1.0)
    assert state[0, 3] == pytest.approx(2 * 0.1 / 0.05 / inertia, rel=0.01)


def test_a_car_on_ice_slides_straight_on() -> None:
    def turned(friction: float) -> float:
        environment, group = world(Racecar(), [[0.0, 0.0, 0.0, 3.0, 0.0]], ground={"friction": friction})
        return float(driven(environment, group, [3.0, 0.4], 1.0)[0, 2])

    assert turned(0.05) < 0.3 * turned(1.0)


def test_cars_that_meet_have_a_contact() -> None:
    environment, group = world(Racecar(), [[0.0] * 5, [1.5, 0.0, 0.0, 0.0, 0.0]])
    group.control_input = np.array([[2.0, 0.0], [0.0, 0.0]])
    contacts: list[sa.Contact] = []
    for _ in range(100):
        environment.step()
        contacts += environment.contacts()
    hit = next(each for each in contacts if each.begins)
    assert (hit.first, hit.second) == ("one.0", "one.1")


def test_a_car_needs_ground() -> None:
    with pytest.raises(WorldError, match="drive on the ground, and there is none") as caught:
        world(Racecar(), [[0.0] * 5], ground=None)
    assert caught.value.path == ("environment", "with", "ground")


def test_rays_of_a_car_pass_through_its_own_parts() -> None:
    environment, _ = world(Racecar(), [[0.0] * 5, [2.0, 0.0, 0.0, 0.0, 0.0]])
    directions = np.array([[[1.0, 0.0], [0.0, 1.0]]])
    (found,) = environment.ray_cast(np.array([0]), np.zeros((1, 2)), directions, 10.0, 0.1)
    assert found[0] == pytest.approx(2.0 + 0.265 - 0.05, abs=1e-3)  # the scanner of the other
    assert np.isinf(found[1])


def test_visual_shapes_of_a_car_come_from_its_file() -> None:
    vehicle = Racecar().vehicle()
    robot = asset.installed(vehicle.portable_description())
    assert sum(len(link.visuals) for link in robot.description.articulation(robot.paths).links) == 8


# -- rotors


def test_a_quadrotor_hovers_where_thrust_and_weight_are_equal() -> None:
    model = Quadrotor()
    environment, group = world(model, resting((0, 0, 1)))
    state = driven(environment, group, [model.hover_speed] * 4, 10.0)
    assert np.abs(state[0] - resting((0, 0, 1))[0]).max() < 1e-6


def test_a_quadrotor_climbs_by_its_thrust() -> None:
    model = Quadrotor(Quadrotor.Parameters(drag=False))
    environment, group = world(model, resting((0, 0, 1)))
    speed = 1.1 * model.hover_speed
    state = driven(environment, group, [speed] * 4, 1.0)
    acceleration = 4 * THRUST * speed**2 / MASS - 9.81
    assert state[0, 8] == pytest.approx(acceleration, rel=1e-6)
    # The engine moves bodies by the velocity after each of the steps of 4 ms.
    assert state[0, 2] == pytest.approx(1.0 + 0.5 * acceleration * (1.0 + 0.004), rel=1e-6)


def test_a_quadrotor_flies_according_to_its_equations() -> None:
    errors = []
    for substeps in (6, 60):
        ends = []
        for kind in (MujocoEnvironment, KinematicEnvironment):
            model = Quadrotor()
            environment, group = world(model, [AWRY], kind, time_step=0.025, substeps=substeps)
            assert environment.state(group) == pytest.approx(np.array([AWRY]), abs=1e-9)
            group.control_input = np.array([model.hover_speed * np.array([1.02, 0.99, 1.01, 1.0])])
            for _ in range(16):
                environment.step()
            ends.append(environment.state(group)[0])
        errors.append(np.abs(ends[0] - ends[1]).max())
    assert errors[0] < 0.01
    assert errors[1] < 0.12 * errors[0]


def test_ground_and_air_push_as_in_the_formulas() -> None:
    model = Quadrotor(Quadrotor.Parameters(ground_effect=True))
    environment, group = world(model, resting((0, 0, 0.03)), time_step=0.025, substeps=6)
    group.control_input = np.array([[model.hover_speed] * 4])
    for _ in range(8):
        environment.step()
    # The thrust grows by 1 / (1 - (R / 4 z)^2), 3.9 %.
    assert environment.state(group)[0, 2] == pytest.approx(0.03 + 0.5 * 0.38 * 0.04, rel=0.05)
    model = Quadrotor(Quadrotor.Parameters(downwash=True))
    environment, group = world(model, resting((0, 0, 1.0), (0, 0, 1.5)), time_step=0.025, substeps=6)
    group.control_input = np.array([[model.hover_speed] * 4] * 2)
    for _ in range(4):
        environment.step()
    assert environment.state(group)[0, 2] - 1.0 == pytest.approx(-0.5 * 0.3034 / MASS * 0.01, rel=0.06)


def test_a_crash_into_the_ground_is_a_contact() -> None:
    environment, group = world(Quadrotor(), resting((0, 0, 0.5)))
    contacts: list[sa.Contact] = []
    for _ in range(60):
        environment.step()
        contacts += environment.contacts()
    assert ("ground", "one.0", True) in [(each.first, each.second, each.begins) for each in contacts]
    assert 0.0 < environment.state(group)[0, 2] < 0.08


def test_another_gravity_than_that_of_the_world_is_refused() -> None:
    with pytest.raises(WorldError, match=r"set `gravity` to 9\.81, too") as caught:
        world(Quadrotor(Quadrotor.Parameters(gravity=1.62)), resting((0, 0, 1)))
    assert caught.value.path == ("agents", "one", "model", "with", "gravity")


# -- noise, pushes, and agents that enter


@pytest.mark.parametrize("kind", [Racecar, Quadrotor])
def test_pushes_and_noise_change_the_state_by_the_given_amounts(kind: Any) -> None:
    model = kind()
    states = np.zeros((2, len(model.state)))
    states[:, 1] = [0.0, 5.0]
    states[:, 2] = 3.0 if kind is Quadrotor else 0.0
    environment, group = world(model, states)
    driven(environment, group, [0.0] * len(model.control_input), 0.02)
    before, change = environment.state(group), 0.2 + 0.01 * np.arange(len(model.state), dtype=float)
    environment.push(group, [1], change)
    assert environment.state(group) - before == pytest.approx(np.outer([0, 1], change), abs=1e-6)
    noisy = kind(kind.Parameters(process_noise=[0.1] * len(model.state)))
    quiet, still = world(model, states)
    shaken, restless = world(noisy, states)
    for each in (quiet, shaken):
        each.step()
    noise = process_noise(restless, 0.02, 1)
    assert noise is not None
    assert shaken.state(restless) - quiet.state(still) == pytest.approx(noise.draw(0), abs=1e-6)


def shipped(name: str, **changes: Any) -> Any:
    scenario = yaml.safe_load((ROOT / "scenarios" / f"{name}.yaml").read_text())
    scenario["environment"]["use"] = "mujoco"
    scenario["run"]["duration"] = 2.0
    if name == "drones":
        del scenario["agents"]["drone"]["components"]["look"]
        del scenario["environment"]["with"]["visuals"]
    return {**scenario, **changes}


@pytest.mark.parametrize("name", ["drones", "racecars"])
def test_vehicles_enter_and_leave(name: str) -> None:
    scenario = shipped(name)
    (group, *_) = scenario["agents"]
    agents = scenario["agents"][group]
    states, goals = agents["state"], agents["knowledge"]["waypoints"]

    def one(row: int, **more: Any) -> dict[str, Any]:
        points = goals["all"] if isinstance(goals, dict) else goals[row]
        return {**agents, **more, "count": 1, "state": states[row], "knowledge": {"waypoints": {"all": points}}}

    late, leaving = one(0, present={"from": 0.5}), one(1, present={"until": 0.5})
    scenario["agents"] = {"late": late, "leaving": leaving}
    with sa.scenario(scenario).start() as simulation:
        step = scenario["environment"]["with"]["time_step"]
        half = round(0.5 / step)
        start = simulation.state("late").copy()
        simulation.step(half - 1)
        assert simulation.state("late") == pytest.approx(start)
        simulation.step(3)
        gone = simulation.state("leaving").copy()
        simulation.step(half)
        assert np.abs(simulation.state("late") - start).max() > 0.05
        assert simulation.state("leaving") == pytest.approx(gone)


# -- repeats and states


@pytest.mark.parametrize("name", ["racecars", "drones"])
def test_a_run_with_vehicles_continues_from_its_state_to_the_same_bytes(name: str, tmp_path: Path) -> None:
    scenario = sa.scenario(shipped(name))
    with scenario.start(output=tmp_path / "whole.mcap") as simulation:
        simulation.step(50)
    with scenario.start(output=tmp_path / "again.mcap") as simulation:
        simulation.step(20)
        state = sa.SimulationState.from_bytes(simulation.capture().to_bytes())
        simulation.step(9)
        simulation.restore(state)
        simulation.step(30)
    one, two = (digest(sa.open_log(tmp_path / f"{each}.mcap")).channels for each in ("whole", "again"))
    assert one == two
    with scenario.start() as other:
        other.restore(state)
        other.step(30)
        ends = {agent: other.state(agent).tobytes() for agent in other.groups}
    with scenario.start() as simulation:
        simulation.step(50)
        assert {agent: simulation.state(agent).tobytes() for agent in simulation.groups} == ends


def test_the_motion_of_one_quadrotor_does_not_depend_on_others() -> None:
    states = resting(*((2.0 * number, 0.0, 1.0) for number in range(3)))

    def flown(chosen: Sequence[int]) -> NDArray[np.float64]:
        model = Quadrotor()
        environment, group = world(model, [states[number] for number in chosen])
        for _ in range(40):
            wanted = np.array([[0.3 * number, 0.1, 0.2] for number in chosen])
            group.control_input = model.follow_velocity(environment.state(group), wanted)
            environment.step()
        return np.array(environment.state(group))

    together = flown([0, 1, 2])
    for number in range(3):
        assert flown([number])[0] == pytest.approx(together[number], abs=1e-12)


def test_an_obstacle_stops_a_car() -> None:
    group = AgentGroup("one", ["one.0"], Racecar(), Entity(), np.zeros((1, 5)))
    environment = MujocoEnvironment(MujocoEnvironment.Parameters(time_step=0.02))
    environment.initialise([group], {"box": Obstacle(shape={"box": {"length": 1, "width": 1}}, position=[2, 0])}, 1)
    group.control_input = np.array([[1.5, 0.0]])
    for _ in range(150):
        environment.step()
    assert 1.0 < environment.state(group)[0, 0] < 1.2


def test_the_world_of_another_process_is_followed() -> None:
    states = [[0.0] * 5, [2.0, 1.0, 0.5, 0.0, 0.0]]
    host, group = world(Racecar(), states)
    copy, _ = world(Racecar(), states)
    driven(host, group, [1.0, 0.3], 0.2)
    copy.follow(200_000_000, host.share(), host.contacts())
    assert copy.state(group).tobytes() == host.state(group).tobytes()
    assert copy.body_positions(group.ids).tobytes() == host.body_positions(group.ids).tobytes()
    assert copy.body_poses("one").tobytes() == host.body_poses("one").tobytes()
    assert copy.joint_positions("one").tobytes() == host.joint_positions("one").tobytes()
    view = [1.0, -2.0, 1.0], [1.0, 0.5, 0.0], (32, 24), 0.8
    assert (copy.camera_image(*view).segments == host.camera_image(*view).segments).all()
