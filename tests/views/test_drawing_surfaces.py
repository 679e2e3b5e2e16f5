"""Meshes, links and tumbling bodies are in a replay as in the world, from the log alone."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
from plot_logs import log_of
from rerun_files import Recording, saved
from scipy.spatial.transform import Rotation
from simulating import present

from symaware_cli import Log
from symaware_cli.log.geometry import geometry_of
from symaware_cli.views.views import run_view_of

TETRAHEDRON = """v 0 0 0
v 0.4 0 0
v 0 0.4 0
v 0 0 0.4
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""

SCENARIO = """
symaware: 1
name: surfaces
seed: 1
run: {duration: 0.6}
environment:
  use: pybullet
  with: {time_step: 0.05}
  entities:
    rock: {shape: {mesh: {file: rock.obj, radius: 0.4, scale: 2.0}}, position: [1, 2, 3], heading: 0.5}
    stone: {shape: {mesh: {file: rock.obj, radius: 0.4, scale: 2.0}}, position: [3, 2, 0]}
    post: {shape: {cylinder: {radius: 0.2, height: 1.5}}, position: [-1, 0]}
    tank: {shape: {cylinder: {radius: 0.2, height: 1.5}}, position: [-3, 0, 4]}
    plank: {shape: {box: {length: 0.1, width: 0.4, height: 1.0}}, position: [-5, 0, 0.5], mass: 1.0}
    ball: {shape: {circle: {radius: 0.1}}, position: [-6, 0.1, 0.9], mass: 3.0, velocity: [4, 0, 1]}
agents:
  drone:
    model: {use: quadrotor}
    state: [[0, 0, 1, 0.1, -0.2, 0.3, 0, 0, 0, 0, 0, 0]]
    components:
      sense: {use: perception.self}
  car:
    count: 2
    model: {use: racecar}
    state: [[5, 0, 0.5, 0, 0.2], [5, 2, 0, 0, 0]]
    components:
      sense: {use: perception.self}
      steer: {use: control.pure-pursuit, with: {speed: 1.0}}
    knowledge: {waypoints: {all: [[8, 3], [9, 0]]}}
  truck:
    model: {use: racecar}
    state: [[5, -4, 0, 0, 0]]
    components: {sense: {use: perception.self}}
"""

CAR = "/world/figures/racecar"


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Log:
    folder = tmp_path_factory.mktemp("surfaces")
    (folder / "rock.obj").write_text(TETRAHEDRON)
    log = log_of(folder, SCENARIO)
    (folder / "rock.obj").unlink()
    return log


