"""The spatial world: features of PyBullet alone, such as ground, height, meshes and URDF files."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from engine_clients import pybullet_clients
from simulating import made, moved, present, untyped

from symaware_cli import Contact, open_log
from symaware_cli.core import AgentGroup, Entity, Obstacle, WorldError
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest
from symaware_cli.worlds.bullet import engine
from symaware_cli.worlds.spatial import PyBulletEnvironment

BALL = {"circle": {"radius": 0.1}}
CUBE = {"box": {"length": 0.4, "width": 0.4, "height": 0.4}}

#: A tetrahedron, 1 m high.
MESH = """v -0.5 -0.5 0
v 0.5 -0.5 0
v 0 0.5 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""
URDF = """<robot name="post"><link name="base">
<inertial><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
<collision><geometry><{shape}/></geometry></collision></link></robot>
"""


def world(
    obstacles: Mapping[str, Any] | None = None,
    groups: Sequence[AgentGroup] = (),
    folder: Path = Path(),
    **parameters: Any,
) -> PyBulletEnvironment:
    environment = made(PyBulletEnvironment, **{"time_step": 0.02, "substeps": 4, **parameters})
    environment.folder = folder
    nobody = AgentGroup("nobody", ["nobody"], SingleIntegrator(), Entity(), [[99.0, 99.0]])
    environment.initialise(groups or [nobody], obstacles or {}, 1)
    return environment


def height(environment: PyBulletEnvironment, name: str) -> float:
    return environment.pose(name).position[2]


def test_a_body_without_a_height_stands_on_the_ground() -> None:
    shapes = {"ball": BALL, "cube": CUBE, "can": {"cylinder": {"radius": 0.1, "height": 0.5}}}
    obstacles = {
        name: Obstacle(shape=shape, position=[float(number), 0.0], mass=1.0)
        for number, (name, shape) in enumerate(shapes.items())
    }
    with world(obstacles, ground={"height": 2.0}) as environment:
        contacts = moved(environment, 1.0)
        found = [height(environment, name) for name in shapes]
    assert found == pytest.approx([2.1, 2.2, 2.25], abs=2e-3)
    assert contacts == []


def test_a_falling_body_bounces_as_high_as_its_elasticity_allows() -> None:
    obstacles = {"ball": Obstacle(shape=BALL, position=[0, 0, 1.1], mass=2.0, elasticity=0.8)}
    with world(obstacles, time_step=0.004) as environment:
        heights = []
        contacts: list[Contact] = []
        for _ in range(250):
            environment.step()
            contacts += environment.contacts()
            heights.append(height(environment, "ball") - 0.1)
    hit = contacts[0]
    assert (hit.first, hit.second) == ("ball", "ground")
    speed = np.sqrt(2 * 9.81)
    assert hit.impulse == pytest.approx(2.0 * 1.8 * speed, rel=0.02)
    assert max(heights[int(0.5 / 0.004) :]) == pytest.approx(0.64, rel=0.01)


def test_an_agent_in_a_plane_stays_upright_at_one_height_without_friction_of_the_ground() -> None:
    tall = Entity(shape={"box": {"length": 0.2, "width": 0.2, "height": 2.0}}, friction=1.0)
    robot = AgentGroup("robot", ["robot"], Unicycle(), tall, [[0.0, 0.0, 0.0]])
    obstacles = {"ball": Obstacle(shape=BALL, position=[1.0, 0.02, 1.9], mass=5.0)}
    with world(obstacles, [robot]) as environment:
        robot.control_input = [[1.0, 0.0]]
        moved(environment, 3.0)
        assert environment.state(robot)[0, 0] == pytest.approx(3.0, abs=0.2)
        assert environment._positions[0, 2] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("kind", [SingleIntegrator, DoubleIntegrator])
def test_an_agent_in_space_is_carried_and_lands_on_bodies_below(kind: type[NoisyModel]) -> None:
    model = made(kind, dimensions=3)
    state = np.eye(1, len(model.state), 2)  # at a height of 1 m, at rest
    drone = AgentGroup("drone", ["drone"], model, Entity(shape=BALL), state)
    with world({}, [drone]) as environment:
        moved(environment, 1.0)
        assert environment.state(drone)[0, 2] == pytest.approx(1.0)
        drone.control_input = [[0.0, 0.0, -1.0]]
        contacts = moved(environment, 3.0)
        assert environment.state(drone)[0, 2] == pytest.approx(0.1, abs=0.01)
        assert (contacts[0].first, contacts[0].second) == ("drone", "ground")


