"""Links, meshes and tumbling bodies, as Foxglove is given them."""

import pytest
from exported import export_foxglove
from foxglove_files import Messages, frames, read
from plot_logs import log_of
from scipy.spatial.transform import Rotation

from symaware_cli import Log

SCENARIO = """
symaware: 1
name: links
seed: 1
run: {duration: 0.5}
environment:
  use: pybullet
  with: {time_step: 0.05}
  entities:
    rock: {shape: {mesh: {file: rock.obj, radius: 0.4, scale: 2.0}}, position: [9, 2, 3]}
    plank: {shape: {box: {length: 0.1, width: 0.4, height: 1.0}}, position: [-5, 0, 0.5], mass: 1.0}
    ball: {shape: {circle: {radius: 0.1}}, position: [-6, 0.1, 0.9], mass: 3.0, velocity: [4, 0, 1]}
agents:
  car:
    count: 2
    model: {use: racecar}
    state: [[5, 0, 0.5, 0, 0.2], [5, 2, 0, 0, 0]]
    knowledge: {waypoints: {all: [[8, 3], [9, 0]]}}
    components:
      sense: {use: perception.self}
      steer: {use: control.pure-pursuit, with: {speed: 1.0}}
"""

#: A pyramid on a square.
ROCK = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0.5 0.5 1
f 1/1 2/2 3/3 -2
f 1 2 5
f 2 3 5
f 3 4 5
f 4 1 5
"""


@pytest.fixture(scope="module")
def links(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Messages]:
    folder = tmp_path_factory.mktemp("links")
    (folder / "rock.obj").write_text(ROCK)
    log = log_of(folder, SCENARIO)
    export_foxglove(log, folder / "foxglove.mcap")
    return log, read(folder / "foxglove.mcap")


def test_links_move_with_their_bodies_as_their_joints_stand(links: tuple[Log, Messages]) -> None:
    log, messages = links
    time, turned = messages["/tf/car/links"][-1]
    joints, names = log.series("car", "joints"), log.channels["/world/car/joints"].metadata["columns"].split(",")
    assert time == joints.times[-1]
    parent, at, rotation = frames(turned)["car.0/left_steering_hinge"]
    assert parent == "car.0"
    assert at == pytest.approx([0.325, 0.1, 0.05], abs=1e-6)
    angle = joints.values[-1, 0, names.index("left_steering_hinge_joint")]
    hung = Rotation.from_euler("y", 1.5708) * Rotation.from_rotvec([-angle, 0, 0])
    assert (rotation * hung.inv()).magnitude() < 1e-6


def test_a_vehicle_has_all_its_links_and_each_a_frame_that_is_said(links: tuple[Log, Messages]) -> None:
    _, messages = links
    ((_, update),) = messages["/models/car"]
    shown = {made.frame_id for made in update.entities}
    assert len(shown) == 2 * 9  # chassis, four wheels, two hinges, lidar, camera
    assert shown == set(frames(messages["/tf/car/links"][0][1]))
    assert all(made.frame_locked for made in update.entities)
    chassis = next(made for made in update.entities if made.frame_id == "car.0/chassis")
    assert len(chassis.triangles[0].indices) == 3 * 324  # of the STL file
    assert (chassis.triangles[0].color.b, chassis.triangles[0].color.r) == pytest.approx((0.8, 0.0))


def test_bodies_lie_as_the_log_has_them(links: tuple[Log, Messages]) -> None:
    log, messages = links
    poses = log.series("plank", "pose")
    assert [time for time, _ in messages["/tf/plank"]] == poses.times.tolist()
    for (_, message), pose in zip(messages["/tf/plank"], poses.values, strict=True):
        _, at, rotation = frames(message)["plank"]
        assert at == pytest.approx(pose[:3])
        assert (rotation * Rotation.from_quat(pose[3:]).inv()).magnitude() < 1e-6


def test_a_mesh_is_triangles_of_its_size(links: tuple[Log, Messages]) -> None:
    _, messages = links
    ((_, scenery),) = messages["/scenery"]
    rock = next(made for made in scenery.entities if made.id == "rock")
    (surface,) = rock.triangles
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (1, 1, 2)]
    assert [(point.x, point.y, point.z) for point in surface.points] == corners
    assert list(surface.indices) == [0, 1, 2, 0, 2, 3, 0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4]


def test_a_ring_shows_who_a_vehicle_is(links: tuple[Log, Messages]) -> None:
    _, messages = links
    bodies = messages["/bodies/car"][0][1].entities
    assert [len(made.lines) for made in bodies] == [1, 1]
    assert bodies[0].lines[0].color != bodies[1].lines[0].color