@pytest.fixture(scope="module")
def recording(logged: Log, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return saved(logged, tmp_path_factory.mktemp("recording"))


def entity(recording: Recording, beginning: str) -> str:
    """The only Rerun entity with such a path, whose last part is a number."""
    (found,) = (name for name in recording.entities if name.startswith(beginning))
    return found


def test_a_mesh_is_that_of_the_file_which_the_log_brings_along_once_for_all_that_look_like_it(
    recording: Recording,
) -> None:
    rock = entity(recording, "/world/figures/mesh")
    (blob,) = recording.static(rock, "Asset3D:blob")
    assert bytes(blob).decode() == TETRAHEDRON
    assert recording.values(rock, "InstancePoses3D:scales")[0] == [[2.0, 2.0, 2.0]] * 2
    assert recording.values(rock, "InstancePoses3D:translations")[0] == [[1, 2, 3], [3, 2, 0]]
    assert recording.values(rock, "InstancePoses3D:quaternions")[0][0] == pytest.approx(
        [0, 0, np.sin(0.25), np.cos(0.25)]
    )


def test_each_mesh_of_a_vehicle_is_there_once_however_many_groups_drive_it(recording: Recording) -> None:
    cars = [name for name, component in recording.rows if component == "Asset3D:blob" and name.startswith(CAR)]
    assert len(cars) == len(set(cars)) == 8  # chassis, lidar, two hinges, four wheels
    assert all(len(recording.values(name, "InstancePoses3D:translations")[0]) == 3 for name in cars)
    with open(f"{pybullet_data.getDataPath()}/racecar/meshes/chassis.STL", "rb") as file:
        chassis = entity(recording, next(name for name in cars if "/chassis/" in name))
        assert bytes(recording.static(chassis, "Asset3D:blob")[0]) == file.read()


def test_wheels_and_hinges_are_where_their_joints_turned_them(logged: Log, recording: Recording) -> None:
    joints, pose = logged.series("car", "joints"), logged.series("car", "pose")
    columns = logged.channels["/world/car/joints"].metadata["columns"].split(",")
    turned = joints.values[..., columns.index("left_steering_hinge_joint")]
    assert np.abs(turned).max() > 0.1
    wheel = next(name for name in recording.entities if "racecar" in name and "/left_front_wheel/" in name)
    hinge = next(name for name in recording.entities if "racecar" in name and "/left_steering_hinge/" in name)
    for name in (wheel, hinge):
        places = np.array(recording.values(name, "InstancePoses3D:translations"))[:, :2]
        base = Rotation.from_quat(pose.values[..., 3:].reshape(-1, 4)).apply([0.325, 0.1, 0.05])
        np.testing.assert_allclose(places, pose.values[..., :3] + base.reshape(-1, 2, 3), atol=2e-6)
    orientations = np.array(recording.values(hinge, "InstancePoses3D:quaternions"))[:, 0]
    # The hinge of the file stands on its side, and turns about its -x axis, which points up.
    hung = Rotation.from_euler("y", 1.5708) * Rotation.from_rotvec(turned[:, :1] * [[-1.0, 0.0, 0.0]])
    expected = Rotation.from_quat(pose.values[:, 0, 3:]) * hung
    assert (Rotation.from_quat(orientations) * expected.inv()).magnitude().max() < 1e-6


def test_a_box_that_tips_over_tips_over_in_the_replay(logged: Log, recording: Recording) -> None:
    poses = logged.series("plank", "pose")
    plank = entity(recording, "/world/scenery/plank/box")
    times = recording.times(plank, "InstancePoses3D:quaternions")
    turned = np.array(recording.values(plank, "InstancePoses3D:quaternions"))[:, 0]
    rows = np.searchsorted(poses.times, times, side="right") - 1
    np.testing.assert_allclose(turned, poses.values[rows, 3:], atol=1e-6)
    upright = Rotation.from_quat(turned[-1]).apply([0, 0, 1])
    assert upright[2] < 0.99


def test_a_quadrotor_leans_as_its_state_says(logged: Log, recording: Recording) -> None:
    assert "/world/drone/pose" not in logged.channels
    state = logged.series("drone", "world").values
    (body,) = (
        name for name in recording.entities if name.startswith("/world/figures/crazyflie") and name.endswith("/0")
    )
    turned = Rotation.from_quat(np.array(recording.values(body, "InstancePoses3D:quaternions"))[:, 0])
    expected = Rotation.from_euler("ZYX", state[:, 5:2:-1])
    assert (turned * expected.inv()).magnitude().max() < 1e-5


@pytest.mark.parametrize(("name", "low", "high"), [("post", 0.0, 1.5), ("tank", 3.25, 4.75)])
def test_bodies_without_a_height_stand_on_the_ground_and_others_around_their_middle(
    recording: Recording, name: str, low: float, high: float
) -> None:
    path = entity(recording, f"/world/scenery/{name}/")
    ((place,),) = recording.values(path, "InstancePoses3D:translations")
    heights = np.array(recording.static(path, "Mesh3D:vertex_positions"))[:, 2] + place[2]
    assert (heights.min(), heights.max()) == pytest.approx((low, high))


def test_a_log_is_replayed_where_neither_the_engine_nor_its_files_are(logged: Log, tmp_path: Path) -> None:
    log = shutil.copy(logged.path, tmp_path / "a.mcap")
    program = f"""
import sys
sys.modules["pybullet"] = sys.modules["pybullet_data"] = None
from symaware_cli import open_log
from symaware_cli.views.replay_session import replay_session
from pathlib import Path
replay_session(open_log({str(log)!r})).save(Path({str(tmp_path / "b.rrd")!r}))
"""
    subprocess.run([sys.executable, "-c", program], check=True, cwd=tmp_path)
    assert (tmp_path / "b.rrd").stat().st_size > 700_000  # what the racecar looks like


def test_the_geometry_that_was_written_is_read(logged: Log) -> None:
    geometry = geometry_of(logged.attachments)
    assert geometry.of("car") is geometry.of("truck")
    assert geometry.of("rock") is geometry.of("stone")
    assert [visual.mesh for visual in present(geometry.of("rock")).links[0].visuals] == ["scenario/rock.obj"]
    assert geometry.heights["post"] == 0.75
    assert geometry.ground == 0.0


TROLLEY = """<robot name='trolley'><link name='base'>
  <visual><origin xyz='1 0 0'/><geometry><mesh filename='rock.obj'/></geometry></visual>
  <visual><origin xyz='0 1 0'/><geometry><mesh filename='rock.obj'/></geometry></visual>
  <visual><geometry><mesh filename='rock.obj' scale='3 3 3'/></geometry></visual></link></robot>"""


def test_parts_of_a_body_that_look_the_same_are_there_once(tmp_path: Path) -> None:
    (tmp_path / "rock.obj").write_text(TETRAHEDRON)
    (tmp_path / "trolley.urdf").write_text(TROLLEY)
    entities = "{a: {shape: {urdf: {file: trolley.urdf, radius: 1}}, position: [5, 5, 1]}}"
    text = f"""symaware: 1
name: trolley
run: {{duration: 0.1}}
environment: {{use: pybullet, entities: {entities}}}
agents: {{r: {{model: {{use: single-integrator}}, state: [0, 0]}}}}
"""
    recording = saved(log_of(tmp_path, text), tmp_path)
    meshes = [name for name, component in recording.rows if component == "Asset3D:blob"]
    small, large = sorted(meshes)
    assert recording.values(small, "InstancePoses3D:translations") == [[[6, 5, 1], [5, 6, 1]]]
    assert recording.values(large, "InstancePoses3D:scales") == [[[3, 3, 3]]]


def test_a_ring_goes_around_each_vehicle_in_its_colour(logged: Log, recording: Recording) -> None:
    run_view = run_view_of(logged)
    centres = np.array(recording.values("/world/agents/car/body", "Cylinders3D:centers"))
    assert centres.shape[1:] == (2, 3)
    ahead = np.linalg.norm(centres[0, :, :2] - logged.series("car", "pose").values[0, :, :2], axis=-1)
    assert ahead == pytest.approx([0.1625, 0.1625], abs=0.02)  # half of the wheelbase
    packed = recording.values("/world/agents/car/body", "Cylinders3D:colors")[0]
    assert [colour >> 8 for colour in packed] == [
        int.from_bytes(bytes(own)) for own in run_view.group_views["car"].colours
    ]


def test_the_eye_of_an_agents_tab_has_something_to_follow(recording: Recording) -> None:
    assert recording.static("/as/car.0/place", "Points3D:positions") == [[0.0, 0.0, 0.0]]


def test_a_world_of_space_is_one_however_its_agents_move(tmp_path: Path) -> None:
    log = log_of(tmp_path, "three-worlds.yaml", "environment.use=pybullet", "run.duration=0.1")
    run_view = run_view_of(log)
    assert run_view.is_spatial
    assert run_view.ground == 0.0
    assert [run_view.group_views[name].height for name in ("cart", "disc", "puck")] == [0.2, 0.3, 0.2]
    assert run_view.obstacle_views["crate"].position.tolist() == [0.0, -4.0, 0.5]
    assert run_view.obstacle_views["crate"].corners[:, 2].max() == pytest.approx(1.0)