def test_a_box_that_tips_over_has_its_orientation_in_the_log() -> None:
    plank = {"box": {"length": 0.1, "width": 0.4, "height": 1.0}}
    obstacles = {
        "plank": Obstacle(shape=plank, position=[0, 0, 0.5], mass=1.0),
        "ball": Obstacle(shape=BALL, position=[-1.0, 0, 0.9], mass=3.0, velocity=[4.0, 0, 1.0]),
    }
    with world(obstacles) as environment:
        assert environment.body_poses("plank") == pytest.approx(np.array([[0, 0, 0.5, 0, 0, 0, 1]]))
        moved(environment, 2.0)
        x, y = present(environment.body_poses("plank"))[0, 3:5]
        assert 1 - 2 * (x * x + y * y) == pytest.approx(0.0, abs=0.05)  # its z axis lies in the plane
        assert height(environment, "plank") == pytest.approx(0.05, abs=0.01)


def test_a_mesh_is_a_body_like_others(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "tent.obj").write_text(MESH)
    tent = {"mesh": {"file": "parts/tent.obj", "scale": 0.5, "radius": 0.4}}
    obstacles = {
        "tent": Obstacle(shape=tent, position=[0, 0]),
        "ball": Obstacle(shape=BALL, position=[0.0, 0, 1.0], mass=1.0),
    }
    with world(obstacles, folder=tmp_path) as environment:
        contacts = moved(environment, 0.6)
        hit = contacts[0]
        assert (hit.first, hit.second) == ("ball", "tent")
        assert hit.point[2] == pytest.approx(0.5, abs=0.03)  # its tip
        near = environment.scenery.nearest(np.array([[1.0, 0.0]]), 2.0)
        disc = environment.scenery.names.index("tent")
        assert near.distance[near.obstacle == disc] == pytest.approx([0.6])  # the disc that stands for it


def test_a_free_mesh_falls_and_rests(tmp_path: Path) -> None:
    (tmp_path / "tent.obj").write_text(MESH)
    tent = {"mesh": {"file": "tent.obj", "radius": 0.7}}
    with world({"tent": Obstacle(shape=tent, position=[0, 0, 0.5], mass=1.0)}, folder=tmp_path) as environment:
        contacts = moved(environment, 2.0)
        assert (contacts[0].first, contacts[0].second) == ("ground", "tent")
        assert np.abs(environment.pose("tent").velocity).max() < 0.01


@pytest.mark.parametrize("fixed", [True, False])
def test_a_urdf_file_stands_fixed_or_free(fixed: bool, tmp_path: Path) -> None:
    (tmp_path / "post.urdf").write_text(URDF.format(shape='box size="0.2 0.2 1"'))
    post = Obstacle(
        shape={"urdf": {"file": "post.urdf", "radius": 0.2}}, position=[0, 0, 0.5], mass=None if fixed else 2.0
    )
    ball = Obstacle(shape=BALL, position=[-1, 0, 0.8], mass=3.0, velocity=[5.0, 0, 0.5])
    with world({"post": post, "ball": ball}, folder=tmp_path) as environment:
        contacts = moved(environment, 2.0)
        assert ("ball", "post") in [(each.first, each.second) for each in contacts]
        if fixed:
            assert environment.pose("post").position == (0, 0, 0.5)
        else:
            assert height(environment, "post") == pytest.approx(0.1, abs=0.02)  # it fell over


def test_files_of_pybullet_data_can_be_used() -> None:
    duck = Obstacle(
        shape={"urdf": {"file": "pybullet_data/duck_vhacd.urdf", "radius": 0.1}}, position=[0, 0, 1], mass=1
    )
    with world({"duck": duck}) as environment:
        moved(environment, 2.0)
        assert -0.01 < height(environment, "duck") < 0.2


def test_a_body_with_an_offset_centre_of_mass_starts_at_the_pose_of_the_file() -> None:
    teddy = Obstacle(
        shape={"urdf": {"file": "pybullet_data/lego/lego.urdf", "radius": 0.1}}, position=[1, 2, 3], mass=1
    )
    with world({"teddy": teddy}, gravity=(0, 0, 0)) as environment:
        assert environment.pose("teddy").position == pytest.approx((1, 2, 3), abs=1e-6)


