"""MuJoCo agrees with the world `pybullet`: the same car, and the same camera image."""

from typing import Any

import numpy as np
import pytest
from symaware_mujoco.vehicles import read_vehicle
from symaware_mujoco.world import MujocoEnvironment

from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.racecar import Racecar
from symaware_cli.worlds.spatial import PyBulletEnvironment

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

BALL = {"circle": {"radius": 0.5}}
CRATE = {"box": {"length": 0.4, "width": 0.4, "height": 0.4}}


def looking(kind: Any, obstacles: Any) -> Any:
    group = AgentGroup("robot", ["robot"], SingleIntegrator(), Entity(shape=BALL), np.array([[0.0, 0.0]]))
    environment = kind(kind.Parameters.model_validate({"time_step": 0.02}))
    environment.initialise([group], obstacles, 1)
    return environment


def test_the_file_of_the_car_is_that_of_pybullet_data() -> None:
    vehicle = Racecar().vehicle()
    models = [read_vehicle(file).compile() for file in (vehicle.description(), vehicle.portable_description())]
    theirs, ours = ({model.body(number).name: model.body(number) for number in range(model.nbody)} for model in models)
    # Lenses of the camera, of 10 mg each.
    assert theirs.keys() - ours.keys() == {"camera_link", "zed_camera_right_link"}
    for name, body in ours.items():
        for what in ("mass", "inertia", "ipos", "pos", "quat"):
            assert getattr(body, what) == pytest.approx(getattr(theirs[name], what), abs=1e-9), (name, what)
    shapes = [sorted(map(tuple, model.geom_size.round(9).tolist())) for model in models]
    assert shapes[0] == shapes[1]
    joints = [{model.joint(number).name for number in range(model.njnt)} for model in models]
    assert joints[0] == joints[1]


def test_both_engines_see_the_same() -> None:
    obstacles = {
        "ball": Obstacle(shape=BALL, position=[3.0, 1.0], mass=1.0),
        "can": Obstacle(shape={"cylinder": {"radius": 0.2, "height": 0.5}}, position=[4.0, -0.7]),
        "crate": Obstacle(shape=CRATE, position=[3.0, 0.0], heading=0.4),
        "wall": Obstacle(shape={"wall": {"points": [[5, -2], [5, 2]], "thickness": 0.1}}),
    }
    images = []
    for kind in (PyBulletEnvironment, MujocoEnvironment):
        with looking(kind, obstacles) as environment:
            images.append(environment.camera_image([0.0, -1.0, 1.2], [3.5, 0.0, 0.2], (80, 60), 0.7))
    theirs, ours = images
    same = theirs.segments == ours.segments
    assert same.mean() > 0.96
    solid = same & (theirs.segments > 1) & (theirs.segments < 6)
    assert np.median(np.abs(theirs.depth[solid] - ours.depth[solid])) < 0.02
