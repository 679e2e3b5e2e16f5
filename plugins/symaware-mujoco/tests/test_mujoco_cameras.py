"""Cameras in MuJoCo: images by rays, which need no screen, and are repeatable to the byte."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from symaware_mujoco.world import MujocoEnvironment

import symaware_cli as sa
from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.racecar import Racecar
from symaware_cli.log.digest import digest

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

ROOT = Path(__file__).parents[3]
BALL = {"circle": {"radius": 0.5}}
CRATE = {"box": {"length": 0.4, "width": 0.4, "height": 0.4}}


def world(kind: Any = MujocoEnvironment, obstacles: Any = None, cars: bool = False, **parameters: Any) -> Any:
    groups = [AgentGroup("robot", ["robot"], SingleIntegrator(), Entity(shape=BALL), np.array([[0.0, 0.0]]))]
    if cars:
        groups.append(AgentGroup("car", ["car"], Racecar(), Entity(), np.array([[3.0, 0.0, 0.5, 0.0, 0.0]])))
    environment = kind(kind.Parameters.model_validate({"time_step": 0.02, **parameters}))
    environment.initialise(groups, obstacles or {}, 1)
    return environment


def test_depths_are_those_along_the_axis_of_the_camera() -> None:
    wall = Obstacle(shape={"box": {"length": 0.2, "width": 100.0, "height": 50.0}}, position=[5.0, 0.0])
    image = world(obstacles={"wall": wall}).camera_image([-1.0, 0.0, 20.0], [0.0, 0.0, 20.0], (33, 25), 1.0)
    assert image.depth == pytest.approx(np.full((25, 33), 5.9), abs=1e-9)
    assert (image.segments == 2).all()


def test_a_ball_is_as_large_as_its_angle_and_upwards_is_up() -> None:
    balls = {"ball": Obstacle(shape=BALL, position=[10.0, 1.0, 5.0])}
    image = world(obstacles=balls, ground=None).camera_image([0.0, 0.0, 4.0], [10.0, 0.0, 4.0], (201, 201), 0.4)
    rows, columns = np.nonzero(image.segments)
    # The ball is to the left of the middle and above it.
    assert rows.max() < 100
    assert columns.max() < 100
    pixel = 2 * np.tan(0.2) / 201
    assert np.ptp(columns) * pixel == pytest.approx(2 * 0.5 / 10.0, rel=0.06)
    assert np.isinf(image.depth[image.segments == 0]).all()
    assert (image.colour[image.segments == 0] == 255).all()


def test_a_camera_looks_out_of_the_body_that_it_is_in() -> None:
    obstacles = {"crate": Obstacle(shape=CRATE, position=[2.0, 0.0])}
    image = world(obstacles=obstacles).camera_image([0.0, 0.0, 0.2], [1.0, 0.0, 0.2], (16, 12), 0.2)
    assert image.segments[6, 8] == 2
    assert not (image.segments == 1).any()


def test_a_camera_that_looks_straight_down_has_x_upwards() -> None:
    obstacles = {"crate": Obstacle(shape=CRATE, position=[1.0, 0.0])}
    image = world(obstacles=obstacles).camera_image([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], (40, 40), 1.0)
    assert np.nonzero(image.segments == 2)[0].max() < 20


def test_visual_shapes_are_seen_only_if_the_scenario_says_so() -> None:
    found, rays = [], []
    for visuals in (False, True):
        environment = world(cars=True, visuals=visuals)
        image = environment.camera_image([3.0, -1.0, 0.5], [3.2, 0.0, 0.05], (64, 48), 0.8)
        found.append(np.count_nonzero(image.segments == 1))
        # Rays of a lidar meet collision shapes only.
        towards = np.array([[[np.cos(angle), np.sin(angle)] for angle in np.linspace(-0.1, 0.1, 21)]])
        rays.append(environment.ray_cast(np.array([1]), np.zeros((1, 2)), towards, 9.0, -0.4))
    # The chassis has visual shapes, but no collision shape.
    assert found[1] > 1.1 * found[0] > 0
    assert np.isfinite(rays[0]).any()
    assert rays[0].tobytes() == rays[1].tobytes()


def test_absent_agents_are_not_in_the_picture() -> None:
    group = AgentGroup(
        "robot", ["robot.0", "robot.1"], SingleIntegrator(), Entity(shape=BALL), [[3.0, 0.0], [5.0, 0.0]]
    )
    group.present = np.array([False, True])
    environment = MujocoEnvironment(MujocoEnvironment.Parameters())
    environment.initialise([group], {}, 1)
    view = [0.0, 0.0, 0.5], [1.0, 0.0, 0.5], (9, 9), 0.1
    assert environment.camera_image(*view).segments[4, 4] == 2
    group.present = np.array([True, True])
    environment.admit(group, [0])
    assert environment.camera_image(*view).segments[4, 4] == 1


def test_lines_of_sight_end_at_obstacles_but_not_at_agents() -> None:
    positions = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    group = AgentGroup(
        "robot", ["a", "b", "c"], SingleIntegrator(), Entity(shape={"circle": {"radius": 0.2}}), positions
    )
    environment = MujocoEnvironment(MujocoEnvironment.Parameters())
    low = Obstacle(shape={"box": {"length": 0.2, "width": 0.2, "height": 0.1}}, position=[0.0, 2.0])
    environment.initialise([group], {"crate": Obstacle(shape=CRATE, position=[2.0, 0.0]), "low": low}, 1)
    free = environment.in_sight(np.array([0, 1, 0, 1]), np.array([1, 0, 2, 2]))
    assert free.tolist() == [False, False, True, True]


def test_images_are_the_same_to_the_byte_in_each_run(tmp_path: Path) -> None:
    scenario = yaml.safe_load((ROOT / "scenarios" / "drones.yaml").read_text())
    scenario["environment"]["use"] = "mujoco"
    scenario["run"]["duration"] = 0.6
    found = []
    for name in ("one", "two"):
        sa.scenario(scenario).run(output=tmp_path / f"{name}.mcap")
        found.append(digest(sa.open_log(tmp_path / f"{name}.mcap")).channels)
    assert found[0] == found[1]
    assert any("look" in topic for topic in sa.open_log(tmp_path / "one.mcap").channels)