# -- bad input


@pytest.mark.parametrize(
    "file",
    ["/etc/passwd.obj", "../secret.obj", "a/../../b.obj", "..\\b.obj", "C:/b.obj", "", "mesh.txt", "~/x.stl/../../y"],
)
def test_a_path_that_leads_elsewhere_is_refused(file: str) -> None:
    with pytest.raises(ValueError, match=r"file|path|\.obj"):
        Obstacle(shape={"mesh": {"file": file, "radius": 1.0}}, position=[0, 0])


def refused(tmp_path: Path, shape: Mapping[str, Any], said: str) -> None:
    with pytest.raises(WorldError, match=said) as caught:
        world({"thing": Obstacle(shape=shape, position=[0, 0, 0], mass=1.0)}, folder=tmp_path)
    assert caught.value.path[:4] == ("environment", "entities", "thing", "shape")


def test_a_missing_or_broken_file_is_reported(tmp_path: Path) -> None:
    (tmp_path / "empty.obj").write_text("# nothing\n")
    (tmp_path / "cut.urdf").write_text("<robot name='x'><link name=")
    (tmp_path / "page.urdf").write_text("<html><body/></html>")
    (tmp_path / "lost.urdf").write_text(URDF.format(shape='mesh filename="lost.obj"'))
    (tmp_path / "out.urdf").write_text(URDF.format(shape='mesh filename="../../etc/x.obj"'))
    (tmp_path / "twins.urdf").write_text(URDF.format(shape='sphere radius="a"').replace("</link>", "</link>" * 1))
    mesh = {"file": "nowhere.obj", "radius": 1.0}
    refused(tmp_path, {"mesh": mesh}, "no file `nowhere.obj` in the scenario's folder")
    refused(tmp_path, {"mesh": mesh | {"file": "pybullet_data/nowhere.obj"}}, "in pybullet_data")
    refused(tmp_path, {"mesh": mesh | {"file": "empty.obj"}}, "empty.obj: it has no triangles")
    for name, said in {
        "cut": r"cut.urdf:1:\d+: it is no XML",
        "page": "describes no robot",
        "lost": "names the mesh `lost.obj`, which is not there",
        "out": "leads out of its folder",
    }.items():
        refused(tmp_path, {"urdf": {"file": f"{name}.urdf", "radius": 1.0}}, said)


@pytest.mark.parametrize(
    ("mass", "said"),
    [
        ("-1", "a mass of -1"),
        ("nan", "a mass of nan"),
        ("1e400", "a mass of inf"),
        ("0", "no mass"),
    ],
)
def test_a_urdf_file_without_a_positive_mass_is_reported(mass: str, said: str, tmp_path: Path) -> None:
    text = URDF.format(shape='sphere radius="0.1"').replace('mass value="2"', f'mass value="{mass}"')
    (tmp_path / "post.urdf").write_text(text)
    refused(tmp_path, {"urdf": {"file": "post.urdf", "radius": 0.1}}, f"`post.urdf` gives .* {said}")


def test_a_mass_that_is_no_number_is_reported_at_its_line(tmp_path: Path) -> None:
    text = URDF.format(shape='sphere radius="0.1"').replace('mass value="2"', 'mass value="heavy"')
    (tmp_path / "post.urdf").write_text(text)
    refused(tmp_path, {"urdf": {"file": "post.urdf", "radius": 0.1}}, r"post.urdf:2:\d+: .* `heavy` is no number")


@pytest.mark.parametrize("shape", ["mesh", "urdf"])
def test_agents_are_made_of_files_too(shape: str, tmp_path: Path) -> None:
    (tmp_path / "body.obj").write_text(MESH)
    (tmp_path / "body.urdf").write_text(URDF.format(shape='box size="0.4 0.4 1"'))
    file = {"mesh": "body.obj", "urdf": "body.urdf"}[shape]
    body = Entity(shape={shape: {"file": file, "radius": 0.5}}, mass=3.0)
    robot = AgentGroup("robot", ["robot"], Unicycle(), body, [[0.0, 0.0, 0.5]])
    rock = Obstacle(shape=CUBE, position=[1.5, 0.8])
    with world({"rock": rock}, [robot], tmp_path) as environment:
        assert environment.state(robot)[0] == pytest.approx([0.0, 0.0, 0.5])
        robot.control_input = [[1.0, 0.0]]
        contacts = moved(environment, 3.0)
        assert (contacts[0].first, contacts[0].second) == ("robot", "rock")
        assert environment.state(robot)[0, 0] < 1.5  # it did not go through


