"""What sensors measured is in the log, and can be read and seen again."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image as Picture
from rerun_files import saved
from simulating import STEP, Team, simulate, simulation

from symaware_cli import Entity, Obstacle, open_log
from symaware_cli.components.perception_camera import Camera
from symaware_cli.components.perception_lidar import Lidar
from symaware_cli.environments.spatial import PyBulletEnvironment
from symaware_cli.models.unicycle import Unicycle
from symaware_cli.recording import png

STEPS = 3


def teams():
    components = {
        "scan": lambda: Lidar(Lidar.Parameters(rays=180, range=5.0, noise=0.01, dropout=0.1)),
        "eye": lambda: Camera(Camera.Parameters(width=32, height=24)),
    }
    disc = Entity(shape={"cylinder": {"radius": 0.2, "height": 1.0}})
    states = [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    return {"robot": Team(components, 2, states, model=Unicycle(), entity=disc)}


def world():
    crate = {"shape": {"box": {"length": 1.0, "width": 1.0, "height": 1.0}}, "position": [3, 0]}
    environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=STEP / 1e9))
    return {"environment": environment, "obstacles": {"crate": Obstacle.model_validate(crate)}}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("sensing") / "sensing.mcap"
    simulate(teams(), STEPS, path, **world())
    return path


@pytest.fixture(scope="module")
def readings():
    """The first readings of the same run."""
    ready = simulation(teams(), **world())
    ready.initialise()
    for slot in ready.slots:
        for component in slot.components:
            component.compute_and_update()
    return ready.groups[0].awareness.readings


def test_scans_are_as_they_were_measured(path, readings):
    logged = list(open_log(path).scans())
    assert [(scan.time, scan.agent, scan.sensor) for scan in logged[:2]] == [
        (0, "robot.0", "scan"),
        (0, "robot.1", "scan"),
    ]
    for scan, distances, pose in zip(logged, readings["scan"].distances, readings["scan"].poses, strict=False):
        np.testing.assert_array_equal(scan.distances, distances.astype(np.float32))
        np.testing.assert_array_equal(scan.angles, readings["scan"].angles)
        np.testing.assert_array_equal(scan.pose, pose)


def test_points_of_a_scan_lie_on_what_was_met(path):
    points = next(open_log(path).scans()).points
    crate = points[points[:, 0] > 2.0]
    assert len(crate) >= 2
    np.testing.assert_allclose(crate[:, 0], 2.5, atol=0.1)


def test_images_are_as_they_were_taken(path, readings):
    logged = [image for image in open_log(path).images() if image.time == 0 and image.agent == "robot.0"]
    assert [image.kind for image in logged] == ["COLOUR", "DEPTH", "SEGMENTS"]
    seen = readings["eye"].images[0]
    np.testing.assert_array_equal(logged[0].pixels, seen.colour)
    near = seen.depth < 65.0
    np.testing.assert_allclose(logged[1].pixels[near], seen.depth[near], atol=1e-3)
    assert np.isinf(logged[1].pixels[np.isinf(seen.depth)]).all()
    np.testing.assert_array_equal(logged[2].pixels, seen.segments)


def test_equal_runs_have_equal_logs(path, tmp_path):
    again = tmp_path / "again.mcap"
    simulate(teams(), STEPS, again, **world())

    def sensed(path):
        log = open_log(path)
        topics = [topic for topic in log.channels if "/scan/" in topic or "/image/" in topic]
        return [(message.channel.topic, message.time, message.data) for message in log.messages(topics)]

    assert sensed(path) == sensed(again)
    assert len(sensed(path)) >= STEPS


def test_a_replay_shows_points_and_images(path, tmp_path):
    log = open_log(path)
    recording = saved(log, tmp_path)
    scans = [scan for scan in log.scans() if scan.time == 0]
    # Those whose agents keep to a plane are drawn in it.
    points = np.concatenate([scan.points for scan in scans]) * [1, 1, 0]
    drawn = recording.values("/world/agents/robot/scan/scan", "Points3D:positions")[0]
    np.testing.assert_allclose(np.array(drawn), points, atol=1e-5)
    own = recording.values("/as/robot.1/scan/scan", "Points3D:positions")[0]
    np.testing.assert_allclose(np.array(own), scans[1].points * [1, 1, 0], atol=1e-5)
    image = next(image for image in log.images() if image.agent == "robot.1")
    (blob,) = recording.values("/cameras/robot.1/eye/colour", "EncodedImage:blob")[0]
    assert bytes(blob) == image.data
    assert "/world/agents/robot/camera/eye/robot.0" in recording.entities


colours = arrays.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3)))
greys = arrays.arrays(np.uint16, st.tuples(st.integers(1, 9), st.integers(1, 9)))


@given(st.one_of(colours, greys))
def test_images_are_png_that_others_read(pixels):
    encoded = png.encode(pixels)
    np.testing.assert_array_equal(png.decode(encoded), pixels)
    np.testing.assert_array_equal(np.array(Picture.open(io.BytesIO(encoded))), pixels)


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n", png.encode(np.zeros((2, 2), np.uint16))[:50]])
def test_what_is_no_image_is_refused(data):
    with pytest.raises(ValueError, match="PNG"):
        png.decode(data)
