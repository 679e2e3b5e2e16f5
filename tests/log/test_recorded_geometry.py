"""The geometry of a log, and the postures of bodies."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pybullet_data
import pytest
from simulating import present, untyped

from symaware_cli import open_log
from symaware_cli.assets.mesh_file import parse_mesh
from symaware_cli.core import AgentGroup, Entity, Obstacle
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.racecar import Racecar
from symaware_cli.log import geometry
from symaware_cli.log.error import LogError
from symaware_cli.log.geometry import GeometryWriter, geometry_of
from symaware_cli.log.recorder import Recorder
from symaware_cli.log.writer import LogWriter
from symaware_cli.worlds.spatial import PyBulletEnvironment

PACKAGE = Path(pybullet.__file__).parent
PACKAGE_DATA = Path(pybullet_data.getDataPath())
BOX = {"box": {"length": 0.4, "width": 0.2, "height": 0.1}}


def cars(count: int = 2) -> AgentGroup:
    states = [[0.0, 2.0 * row, 0.0, 0.0, 0.0] for row in range(count)]
    return AgentGroup("car", [f"car.{row}" for row in range(count)], Racecar(), Entity(), states)


def world(
    obstacles: Mapping[str, Any] | None = None,
    groups: Sequence[AgentGroup] | None = None,
    kind: type[ColumnEnvironment] = PyBulletEnvironment,
    folder: Path | None = None,
    **parameters: Any,
) -> ColumnEnvironment:
    environment = kind(kind.Parameters(time_step=0.05, **parameters))
    if folder:
        environment.folder = folder
    environment.initialise(groups or [cars()], {name: Obstacle(**each) for name, each in (obstacles or {}).items()}, 1)
    return environment


def recorded(path: Path, environment: ColumnEnvironment, steps: int, **options: Any) -> Iterator[int]:
    """Record some steps; yields after each instant, and gives the log in the end."""
    with environment, LogWriter(path) as writer:
        for name, (media_type, content) in GeometryWriter(environment, {}).attachments.items():
            writer.attach(name, media_type, content)
        recorder = Recorder(writer, environment, untyped(environment).groups, **options)
        for step in range(steps + 1):
            if step:
                environment.step()
            recorder.record(step * environment.time_step, step)
            yield step
        writer.finish({})


def test_the_log_has_links_where_the_engine_has_them(tmp_path: Path) -> None:
    group = cars()
    environment: Any = world(groups=[group])
    group.control_input = [[1.5, 0.3], [-1.0, -0.2]]
    told = []
    for step in recorded(tmp_path / "a.mcap", environment, 30):
        if step % 10 == 0:
            numbers = [environment._body_of[0], environment._body_of[1]]
            told.append(
                [
                    {
                        pybullet.getJointInfo(body, link, environment._id)[12].decode(): pybullet.getLinkState(
                            body, link, computeForwardKinematics=True, physicsClientId=environment._id
                        )[4:6]
                        for link in range(pybullet.getNumJoints(body, environment._id))
                    }
                    for body in numbers
                ]
            )
    log = open_log(tmp_path / "a.mcap")
    car = geometry_of(log.attachments).of("car")
    joints, poses = log.series("car", "joints"), log.series("car", "pose")
    assert car is not None
    assert list(car.joints) == log.channels["/world/car/joints"].metadata["columns"].split(",")
    for instant, bodies in zip((0, 10, 20, 30), told, strict=True):
        assert car is not None
        places, turns = car.frames(joints.values[instant])
        for row, links in enumerate(bodies):
            pose = poses.values[instant, row].tolist()
            assert car is not None
            for link, place, turned in zip(car.links[1:], places[row, 1:], turns[row, 1:], strict=True):
                found = pybullet.multiplyTransforms(pose[:3], pose[3:], place.tolist(), turned.tolist())
                assert found[0] == pytest.approx(links[link.name][0], abs=1e-6)
                assert abs(np.dot(found[1], links[link.name][1])) == pytest.approx(1.0, abs=1e-6)


def test_the_log_has_a_tumbling_box_turned_as_the_engine_has_it(tmp_path: Path) -> None:
    box = {"shape": BOX, "position": [0, 5, 1], "mass": 1.0, "turn_rate": 3.0}
    pin = {"shape": {"circle": {"radius": 0.05}}, "position": [0.15, 5, 0.05]}
    environment, told = world({"box": box, "pin": pin}), []
    for _ in recorded(tmp_path / "a.mcap", environment, 30):
        position, orientation = pybullet.getBasePositionAndOrientation(
            untyped(environment)._entities["box"], untyped(environment)._id
        )
        told += [[*position, *orientation]]
    poses = open_log(tmp_path / "a.mcap").series("box", "pose")
    np.testing.assert_array_equal(poses.values[:, 0], told)
    assert np.abs(poses.values[..., 3:5]).max() > 0.05  # it did tumble


def test_the_same_world_makes_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        for _ in recorded(tmp_path / name, world({"box": {"shape": BOX, "position": [1, 1], "mass": 1.0}}), 5):
            pass
    logs = [open_log(tmp_path / name) for name in "ab"]
    assert logs[0].attachments == logs[1].attachments
    assert next(iter(logs[0].attachments)) == "geometry.json"
    assert str(PACKAGE).encode() not in logs[0].attachments["geometry.json"]
    pairs = zip(
        *(log.messages(["/world/car/pose", "/world/car/joints", "/world/box/pose"]) for log in logs), strict=True
    )
    assert all(one.data == other.data for one, other in pairs)


def test_only_moved_entities_are_recorded(tmp_path: Path) -> None:
    still = {"shape": BOX, "position": [9, 9, 0.05], "mass": 1.0}
    environment = world({"box": still}, gravity=(0, 0, 0), ground=None, groups=[_driven()])
    for _ in recorded(tmp_path / "a.mcap", environment, 5):
        pass
    assert len(open_log(tmp_path / "a.mcap").series("box", "pose").times) == 1


def test_without_the_truth_there_are_no_postures_either(tmp_path: Path) -> None:
    for _ in recorded(
        tmp_path / "a.mcap", world({"box": {"shape": BOX, "position": [1, 1], "mass": 1.0}}), 2, omit=["world"]
    ):
        pass
    topics = open_log(tmp_path / "a.mcap").channels
    assert {topic for topic in topics if topic.startswith("/world/") and not topic.endswith("/control")} == set()


def _driven() -> AgentGroup:
    from symaware_cli.engine.models.integrator import SingleIntegrator

    return AgentGroup("robot", ["robot"], SingleIntegrator(), Entity(shape=BOX), [[0.0, 0.0]])


def test_a_world_in_a_plane_has_no_geometry() -> None:
    environment = world({"box": {"shape": BOX, "position": [1, 1]}}, [_driven()], KinematicEnvironment)
    assert GeometryWriter(environment, {}).attachments == {}
    assert environment.body_poses("robot") is None
    assert environment.joint_positions("box") is None


def test_the_height_of_upright_agents_is_recorded_once() -> None:
    with world(groups=[_driven()]) as environment:
        writer = GeometryWriter(environment, {})
        assert environment.body_poses("robot") is None
        found = geometry_of({name: data for name, (_, data) in writer.attachments.items()})
        assert found.heights == {"robot": 0.05}
        assert found.of("robot") is None  # its shape says it all


CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 2) for y in (0, 1) for z in (0, 1)) + "f 1 2 3\nf 6 7 8\n"


@pytest.fixture
def post(tmp_path: Path) -> dict[str, Any]:
    """A URDF of which one visual is the cube, enlarged, to the left; and the scenario's folder."""
    (tmp_path / "cube.obj").write_text(CUBE)
    text = """<robot name='post'><link name='a'><visual><origin xyz='0 1 0' rpy='0 0 1.5707963267948966'/>
        <geometry><mesh filename='cube.obj' scale='2 2 2'/></geometry></visual>
        <collision><geometry><box size='1 1 1'/></geometry></collision></link></robot>"""
    (tmp_path / "post.urdf").write_text(text)
    return {"shape": {"urdf": {"file": "post.urdf", "radius": 1}}, "position": [5, 5]}