def test_a_link_that_leads_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.obj").write_text(MESH)
    os.symlink(tmp_path / "secret.obj", inside / "link.obj")
    refused(inside, {"mesh": {"file": "link.obj", "radius": 1.0}}, "leads out of the scenario's folder")


def test_a_failed_world_leaves_no_client(tmp_path: Path) -> None:
    before = pybullet_clients()
    with pytest.raises(WorldError):
        world({"thing": Obstacle(shape={"mesh": {"file": "x.obj", "radius": 1.0}}, position=[0, 0])}, folder=tmp_path)
    assert pybullet_clients() <= before


def test_a_window_needs_a_screen_and_not_too_many_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(WorldError, match="no screen") as caught:
        world({}, gui=True)
    assert caught.value.path == ("environment", "with", "gui")
    crowd = AgentGroup("crowd", [str(n) for n in range(1025)], SingleIntegrator(), Entity(), np.zeros((1025, 2)))
    with pytest.raises(WorldError, match="at most 1,024 bodies, and there are 1,025"):
        world({}, [crowd], gui=True)


SCENARIO = {
    "symaware": 1,
    "name": "tent",
    "run": {"duration": 0.2},
    "environment": {
        "use": "pybullet",
        "entities": {
            "tent": {"shape": {"mesh": {"file": "tent.obj", "radius": 0.7}}, "position": [0, 0, 1], "mass": 1}
        },
    },
    "agents": {"robot": {"model": {"use": "single-integrator"}, "state": [3, 3]}},
}


def test_a_log_brings_along_the_files_that_it_takes_to_run_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (home / "tent.obj").write_text(MESH)
    (home / "tent.yaml").write_text(yaml.safe_dump(SCENARIO))
    execute(build(home / "tent.yaml"), tmp_path / "first.mcap")
    (home / "tent.obj").unlink()
    again = open_scenario(tmp_path / "first.mcap")
    execute(again, tmp_path / "again.mcap")
    first, second = (digest(open_log(tmp_path / name)) for name in ("first.mcap", "again.mcap"))
    assert first.combined == second.combined


def test_a_run_closes_its_world_however_it_ends(tmp_path: Path) -> None:
    (tmp_path / "tent.obj").write_text(MESH)
    (tmp_path / "tent.yaml").write_text(yaml.safe_dump(SCENARIO))
    built = build(tmp_path / "tent.yaml")
    client = untyped(built.simulation.environment)._id
    assert engine.isConnected(client)
    execute(built, None)
    assert not engine.isConnected(client)


def test_a_scenario_with_a_missing_mesh_is_refused_where_it_is_named(tmp_path: Path) -> None:
    (tmp_path / "tent.yaml").write_text(yaml.safe_dump(SCENARIO))
    with pytest.raises(ScenarioError) as caught:
        build(tmp_path / "tent.yaml")
    (problem,) = caught.value.problems
    assert problem.path == "environment.entities.tent.shape.mesh.file"
    assert "there is no file `tent.obj`" in problem.message


def test_no_output_of_the_engine_reaches_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "tent.obj").write_text(MESH)
    (tmp_path / "tent.yaml").write_text(yaml.safe_dump(SCENARIO))
    line = [sys.executable, "-P", "-m", "symaware_cli", "run", "tent.yaml", "--quiet"]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_without_pybullet_the_error_names_the_command_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tent.yaml").write_text(yaml.safe_dump(SCENARIO))
    for name in ("symaware_cli.worlds.spatial", "symaware_cli.worlds.bullet"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(ScenarioError) as caught:
        build(tmp_path / "tent.yaml")
    (problem,) = caught.value.problems
    assert problem.code == "missing-extra"
    assert (problem.expected or "").startswith("the extra `pybullet`: pip install 'symaware-cli[pybullet]'")
