"""Slopes and other tilted entities in the spatial world, against the inclined plane of the books."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import moved, untyped

from symaware_cli.core import AgentGroup, Entity, Obstacle, WorldError
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.geometry.rotation import attitude, rotated
from symaware_cli.geometry.shape import Shape, footprint
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

GRAVITY = 9.81
RAMP = {"box": {"length": 40.0, "width": 4.0, "height": 0.2}}
CRATE = {"box": {"length": 0.6, "width": 0.6, "height": 0.2}}
BALL = {"circle": {"radius": 0.25}}


def world(
    obstacles: Mapping[str, Any], kind: type[ColumnEnvironment] = PyBulletEnvironment, **parameters: Any
) -> ColumnEnvironment:
    environment = kind(kind.Parameters(**{"time_step": 0.02, **parameters}))
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [[99.0, 99.0]])
    environment.initialise([nobody], obstacles, 1)
    return environment


def slope(
    angle: float, heading: float, friction: float, what: Mapping[str, Any], **how: Any
) -> tuple[dict[str, Obstacle], NDArray[np.float64]]:
    """A ramp that descends ahead, a body on the middle of it, and the direction downwards."""
    orientation = attitude(0.0, angle, heading)
    up, down = rotated(orientation, [0.0, 0.0, 1.0]), rotated(orientation, [1.0, 0.0, 0.0])
    above = 0.25 if what is BALL else 0.1
    place = (np.array([0.0, 0.0, 20.0]) + (0.1 + above) * up).tolist()
    ramp = Obstacle(shape=RAMP, position=[0, 0, 20], heading=heading, pitch=angle, friction=1.0)
    lying = Obstacle(shape=what, position=place, heading=heading, pitch=angle, mass=2.0, friction=friction, **how)
    return {"ramp": ramp, "it": lying}, down


@pytest.mark.parametrize("heading", [0.0, 0.9, -2.4])
@pytest.mark.parametrize("friction", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("angle", [0.1, 0.3, 0.5])
def test_a_crate_slides_down_a_slope_by_coulombs_law(angle: float, friction: float, heading: float) -> None:
    """g (sin a - mu cos a) where tan a > mu, and else not at all; Hibbeler, Statics, section 8.2."""
    obstacles, down = slope(angle, heading, friction, CRATE)
    expected = max(0.0, GRAVITY * (math.sin(angle) - friction * math.cos(angle)))
    with world(obstacles) as environment:
        start = np.array(environment.pose("it").position)
        moved(environment, 1.0)
        early = np.array(environment.pose("it").velocity)
        moved(environment, 1.0)
        gone = np.array(environment.pose("it").position) - start
        late = np.array(environment.pose("it").velocity)
    assert (late - early) @ down == pytest.approx(expected, rel=0.01, abs=2e-3)
    assert gone @ down == pytest.approx(2.0 * expected, rel=0.02, abs=5e-3)
    assert np.linalg.norm(gone - (gone @ down) * down) < 0.01


@pytest.mark.parametrize("friction", [0.36, 0.37, 0.39, 0.40])
def test_the_angle_of_repose_follows_from_the_coefficient_of_friction(friction: float) -> None:
    angle = math.atan(0.38)
    obstacles, down = slope(angle, 0.0, friction, CRATE)
    with world(obstacles) as environment:
        start = np.array(environment.pose("it").position)
        moved(environment, 2.0)
        gone = (np.array(environment.pose("it").position) - start) @ down
    expected = max(0.0, GRAVITY * (math.sin(angle) - friction * math.cos(angle)))
    assert gone == pytest.approx(2.0 * expected, rel=0.1, abs=0.01)


def test_a_ball_rolls_down_a_slope_with_five_sevenths() -> None:
    obstacles, down = slope(0.3, 0.4, 1.0, BALL)
    with world(obstacles) as environment:
        moved(environment, 1.0)
        speed = np.array(environment.pose("it").velocity) @ down
    assert speed == pytest.approx(5 / 7 * GRAVITY * math.sin(0.3), rel=0.01)


def test_a_tilted_body_given_two_coordinates_stands_on_the_ground() -> None:
    obstacles = {
        "fixed": Obstacle(shape=CRATE, position=[0, 0], roll=0.4, pitch=-0.2),
        "free": Obstacle(shape=CRATE, position=[5, 0], pitch=math.pi / 2, mass=1.0),
        "led": Obstacle(shape=CRATE, path={"times": [0, 9], "positions": [[0, 5], [9, 5]]}, roll=math.pi / 2),
    }
    with world(obstacles) as environment:
        heights = environment.body_positions(list(obstacles))[:, 2]
        moved(environment, 0.1)
        after = environment.body_positions(["led"])[0]
    lowest = -rotated(attitude(0.4, -0.2, 0.0), [[x, y, -0.1] for x in (-0.3, 0.3) for y in (-0.3, 0.3)])[:, 2].min()
    assert heights == pytest.approx([lowest, 0.3, 0.3], abs=1e-3)
    assert after == pytest.approx([0.1, 5.0, 0.3], abs=1e-3)


def test_a_body_on_a_path_keeps_its_tilt() -> None:
    led = Obstacle(
        shape=RAMP, pitch=0.3, path={"times": [0, 10], "positions": [[0, 0, 9], [10, 0, 9]], "headings": [0, 1]}
    )
    with world({"ramp": led}) as environment:
        moved(environment, 1.0)
        rays = environment.ray_cast(np.array([0]), np.array([[11.0, 0.0]]), np.array([[[-1.0, 0.0]]]), 5.0, height=5.0)
        body = untyped(environment)._body_poses.pose(untyped(environment)._entities["ramp"])[1]
    assert body == pytest.approx(attitude(0.0, 0.3, 0.1), abs=1e-6)
    assert rays.shape == (1, 1)


@pytest.mark.parametrize("description", [CRATE, RAMP, {"cylinder": {"radius": 0.5, "height": 2.0}}])
@pytest.mark.parametrize(("roll", "pitch"), [(0.3, 0.0), (0.0, -1.2), (0.7, 0.4), (0.0, math.pi / 2), (math.pi, 0.0)])
def test_a_footprint_contains_the_body_tightly(description: dict[str, Any], roll: float, pitch: float) -> None:
    shape = Shape(**description)
    ((outline, _),) = footprint(shape, roll, pitch).pieces
    corners = np.array(outline)
    generator = np.random.default_rng(3)
    inside = generator.uniform(-0.5, 0.5, (40_000, 3))
    if shape.box:
        inside *= [shape.box.length, shape.box.width, shape.box.upright]
    else:
        inside = inside[np.hypot(*inside[:, :2].T) <= 0.5] * [1.0, 1.0, 2.0]
    below = rotated(attitude(roll, pitch, 0.0), inside)[:, :2]
    edges = np.roll(corners, -1, axis=0) - corners
    aside = edges[:, 0] * (below[:, None, 1] - corners[:, 1]) - edges[:, 1] * (below[:, None, 0] - corners[:, 0])
    aside /= np.linalg.norm(edges, axis=1)
    assert aside.min() > -1e-5
    assert aside.min(axis=0).max() < 0.15 * shape.radius  # there is something near each edge


def test_the_scenery_has_footprints() -> None:
    ramp = Obstacle(shape=RAMP, position=[0, 0, 5], heading=math.pi / 2, pitch=1.0)
    with world({"ramp": ramp}) as environment:
        near = environment.scenery.nearest(np.array([[0.0, 15.0]]), 20.0)
    reach = 20.0 * math.cos(1.0) + 0.1 * math.sin(1.0)
    assert near.distance == pytest.approx([15.0 - reach], abs=1e-5)


@pytest.mark.parametrize("kind", [KinematicEnvironment, PymunkEnvironment])
def test_a_planar_world_refuses_tilted_bodies(kind: type[ColumnEnvironment]) -> None:
    obstacles = {
        "one": Obstacle(shape=CRATE, position=[0, 0], roll=0.1),
        "other": Obstacle(shape=CRATE, position=[5, 0], pitch=0.1),
    }
    with pytest.raises(WorldError, match="no third dimension") as refused:
        world(obstacles, kind)
    assert refused.value.needs == "tilt"
    paths = [refused.value.path, *(other.path for other in refused.value.others)]
    assert paths == [("environment", "entities", "one", "roll"), ("environment", "entities", "other", "pitch")]


@pytest.mark.parametrize(
    "shape", [{"polygon": {"vertices": [[0, 0], [1, 0], [0, 1]]}}, {"wall": {"points": [[0, 0], [1, 0]]}}]
)
def test_upright_bodies_are_not_tilted(shape: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="stands upright"):
        Obstacle(shape=shape, position=[0, 0], roll=0.2)
