"""Measurements of sensors are in the log, and can be read and shown."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray
from PIL import Image as Picture
from rerun_files import saved
from sensing_log import STEPS, teams, world, write_sensing
from simulating import STEP, present, simulation, untyped

from symaware_cli import open_log
from symaware_cli.engine.components.perception_contact import ContactSensor
from symaware_cli.engine.components.perception_imu import InertialUnit
from symaware_cli.log import png
from symaware_cli.log.error import UnknownNameError
from symaware_cli.log.group_channels import GroupChannels
from symaware_cli.log.writer import LogWriter, Message
from symaware_cli.views.views import run_view_of


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sensing(tmp_path_factory.mktemp("sensing") / "sensing.mcap")


@pytest.fixture(scope="module")
def readings() -> dict[str, Any]:
    """The first readings of the same run."""
    ready = simulation(teams(), **world())
    ready.initialise()
    for entry in ready.entries:
        for component in entry.components:
            component.compute_and_update()
    awareness = ready.groups[0].awareness
    return {**awareness.readings, **{name: awareness[name] for name in awareness.signals}}


def test_scans_are_as_they_were_measured(path: Path, readings: dict[str, Any]) -> None:
    logged = list(open_log(path).scans())
    assert [(scan.time, scan.agent, scan.sensor) for scan in logged[:2]] == [
        (0, "robot.0", "scan"),
        (0, "robot.1", "scan"),
    ]
    for scan, distances, pose in zip(logged, readings["scan"].distances, readings["scan"].poses, strict=False):
        np.testing.assert_array_equal(scan.distances, distances.astype(np.float32))
        np.testing.assert_array_equal(scan.angles, readings["scan"].angles)
        np.testing.assert_array_equal(scan.pose, pose)


def test_points_of_a_scan_lie_on_the_bodies_that_were_hit(path: Path) -> None:
    points = next(open_log(path).scans()).points
    crate = points[points[:, 0] > 2.0]
    assert len(crate) >= 2
    np.testing.assert_allclose(crate[:, 0], 2.5, atol=0.1)


def test_images_are_as_they_were_taken(path: Path, readings: dict[str, Any]) -> None:
    logged = [image for image in open_log(path).images() if image.time == 0 and image.agent == "robot.0"]
    assert [image.kind for image in logged] == ["COLOUR", "DEPTH", "SEGMENTS"]
    seen = readings["eye"].images[0]
    np.testing.assert_array_equal(logged[0].pixels, seen.colour)
    near = seen.depth < 65.0
    np.testing.assert_allclose(logged[1].pixels[near], seen.depth[near], atol=1e-3)
    assert np.isinf(logged[1].pixels[np.isinf(seen.depth)]).all()
    np.testing.assert_array_equal(logged[2].pixels, seen.segments)


@pytest.mark.parametrize(("sensor", "width"), [("bumper", 2), ("inertia", 6)])
def test_numbers_are_a_series_by_the_name_of_their_sensor(
    path: Path, readings: dict[str, Any], sensor: str, width: int
) -> None:
    log = open_log(path)
    together, alone = log.series("robot", sensor), log.series("robot.1", sensor)
    assert together.times.tolist() == alone.times.tolist() == [0, STEP, 2 * STEP]
    assert together.values.shape == (STEPS, 2, width)
    (signal,) = {"bumper": ContactSensor, "inertia": InertialUnit}[sensor].signals
    assert list(zip(together.columns, together.units, strict=True)) == [*present(signal.columns)]
    np.testing.assert_array_equal(together.values[0], readings[sensor])
    np.testing.assert_array_equal(together.values[:, 1], alone.values)


def test_a_missed_reading_is_not_a_number_where_it_was_missed(path: Path) -> None:
    values = open_log(path).series("robot", "inertia").values
    missed = np.isnan(values)
    assert 0 < missed.sum() < missed.size
    assert (missed.all(axis=2) == missed.any(axis=2)).all()


def test_readings_are_selected_by_agent_and_time(path: Path) -> None:
    log = open_log(path)
    for read in (log.scans, log.images):
        everybody = [(each.agent, each.time) for each in read()]
        assert {agent for agent, _ in everybody} == {"robot.0", "robot.1"}
        assert [(each.agent, each.time) for each in read("robot")] == everybody
        own = [(agent, time) for agent, time in everybody if agent == "robot.1" and STEP <= time < 2 * STEP]
        assert own == [(each.agent, each.time) for each in read("robot.1", STEP, 2 * STEP)]
        assert own
        with pytest.raises(UnknownNameError, match="has no agent, group or entity 'robott'"):
            read("robott")


def test_an_unknown_sensor_is_refused(path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"no field .inerita.; there are applied_control, bumper") as refusal:
        open_log(path).series("robot.0", "inerita")
    assert "inertia" in refusal.value.known


def test_each_part_of_a_distributed_run_has_readings_of_its_agents(tmp_path: Path) -> None:
    ready = simulation(teams(), **world())
    writer = LogWriter(tmp_path / "part.mcap")
    with ready.environment, writer:
        ready.initialise()
        for entry in ready.entries:
            for component in entry.components:
                component.compute_and_update()
        (group,) = ready.groups
        manifest = {"format": 1, "groups": {"robot": {"agents": list(group.ids)}}, "entities": {}, "roster": []}
        writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
        channels = GroupChannels(writer, ready.environment, group, (), [1])
        messages: list[Message] = []
        channels.record(0, 0, messages)
        writer.add_all(0, messages)
        writer.finish({})
    log = open_log(tmp_path / "part.mcap")
    (scan,) = log.scans()
    assert scan.agent == "robot.1"
    np.testing.assert_array_equal(scan.pose, untyped(group.awareness.readings["scan"]).poses[1])
    assert [image.agent for image in log.images()] == ["robot.1"] * 3
    felt = log.series("robot", "inertia").values[0]
    np.testing.assert_array_equal(felt[1], group.awareness["inertia"][1])
    assert np.isnan(felt[0]).all()


def test_equal_runs_have_equal_logs(path: Path, tmp_path: Path) -> None:
    again = write_sensing(tmp_path / "again.mcap")

    def sensed(path: Path) -> list[tuple[str, int, bytes]]:
        log = open_log(path)
        topics = [topic for topic in log.channels if topic.count("/") == 4]
        return [(message.channel.topic, message.time, message.data) for message in log.messages(topics)]

    assert sensed(path) == sensed(again)
    assert len({topic for topic, _, _ in sensed(path)}) == 4


def test_a_replay_shows_points_and_images(path: Path, tmp_path: Path) -> None:
    log = open_log(path)
    recording = saved(log, tmp_path)
    scans = [scan for scan in log.scans() if scan.time == 0]
    # In a world of a plane they are drawn in it.
    flat = [1, 1, float(run_view_of(log).is_spatial)]
    points = np.concatenate([scan.points for scan in scans]) * flat
    drawn = recording.values("/world/agents/robot/scan/scan", "Points3D:positions")[0]
    np.testing.assert_allclose(np.array(drawn), points, atol=1e-5)
    own = recording.values("/as/robot.1/scan/scan", "Points3D:positions")[0]
    np.testing.assert_allclose(np.array(own), scans[1].points * flat, atol=1e-5)
    image = next(image for image in log.images() if image.agent == "robot.1")
    (blob,) = recording.values("/cameras/robot.1/eye/colour", "EncodedImage:blob")[0]
    assert bytes(blob) == image.data
    assert "/world/agents/robot/camera/eye/robot.0" in recording.entities


def test_a_replay_has_a_curve_for_each_column_in_panels_by_unit(path: Path, tmp_path: Path) -> None:
    recording = saved(open_log(path), tmp_path)
    inertia = open_log(path).series("robot.1", "inertia").values
    for number, columns in enumerate((slice(0, 3), slice(3, 6))):
        drawn = recording.values(f"/curves/agents/robot.1/measurement/inertia/{number}", "Scalars:scalars")
        np.testing.assert_array_equal(np.array(drawn), inertia[:, columns])
    names = recording.static("/curves/agents/robot.1/measurement/inertia/0", "SeriesLines:names")
    assert list(names) == ["acceleration_x", "acceleration_y", "acceleration_z"]
    assert "/curves/agents/robot.0/measurement/bumper/1" in recording.entities


def test_a_replay_from_the_middle_shows_no_earlier_scan(path: Path, tmp_path: Path) -> None:
    log = open_log(path)
    recording = saved(log, tmp_path, start=2 * STEP)
    drawn = recording.values("/world/agents/robot/scan/scan", "Points3D:positions")
    last = [scan for scan in log.scans() if scan.time == 2 * STEP]
    assert [len(points) for points in drawn] == [sum(len(scan.points) for scan in last)]


colours = arrays.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3)))
greys = arrays.arrays(np.uint16, st.tuples(st.integers(1, 9), st.integers(1, 9)))


@given(st.one_of(colours, greys))
def test_images_are_png_that_others_read(pixels: NDArray[Any]) -> None:
    encoded = png.encode(pixels)
    np.testing.assert_array_equal(png.decode(encoded), pixels)
    np.testing.assert_array_equal(np.array(Picture.open(io.BytesIO(encoded))), pixels)


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n", png.encode(np.zeros((2, 2), np.uint16))[:50]])
def test_anything_but_an_image_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="PNG"):
        png.decode(data)
