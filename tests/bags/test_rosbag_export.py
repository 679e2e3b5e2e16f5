"""Runs as bags of ROS 2, read by two independent readers."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import get_types_from_msg

from symaware_cli import Log, open_log
from symaware_cli.bags.ros_names import topic_names
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views import installed_format, select

#: Without a lidar, and with one.
RUNS = {"hello": ["run.duration=2"], "floor": ["run.duration=2"]}

Messages = dict[str, list[tuple[int, Any]]]


@pytest.fixture(scope="module", params=RUNS)
def run(request: pytest.FixtureRequest, scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Path]:
    """A log, and the bag made of it."""
    folder = tmp_path_factory.mktemp("bags")
    execute(build(scenarios / f"{request.param}.yaml", RUNS[request.param], None), folder / "run.mcap")
    log = open_log(folder / "run.mcap")
    installed_format("rosbag2").export(log, folder / "bag")
    return log, folder / "bag"


@pytest.fixture(scope="module")
def read(run: tuple[Log, Path]) -> Messages:
    """Time [ns] and content of each message by topic, as `rosbags` reads them with the definitions in the bag."""
    found: Messages = defaultdict(list)
    with AnyReader([run[1]]) as reader:
        for connection, time, data in reader.messages():
            found[connection.topic].append((time, reader.deserialize(data, connection.msgtype)))
    return found


def nanoseconds(stamp: Any) -> int:
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


def test_definitions_are_those_of_jazzy(run: tuple[Log, Path]) -> None:
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    with open(run[1] / "run.mcap", "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len(summary.schemas) >= 5
    for schema in summary.schemas.values():
        assert schema.encoding == "ros2msg"
        for name, fields in get_types_from_msg(schema.data.decode(), schema.name).items():
            assert jazzy.fielddefs[name] == fields, name


def test_both_readers_find_the_same_bytes_at_the_same_times(run: tuple[Log, Path]) -> None:
    with AnyReader([run[1]]) as reader:
        ours = [(each.topic, time, bytes(data)) for each, time, data in reader.messages()]
    with open(run[1] / "run.mcap", "rb") as file:
        theirs = [
            (channel.topic, message.log_time, message.data) for _, channel, message in make_reader(file).iter_messages()
        ]
    assert sorted(ours) == sorted(theirs)


def test_poses_are_the_true_ones_of_the_log(run: tuple[Log, Path], read: Messages) -> None:
    log, _ = run
    agents = [agent for group in log.agents.values() for agent in group]
    transforms = defaultdict(list)
    for time, content in read["/tf"]:
        for each in content.transforms:
            transforms[each.child_frame_id].append((time, each))
    for agent, name in topic_names(agents).items():
        truth = log.series(agent, "world")
        odometry = read[f"/{name}/odom"]
        assert [time for time, _ in odometry] == truth.times.tolist()
        assert [nanoseconds(said.header.stamp) for _, said in odometry] == truth.times.tolist()
        poses = [said.pose.pose for _, said in odometry]
        assert [[each.position.x, each.position.y] for each in poses] == truth.values[:, :2].tolist()
        if "heading" in truth.columns:
            turned = np.array([[each.orientation.z, each.orientation.w] for each in poses])
            headings = 2.0 * np.arctan2(turned[:, 0], turned[:, 1])
            expected = truth.values[:, truth.columns.index("heading")]
            assert np.abs(np.exp(1j * headings) - np.exp(1j * expected)).max() < 1e-12
        moved = [each.transform.translation for _, each in transforms[name]]
        assert [[each.x, each.y] for each in moved] == truth.values[:, :2].tolist()


def test_speeds_are_those_that_the_world_applied(run: tuple[Log, Path], read: Messages) -> None:
    log, _ = run
    for agent, name in topic_names([agent for group in log.agents.values() for agent in group]).items():
        applied = log.series(agent, "applied_control")
        if "speed" not in applied.columns:
            continue
        said = {time: each.twist for time, each in read[f"/{name}/odom"]}
        for time, values in zip(applied.times.tolist(), applied.values, strict=True):
            assert said[time].twist.linear.x == values[applied.columns.index("speed")]
            assert said[time].covariance[0] == 0.0
        assert said[0].covariance[0] == -1.0, "nothing was applied yet"


def test_scans_are_those_of_the_log(run: tuple[Log, Path], read: Messages) -> None:
    log, _ = run
    scans = list(log.scans())
    names = topic_names([agent for group in log.agents.values() for agent in group])
    told = iter(sorted((time, topic) for topic, found in read.items() if topic.endswith("/scan") for time, _ in found))
    found = {(topic, time): content for topic in read if topic.endswith("/scan") for time, content in read[topic]}
    assert len(found) == len(scans) == len(list(told))
    for scan in scans:
        content = found[f"/{names[scan.agent]}/{scan.sensor}", scan.time]
        assert nanoseconds(content.header.stamp) == scan.measured
        assert np.array_equal(content.ranges, scan.distances.astype(np.float32), equal_nan=True)
        angles = content.angle_min + content.angle_increment * np.arange(len(scan.angles))
        assert np.abs(angles - scan.angles).max() < 1e-5
        assert content.range_max == np.float32(scan.range)


def test_plans_are_the_intents_of_the_log(run: tuple[Log, Path], read: Messages) -> None:
    log, _ = run
    for agent, name in topic_names([agent for group in log.agents.values() for agent in group]).items():
        intents = list(log.predictions(agent, "intent"))
        plans = read[f"/{name}/plan"]
        assert [time for time, _ in plans] == [intent.time for intent in intents]
        for (_, plan), intent in zip(plans, intents, strict=True):
            assert [nanoseconds(each.header.stamp) for each in plan.poses] == intent.times.tolist()
            points = [[each.pose.position.x, each.pose.position.y] for each in plan.poses]
            assert points == intent.values[:, :2].tolist()


def test_every_body_has_a_marker_in_an_existing_frame(run: tuple[Log, Path], read: Messages) -> None:
    log, _ = run
    ((_, markers),) = read["/markers"]
    frames = {
        each.child_frame_id for topic in ("/tf", "/tf_static") for _, said in read[topic] for each in said.transforms
    }
    bodies = topic_names([*(agent for group in log.agents.values() for agent in group), *log.manifest["entities"]])
    assert {each.header.frame_id for each in markers.markers} == set(bodies.values()) <= frames


def test_the_clock_ticks_at_each_instant(run: tuple[Log, Path], read: Messages) -> None:
    times = [time for time, _ in read["/clock"]]
    assert times == sorted(set(times))
    assert [nanoseconds(said.clock) for _, said in read["/clock"]] == times
    assert times[-1] == run[0].end_time


def test_a_part_of_a_log_can_be_exported(run: tuple[Log, Path], tmp_path: Path) -> None:
    log, _ = run
    selection = select(log, fields=["world"], agents=["robot.1"], start=10**9, end=int(1.5e9))
    exported = installed_format("rosbag2").export(log, tmp_path / "part", selection)
    assert {topic for topic, _, _ in exported.parts} >= {"/clock", "/tf", "/robot_1/odom"}
    assert not any("robot_0" in topic or "plan" in topic or "scan" in topic for topic, _, _ in exported.parts)
    with AnyReader([tmp_path / "part"]) as reader:
        assert reader.start_time >= 10**9
        assert reader.end_time <= 1.5e9


def test_equal_logs_give_equal_bags(run: tuple[Log, Path], tmp_path: Path) -> None:
    log, bag = run
    installed_format("rosbag2").export(log, tmp_path / "again")
    for file in ("run.mcap", "metadata.yaml"):
        assert (tmp_path / "again" / file).read_bytes() == (bag / file).read_bytes()


def test_facts_name_the_frame_of_each_body(run: tuple[Log, Path], tmp_path: Path) -> None:
    log, _ = run
    facts = installed_format("rosbag2").export(log, tmp_path / "bag").facts
    assert json.loads(json.dumps(facts["frames"]))["robot.1"] == "robot_1"
    assert facts["uneven_scans"] == 0


@pytest.mark.parametrize(
    ("ids", "names"),
    [
        (["robot.0", "robot_0"], ["robot_0", "robot_0_2"]),
        (["7"], ["body_7"]),
        (["größe", "a--b"], ["gr_e", "a_b"]),
        (["ö"], ["body"]),
    ],
)
def test_topics_have_valid_and_distinct_names(ids: list[str], names: list[str]) -> None:
    assert list(topic_names(ids).values()) == names
