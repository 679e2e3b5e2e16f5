"""Bodies with a path in physics worlds follow it and push others, but not when the path jumps."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.worlds.physics import PhysicsEnvironment
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

CRATE = {"box": {"length": 0.5, "width": 0.5, "height": 0.5}}
BALL = {"circle": {"radius": 0.2}}
ELL = {"wall": {"points": [[0, 0], [1, 0], [1, 1]], "thickness": 0.1}}


@pytest.fixture(params=[PymunkEnvironment, PyBulletEnvironment], ids=["pymunk", "pybullet"])
def kind(request: pytest.FixtureRequest) -> type[PhysicsEnvironment]:
    result: type[PhysicsEnvironment] = request.param
    return result


def world(kind: type[PhysicsEnvironment], obstacles: Mapping[str, Any], **parameters: Any) -> PhysicsEnvironment:
    if kind is PyBulletEnvironment:
        parameters = {"gravity": (0, 0, 0), "ground": None} | parameters
    environment = kind(kind.Parameters(**{"time_step": 0.05, "substeps": 10, **parameters}))
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [[99.0, 99.0]])
    environment.initialise([nobody], obstacles, 1)
    return environment


def run(environment: PhysicsEnvironment, time: float) -> None:
    for _ in range(round(time * 1e9 / environment.time_step)):
        environment.step()


def ball(x: float, y: float, **more: Any) -> Obstacle:
    return Obstacle(shape=BALL, position=[x, y], mass=1.0, friction=0.0, **more)


def test_a_path_that_jumps_to_its_start_pushes_no_body(kind: type[PhysicsEnvironment]) -> None:
    """Balls touch a bus at its start and its end: its jump back in no time is no motion."""
    # Neither ends with a physics step.
    path = {"times": [0, 0.5, 0.999], "positions": [[0, 0], [0, 5], [5, 5]], "repeat": True}
    turning = {"times": [0, 0.999], "positions": [[0, 9], [0, 9]], "headings": [0, 2 * np.pi], "repeat": True}
    obstacles = {
        "bus": Obstacle(shape=CRATE, path=path),
        "start": ball(-0.449, -0.1),
        "end": ball(5.0, 4.551),
        "disc": Obstacle(shape=BALL, path=turning, friction=1.0),
        "near": Obstacle(shape=BALL, position=[0.399, 9.0], mass=1.0, friction=1.0),
    }
    with world(kind, obstacles) as environment:
        run(environment, 2.25)
        for name in ("start", "end"):
            assert np.abs(environment.pose(name).velocity).max() < 0.5
        assert np.abs(environment.pose("near").velocity).max() < 2 * np.pi * 0.2 + 0.1
        assert environment.pose("bus").position[:2] == pytest.approx((0.0, 2.52))


def test_a_closed_path_pushes_evenly_at_its_start(kind: type[PhysicsEnvironment]) -> None:
    path = {"times": [0, 1, 2], "positions": [[0, 0], [1, 0], [0, 0]], "repeat": True}
    with world(kind, {"cart": Obstacle(shape=CRATE, path=path), "ball": ball(1.2, 0.0)}) as environment:
        run(environment, 1.0)
        assert environment.pose("ball").velocity[0] == pytest.approx(1.0, abs=0.02)
        run(environment, 3.0)
        assert environment.pose("cart").position[:2] == pytest.approx((0.0, 0.0))


def test_a_wall_with_a_path_sweeps_away_bodies(kind: type[PhysicsEnvironment]) -> None:
    path = {"times": [0, 2], "positions": [[0, 0], [2, 0]]}
    obstacles = {"wall": Obstacle(shape=ELL, path=path), "ball": ball(1.5, 0.5), "beside": ball(1.5, 1.4)}
    with world(kind, obstacles) as environment:
        run(environment, 1.5)
        assert environment.pose("wall").position[:2] == pytest.approx((1.5, 0.0))
        assert environment.pose("ball").position[0] > 2.7
        assert environment.pose("beside").position[:2] == pytest.approx((1.5, 1.4))
        found = environment.scenery.nearest(np.array([[2.0, 0.5]]), 1.0)
        assert found.distance[found.obstacle == environment.scenery.names.index("wall")].min() == pytest.approx(
            0.45, abs=1e-6
        )


def test_a_door_made_of_a_wall_swings_about_its_hinge(kind: type[PhysicsEnvironment]) -> None:
    """The far end of a door of 1 m moves at w r; what it meets at the middle goes ahead at half of that."""
    path = {"times": [0, 2], "positions": [[0, 0], [0, 0]], "headings": [0.0, 1.0]}
    door = {"wall": {"points": [[0, 0], [1, 0]], "thickness": 0.1}}
    with world(kind, {"door": Obstacle(shape=door, path=path), "ball": ball(0.5, 0.26)}) as environment:
        run(environment, 0.2)
        assert environment.pose("ball").velocity[1] == pytest.approx(0.25, abs=0.02)
        run(environment, 1.8)
        assert environment.pose("door").heading == pytest.approx(1.0)
        x, y = environment.pose("ball").position[:2]
        assert y * np.cos(1.0) - x * np.sin(1.0) > 0.24  # it is still on the side to which the door swings


def test_a_wall_in_space_moves_at_the_height_of_its_path() -> None:
    path = {"times": [0, 1], "positions": [[0, 0, 2], [1, 0, 2]]}
    with world(PyBulletEnvironment, {"wall": Obstacle(shape=ELL, path=path)}) as environment:
        run(environment, 0.5)
        assert environment.body_positions(["wall"])[0] == pytest.approx([0.5, 0.0, 2.0])


def test_a_body_on_a_path_without_heights_stands_on_the_ground() -> None:
    path = {"times": [0, 1], "positions": [[0, 0], [1, 0]]}
    ground = {"height": 3.0}
    with world(PyBulletEnvironment, {"cart": Obstacle(shape=CRATE, path=path)}, ground=ground) as environment:
        run(environment, 0.5)
        assert environment.body_positions(["cart"])[0] == pytest.approx([0.5, 0.0, 3.25])


def test_a_file_with_an_offset_centre_of_mass_is_moved_by_its_origin() -> None:
    path = {"times": [0, 1], "positions": [[0, 0, 2], [1, 0, 2]]}
    teddy = Obstacle(shape={"urdf": {"file": "pybullet_data/lego/lego.urdf", "radius": 0.1}}, path=path)
    with world(PyBulletEnvironment, {"teddy": teddy}) as environment:
        run(environment, 0.5)
        assert environment.body_positions(["teddy"])[0, 2] == pytest.approx(2.0, abs=1e-6)
