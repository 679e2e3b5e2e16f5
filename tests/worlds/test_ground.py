"""The ground of the spatial world: bodies stand, land and slide on it, or begin in it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulating import moved

from symaware_cli import Contact
from symaware_cli.core import AgentGroup, Entity, Obstacle, WorldError
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.world.reading import Image
from symaware_cli.worlds.spatial import PyBulletEnvironment

BALL = {"circle": {"radius": 0.25}}
CUBE = {"box": {"length": 0.5, "width": 0.5, "height": 0.5}}
PLATE = {"box": {"length": 0.5, "width": 0.4, "height": 0.2}}
CAN = {"cylinder": {"radius": 0.3, "height": 0.5}}

#: A cube about its origin, the lower half of which would be in the ground.
MESH = "\n".join(
    [
        *(f"v {x} {y} {z}" for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)),
        *(f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7))),
    ]
)
#: Two boxes, of which the lower hangs 0.6 m below the base, and the mass lies off the origin.
URDF = """<robot name="lamp"><link name="base">
<inertial><origin xyz="0 0 0.1"/><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>
</inertial><collision><geometry><box size="0.4 0.4 0.2"/></geometry></collision></link>
<link name="foot"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
<collision><geometry><box size="0.4 0.4 0.2"/></geometry></collision></link>
<joint name="neck" type="fixed"><parent link="base"/><child link="foot"/><origin xyz="0 0 -0.5"/></joint></robot>
"""


def world(
    obstacles: Mapping[str, Any], groups: Sequence[AgentGroup] = (), folder: Path | None = None, **parameters: Any
) -> PyBulletEnvironment:
    environment = PyBulletEnvironment(
        PyBulletEnvironment.Parameters(**{"time_step": 0.02, "substeps": 4, **parameters})
    )
    if folder:
        environment.folder = folder
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [[99.0, 99.0]])
    environment.initialise(groups or [nobody], obstacles, 1)
    return environment


@pytest.mark.parametrize("mass", [None, 1.0], ids=["fixed", "free"])
@pytest.mark.parametrize("level", [0.0, 2.0])
def test_files_given_two_coordinates_stand_on_the_ground(level: float, mass: float | None, tmp_path: Path) -> None:
    (tmp_path / "cube.obj").write_text(MESH)
    (tmp_path / "lamp.urdf").write_text(URDF)
    mesh = {"mesh": {"file": "cube.obj", "radius": 0.7}}
    lamp = {"urdf": {"file": "lamp.urdf", "radius": 0.3}}
    obstacles = {
        name: Obstacle(shape=shape, position=[x, 0.0], heading=0.4, mass=mass)
        for name, shape, x in (("mesh", mesh, 3.0), ("lamp", lamp, 6.0))
    }
    robot = AgentGroup("robot", ["robot"], Unicycle(), Entity(shape=mesh), [[0.0, 0.0, 0.0]])
    with world(obstacles, [robot], tmp_path, ground={"height": level}) as environment:
        expected = [level + 0.5, level + 0.5, level + 0.6]
        assert environment.body_positions(["robot", "mesh", "lamp"])[:, 2] == pytest.approx(expected, abs=1.1e-3)
        assert moved(environment, 1.0) == []
        assert environment.body_positions(["robot", "mesh", "lamp"])[:, 2] == pytest.approx(expected, abs=2e-3)


def test_an_agent_in_the_ground_at_the_start_is_reported_and_lifted_gently() -> None:
    obstacles = {
        "box": Obstacle(shape=CUBE, position=[0, 0, 0.1], mass=1.0),
        "ball": Obstacle(shape=BALL, position=[3, 0, 0.1], mass=1.0),
        "upright": Obstacle(shape=CUBE, position=[6, 0], mass=1.0),
    }
    with world(obstacles) as environment:
        told = environment.contacts()
        assert [(each.first, each.second) for each in told] == [("ball", "ground"), ("box", "ground")]
        assert [each.depth for each in told] == pytest.approx([0.15, 0.15], abs=1e-3)
        speeds = []
        for _ in range(150):
            environment.step()
            assert environment.contacts() == []
            speeds.append([environment.pose(name).velocity[2] for name in obstacles])
        assert np.max(speeds) < 0.05  # nothing is thrown out
        heights = [environment.pose(name).position[2] for name in obstacles]
        assert heights == pytest.approx([0.25] * 3, abs=2e-3)


@pytest.mark.parametrize(("shape", "tolerance"), [(BALL, 1e-6), (CUBE, 1e-3), (CAN, 0.03)], ids=["ball", "cube", "can"])
@pytest.mark.parametrize("elasticity", [1.0, 0.5])
def test_a_body_that_lands_flat_bounces_by_its_elasticity_with_that_impulse(
    shape: dict[str, Any], tolerance: float, elasticity: float
) -> None:
    obstacles = {"thing": Obstacle(shape=shape, position=[0, 0, 1.25], mass=2.0, elasticity=elasticity)}
    with world(obstacles, time_step=0.004, substeps=1) as environment:
        before = 0.0
        begun: list[Contact] = []
        while not begun:
            environment.step()
            begun = [each for each in environment.contacts() if each.begins]
            after = environment.pose("thing").velocity[2]
            before = before if begun else after
        speed = -before + 9.81 * 0.004  # the engine lets gravity act, and then solves contacts
        assert after == pytest.approx(elasticity * -before, abs=tolerance * speed + 1e-6)
        assert begun[0].impulse == pytest.approx(2.0 * (after + speed), rel=1e-6)


def test_a_bounce_without_loss_adds_no_energy() -> None:
    obstacles = {
        "ball": Obstacle(shape=BALL, position=[0, 0, 5], mass=1.0, elasticity=1.0, velocity=[3, 0, 0], friction=0.0),
        "left": Obstacle(shape=CUBE, position=[-0.6, 0, 5], elasticity=1.0),
        "right": Obstacle(shape=CUBE, position=[0.6, 0, 5], elasticity=1.0),
    }
    with world(obstacles, gravity=(0, 0, 0), ground=None) as environment:
        contacts = moved(environment, 3.0)
        assert sum(each.begins for each in contacts) > 20
        assert abs(environment.pose("ball").velocity[0]) == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize(("friction", "speed"), [(0.2, 2.0), (0.5, 2.0), (0.8, 3.0), (1.0, 3.0), (0.3, 6.0)])
def test_a_sliding_body_stops_by_coulombs_law(friction: float, speed: float) -> None:
    """v^2 / 2 mu g; R. C. Hibbeler, Engineering Mechanics: Dynamics, section 14.2. It is half a physics step short."""
    obstacles = {"plate": Obstacle(shape=PLATE, position=[0, 0], mass=2.0, friction=friction, velocity=[speed, 0.0])}
    with world(obstacles, time_step=0.02, substeps=5) as environment:
        moved(environment, 1.5 * speed / (friction * 9.81))
        x, y, _ = environment.pose("plate").position
    way = speed * speed / (2 * friction * 9.81)
    assert x + 0.5 * speed * 0.004 == pytest.approx(way, rel=0.01)
    assert abs(y) < 0.04 * way


def test_a_stack_of_four_stands() -> None:
    obstacles = {
        f"box{number}": Obstacle(shape=CUBE, position=[0, 0, 0.25 + 0.5 * number], mass=1.0, friction=0.7)
        for number in range(4)
    }
    with world(obstacles) as environment:
        moved(environment, 5.0)
        places = np.array([environment.pose(name).position for name in obstacles])
    assert places == pytest.approx(np.array([[0, 0, 0.25 + 0.5 * row] for row in range(4)]), abs=3e-3)


def test_the_image_of_the_ground_does_not_depend_on_bodies_on_it() -> None:
    def seen(mass: float | None) -> Image:
        with world({"cube": Obstacle(shape=CUBE, position=[0, 0], mass=mass)}) as environment:
            return environment.camera_image((-2.0, -2.0, 1.5), (0.5, 0.0, 0.2), (64, 48), 1.0)

    fixed, free = seen(None), seen(1.0)
    np.testing.assert_array_equal(fixed.colour, free.colour)
    np.testing.assert_array_equal(fixed.segments, free.segments)


def test_images_of_bodies_too_far_away_are_refused() -> None:
    """The renderer would not end."""
    wall = Obstacle(shape={"wall": {"points": [[-1e9, 2.0], [0.0, -3.0]]}}, position=[0, 0])
    with (
        world({"wall": wall}) as environment,
        pytest.raises(ValueError, match=r"as far away as 1e\+09 m"),
    ):
        environment.camera_image((-2.0, -2.0, 1.5), (0.5, 0.0, 0.2), (2, 2), 1.0)


def test_boxes_far_from_the_origin_stand_on_the_ground_too() -> None:
    obstacles = {
        "east": Obstacle(shape=CUBE, position=[5e5, 6e6], mass=1.0),
        "west": Obstacle(shape=CUBE, position=[5e5 - 3e3, 6e6], mass=1.0),
    }
    with world(obstacles) as environment:
        assert moved(environment, 1.0) == []
        assert [environment.pose(name).position[2] for name in obstacles] == pytest.approx([0.25] * 2, abs=1e-3)


@pytest.mark.parametrize("who", ["group", "entity"])
def test_no_other_body_may_have_the_name_ground(who: str) -> None:
    groups, obstacles = [], {}
    if who == "group":
        groups = [AgentGroup("ground", ["ground"], SingleIntegrator(), Entity(), [[0.0, 0.0]])]
    else:
        obstacles = {"ground": Obstacle(shape=CUBE, position=[0, 0])}
    with pytest.raises(WorldError, match="`ground` names the ground in contacts") as caught:
        world(obstacles, groups)
    assert caught.value.path == (("agents", "ground") if who == "group" else ("environment", "entities", "ground"))
    with world(obstacles, groups, ground=None):
        pass  # there is nothing to be taken for


@pytest.mark.parametrize("pace", [0.05, 0.2, 1.0, 5.0])
def test_balls_on_the_ground_lose_no_more_of_a_bounce_than_stacks_need_to_rest(pace: float) -> None:
    """1e-5 m in a physics step, or a hundredth."""
    for share in (0.0, 1e-3, 0.1, 0.5):
        gap = 0.1 + (8 + share) * pace * 0.005
        obstacles = {
            name: Obstacle(
                shape={"circle": {"radius": 0.1}},
                position=[side * gap, 0.0, 0.1],
                velocity=[-side * pace, 0.0, 0.0],
                mass=1.0,
                elasticity=1.0,
                friction=0.0,
            )
            for name, side in (("one", -1), ("other", 1))
        }
        with world(obstacles, time_step=0.05, substeps=10) as environment:
            moved(environment, 0.2)
            away = environment.pose("other").velocity[0] - environment.pose("one").velocity[0]
        assert away == pytest.approx(2 * pace, rel=0.01, abs=2.1e-3)
