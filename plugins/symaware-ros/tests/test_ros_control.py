"""The checks of `ros.control` before a run, and its messages on the wire."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from symaware_ros.commands import CommandError, stamp, twist
from symaware_ros.peer import Peer
from symaware_ros.peer import twist as command
from symaware_ros.rosbridge import is_loopback
from websockets.sync.server import ServerConnection, serve

import symaware_cli as sa

SCENARIO = Path(__file__).parents[1] / "examples" / "goals.yaml"
pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

DRIVE = "agents.robot.components.drive"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({f"{DRIVE}.with.url": "ws://10.0.0.1:9090"}, "is not on this machine: write `remote: true`"),
        ({f"{DRIVE}.with.url": "ws://robot.example:9090"}, "is not on this machine"),
        ({f"{DRIVE}.with.url": "http://127.0.0.1:9090"}, "it has to begin with ws://"),
        ({f"{DRIVE}.with.url": "ws://127.0.0.1:many"}, "is not that of a rosbridge"),
        ({f"{DRIVE}.with.topics.command": "/cmd_vel"}, "`topics.command` needs {agent}"),
        ({f"{DRIVE}.with.topics.command": "cmd vel"}, "a topic is like /{agent}/odom"),
        ({f"{DRIVE}.with.frames.body": "/base"}, "a frame is like {agent}/base_link"),
        ({f"{DRIVE}.run_in": "process"}, "cannot compute in a process of its own"),
        ({"agents.robot.model": {"use": "bicycle"}}, "the control input of the model is speed, steering_angle"),
        ({"agents.robot.model": {"use": "double-integrator"}}, "acceleration_x, acceleration_y"),
    ],
)
def test_invalid_settings_are_located_before_a_run(changes: Mapping[str, Any], said: str) -> None:
    if "agents.robot.model" in changes:
        states = {"bicycle": [0, 0, 0], "double-integrator": [0, 0, 0, 0]}
        changes = {**changes, "agents.robot.state": states[changes["agents.robot.model"]["use"]]}
    with pytest.raises(sa.ScenarioError) as caught:
        sa.load(SCENARIO, changes).validate()
    assert [said in problem.message for problem in caught.value.problems] == [True]


def test_another_machine_is_allowed_if_the_scenario_says_so() -> None:
    sa.load(SCENARIO, {f"{DRIVE}.with": {"url": "ws://10.0.0.1:9090", "remote": True}}).validate()


@pytest.mark.parametrize("url", ["ws://127.0.0.1:9090", "ws://[::1]:9090", "ws://localhost", "wss://127.8.8.8/bridge"])
def test_an_address_of_this_machine_is_recognised(url: str) -> None:
    assert is_loopback(url)


def test_a_run_without_a_rosbridge_fails(tmp_path: Path) -> None:
    scenario = sa.load(SCENARIO, {f"{DRIVE}.with": {"url": "ws://127.0.0.1:9", "timeout": 0.1}})
    with pytest.raises(sa.RunFailedError, match="there is no rosbridge at ws://127"):
        scenario.run(output=tmp_path / "run.mcap")


def test_a_twist_has_six_finite_numbers() -> None:
    assert twist(command(1, 2)) == [1.0, 0.0, 0.0, 0.0, 0.0, 2.0]
    broken: list[Any] = [None, [], "x", {}, {"linear": 1}, {"linear": {"x": True}}, {"linear": {"x": "1"}}]
    for content in broken:
        with pytest.raises(CommandError):
            twist(content)
    without: list[Any] = [None, {}, {"header": {"stamp": {"sec": 1.5, "nanosec": 0}}}]
    for content in without:
        with pytest.raises(CommandError):
            stamp(content)


class Listening(Peer):
    """Stores all frames that it receives."""

    def __init__(self) -> None:
        super().__init__([lambda _: command(1.0, 0.0)])
        self.said: list[Mapping[str, Any]] = []

    def __call__(self, connection: ServerConnection) -> None:
        class Heard:
            send = staticmethod(connection.send)

            def __iter__(heard) -> Iterator[str | bytes]:  # noqa: N805
                for frame in connection:
                    self.said.append(json.loads(frame))
                    yield frame

        super().__call__(Heard())  # type: ignore[arg-type] # all attributes that it uses


@pytest.fixture(scope="module")
def said() -> list[Mapping[str, Any]]:
    """The frames of a run of half a second."""
    peer = Listening()
    with serve(peer, "127.0.0.1", 0, compression=None) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        url = f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        changes = {"run.duration": 0.5, f"{DRIVE}.with": {"url": url, "frames": {"world": "odom"}}}
        sa.load(SCENARIO, changes).run(record=False)
        server.shutdown()
        thread.join()
    return peer.said


def published(said: list[Mapping[str, Any]], topic: str) -> list[Any]:
    return [each["msg"] for each in said if each["op"] == "publish" and each["topic"] == topic]


def test_topics_are_announced_before_they_are_used(said: list[Mapping[str, Any]]) -> None:
    kinds = {each["topic"]: each["type"] for each in said if each["op"] == "advertise"}
    assert kinds == {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/tf": "tf2_msgs/msg/TFMessage",
        **{f"/robot_{number}/scan": "sensor_msgs/msg/LaserScan" for number in (0, 1)},
        **{f"/robot_{number}/odom": "nav_msgs/msg/Odometry" for number in (0, 1)},
    }
    seen: set[str] = set()
    for each in said:
        if each["op"] == "publish":
            assert each["topic"] in seen
        else:
            seen.add(each["topic"])


def test_messages_have_the_fields_of_jazzy(said: list[Mapping[str, Any]]) -> None:
    types = get_typestore(Stores.ROS2_JAZZY)
    kinds = {each["topic"]: each["type"] for each in said if each["op"] == "advertise"}
    for topic, kind in kinds.items():
        for content in published(said, topic):
            assert_fits(content, kind, types)


def assert_fits(content: Any, kind: str, types: Any) -> None:
    """Check that JSON has the fields of a type, and values of their types."""
    for name, (node, detail) in types.fielddefs[kind][1]:
        value = content[name]
        if node.name == "NAME":
            assert_fits(value, detail, types)
        elif node.name == "BASE":
            expected = {"string": str, "bool": bool}.get(detail[0], float if "float" in detail[0] else int)
            assert type(value) is expected, (kind, name, value)
        else:
            inner, _ = detail
            assert isinstance(value, list)
            for each in value if inner[0].name == "NAME" else ():
                assert_fits(each, inner[1], types)
    assert len(content) == len(types.fielddefs[kind][1])


def test_the_clock_is_simulated_time(said: list[Mapping[str, Any]]) -> None:
    times = [each["clock"]["sec"] * 10**9 + each["clock"]["nanosec"] for each in published(said, "/clock")]
    assert times == [step * 50_000_000 for step in range(10)]


def test_odometry_has_the_beliefs_of_the_agent(said: list[Mapping[str, Any]]) -> None:
    first, second = published(said, "/robot_1/odom")[:2]
    assert first["header"]["frame_id"] == "odom"
    assert first["child_frame_id"] == "robot_1"
    assert first["pose"]["pose"]["position"] == {"x": 0.0, "y": 1.5, "z": 0.0}
    assert second["pose"]["pose"]["position"]["x"] == pytest.approx(0.05)
    assert second["twist"]["twist"]["linear"]["x"] == 1.0


def test_scans_have_finite_numbers_and_a_frame_on_the_body(said: list[Mapping[str, Any]]) -> None:
    scans = published(said, "/robot_1/scan")
    assert len(scans) == 3, "each is sent once"
    ranges = np.array(scans[0]["ranges"])
    assert np.isfinite(ranges).all()
    assert {*ranges[ranges > scans[0]["range_max"]]} == {5.0}
    assert 1.5 < ranges[18] < 2.5, "the crate is ahead"
    frames = {each["child_frame_id"]: each for each in published(said, "/tf")[0]["transforms"]}
    mounted = frames["robot_1/scan"]
    assert mounted["header"]["frame_id"] == "robot_1"
    assert mounted["transform"]["translation"] == {"x": 0.1, "y": 0.0, "z": 0.2}
    assert frames["robot_1"]["header"]["frame_id"] == "odom"