def test_a_mesh_that_is_too_large_is_replaced_by_its_bounding_box_with_a_note(
    tmp_path: Path, post: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(geometry, "LARGEST", 10)
    with world({"post": post}, [_driven()], folder=tmp_path) as environment:
        writer = GeometryWriter(environment, {})
    assert list(writer.attachments) == ["geometry.json"]
    (visual,) = (
        present(geometry_of({"geometry.json": writer.attachments["geometry.json"][1]}).of("post")).links[0].visuals
    )
    assert (visual.kind, visual.size) == ("box", (4, 2, 2))
    assert visual.position == pytest.approx((-1, 3, 1))
    assert writer.notes == ["the mesh cube.obj is drawn as the box around it: it has 0.0 MiB"]


def test_a_mesh_is_stored_only_once(tmp_path: Path, post: dict[str, Any]) -> None:
    with world({"post": post}, [_driven()], folder=tmp_path) as environment:
        own = GeometryWriter(environment, {"cube.obj": CUBE.encode()})
        other = GeometryWriter(environment, {})
    assert list(own.attachments) == ["geometry.json"]
    assert b'"scenario/cube.obj"' in own.attachments["geometry.json"][1]
    assert list(other.attachments) == ["geometry.json", "geometry/cube.obj"]


def test_meshes_with_one_name_are_distinguished(tmp_path: Path, post: dict[str, Any]) -> None:
    (tmp_path / "b").mkdir()
    for name in ("post.urdf", "cube.obj"):
        (tmp_path / "b" / name).write_bytes((tmp_path / name).read_bytes())
    other = {"shape": {"urdf": {"file": "b/post.urdf", "radius": 1}}, "position": [7, 7]}
    with world({"post": post, "rest": other}, [_driven()], folder=tmp_path) as environment:
        attachments = GeometryWriter(environment, {}).attachments
    assert list(attachments) == ["geometry.json", "geometry/cube.obj", "geometry/cube-2.obj"]


@pytest.mark.parametrize(
    "change",
    [
        {"bodies": {"a": 1}},
        {"bodies": 3},
        {"articulations": [{"name": "a", "links": []}]},
        {"ground": "low"},
    ],
)
def test_invalid_geometry_is_reported(change: dict[str, Any]) -> None:
    content = {"ground": None, "bodies": {}, "heights": {}, "articulations": []} | change
    with pytest.raises(LogError, match=r"geometry.json in the log is damaged"):
        geometry_of({"geometry.json": json.dumps(content).encode()})


def test_a_collada_mesh_becomes_one_that_viewers_know(tmp_path: Path, post: dict[str, Any]) -> None:
    (tmp_path / "cube.dae").write_bytes((PACKAGE_DATA / "racecar" / "meshes" / "chassis.dae").read_bytes())
    (tmp_path / "post.urdf").write_text((tmp_path / "post.urdf").read_text().replace("cube.obj", "cube.dae"))
    with world({"post": post}, [_driven()], folder=tmp_path) as environment:
        writer = GeometryWriter(environment, {"cube.dae": (tmp_path / "cube.dae").read_bytes()})
    assert list(writer.attachments) == ["geometry.json", "geometry/cube.stl"]
    # The same body, as an STL file of the same package.
    kept = (PACKAGE_DATA / "racecar" / "meshes" / "chassis.STL").read_bytes()
    made = writer.attachments["geometry/cube.stl"][1]
    np.testing.assert_allclose(parse_mesh(made, ".stl").bounds(), parse_mesh(kept, ".stl").bounds(), atol=1e-6)


def test_a_mesh_that_viewers_cannot_draw_is_left_out_with_a_note(tmp_path: Path, post: dict[str, Any]) -> None:
    (tmp_path / "cube.ply").write_text("ply")
    (tmp_path / "post.urdf").write_text((tmp_path / "post.urdf").read_text().replace("cube.obj", "cube.ply"))
    with world({"post": post}, [_driven()], folder=tmp_path) as environment:
        writer = GeometryWriter(environment, {})
    assert list(writer.attachments) == ["geometry.json"]
    assert writer.notes[0].startswith("the mesh cube.ply is left out: viewers know no .ply files")


def test_a_body_with_an_offset_centre_of_mass_is_recorded_at_its_base(tmp_path: Path, post: dict[str, Any]) -> None:
    inertial = "<inertial><origin xyz='0 0.1 0.3'/><mass value='2'/><inertia ixx='1' iyy='1' izz='1'/></inertial>"
    text = (tmp_path / "post.urdf").read_text().replace("<link name='a'>", f"<link name='a'>{inertial}")
    (tmp_path / "post.urdf").write_text(text)
    falling = post | {"position": [1, 2, 5], "mass": 1.0}
    with world({"post": post, "falling": falling}, [_driven()], folder=tmp_path) as environment:
        writer = GeometryWriter(environment, {})
        found = geometry_of({name: data for name, (_, data) in writer.attachments.items()})
        assert found.heights["post"] == pytest.approx(0.5, abs=1e-6)  # it stands on the ground
        np.testing.assert_allclose(present(environment.body_poses("falling")), [[1, 2, 5, 0, 0, 0, 1]], atol=1e-6)
