"""Recorded motions as bodies of a scenario, from bags and from logs."""

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from symaware_cli import Log, open_log
from symaware_cli.assets import AssetFolders
from symaware_cli.bags import bag as bag_module
from symaware_cli.bags.bag import Bag
from symaware_cli.bags.bag_error import BagError
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError

BODY = {"shape": {"circle": {"radius": 0.3}}}

Place = Callable[..., Path]


@pytest.fixture
def scenario(tmp_path: Path, recorded: Path) -> Place:
    """Write a scenario with recordings beside copies of the recorded files."""

    def write(recordings: dict[str, Any], **environment: Any) -> Path:
        for name in ("floor.mcap", "bag.db3"):
            shutil.copy(recorded / name, tmp_path / name)
        shutil.copytree(recorded / "bag", tmp_path / "bag", dirs_exist_ok=True)
        document = {
            "symaware": 1,
            "name": "street",
            "run": {"duration": 2.0},
            "environment": {"use": "kinematic", "with": {"time_step": 0.05}, **environment},
            "recordings": recordings,
            "agents": {"robot": {"model": {"use": "unicycle"}, "state": [0, -20, 0], "entity": {"shape": None}}},
        }
        path = tmp_path / "street.yaml"
        path.write_text(yaml.safe_dump(document), encoding="utf-8")
        return path

    return write


def run(path: Path) -> Log:
    log = path.with_suffix(".run.mcap")
    execute(build(path, [], None), log)
    return open_log(log)


def problems(path: Path) -> list[str]:
    with pytest.raises(ScenarioError) as refused:
        build(path, [], None)
    return [f"{each.span.line if each.span else ''}: {each.message}" for each in refused.value.problems]


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("bag", {"topic": "/robot_1/odom"}),
        ("bag/run.mcap", {"frame": "robot_1"}),
        ("bag.db3", {"topic": "/robot_1/odom"}),
        ("bag.db3", {"frame": "robot_1"}),
        ("floor.mcap", {"agent": "robot.1"}),
    ],
)
def test_a_body_moves_as_it_was_recorded(scenario: Place, recorded: Path, file: str, source: dict[str, str]) -> None:
    moved = run(scenario({"past": {"file": file, "bodies": {"van": {**BODY, **source}}}})).series("van", "world")
    truth = open_log(recorded / "floor.mcap").series("robot.1", "world")
    assert moved.times.tolist() == truth.times[: len(moved.times)].tolist()
    count = len(moved.times)
    assert count > 30
    assert np.abs(moved.values[:, :2] - truth.values[:count, :2]).max() < 1e-12
    assert np.abs(np.exp(1j * moved.values[:, 2]) - np.exp(1j * truth.values[:count, 2])).max() < 1e-12


def test_a_recording_begins_at_its_start_in_the_scenario_and_rests_before(scenario: Place, recorded: Path) -> None:
    past = {"file": "bag", "start": 1.0, "bodies": {"van": {**BODY, "topic": "/robot_1/odom"}}}
    moved = run(scenario({"past": past})).series("van", "world")
    truth = open_log(recorded / "floor.mcap").series("robot.1", "world")
    places = dict(zip(truth.times.tolist(), truth.values[:, :2], strict=True))
    assert moved.times[-1] > 1.9e9
    for time, values in zip(moved.times.tolist(), moved.values, strict=True):
        assert np.abs(values[:2] - places[max(0, time - 10**9)]).max() < 1e-9


def test_the_log_has_the_recording(scenario: Place, tmp_path: Path) -> None:
    log = run(scenario({"past": {"file": "bag", "bodies": {"van": {**BODY, "topic": "/robot_1/odom"}}}}))
    for name in ("bag/run.mcap", "bag/metadata.yaml"):
        assert log.attachments[f"scenario/{name}"] == (tmp_path / name).read_bytes()


@pytest.mark.parametrize(
    ("recording", "said"),
    [
        ({"file": "bag", "bodies": {"van": {**BODY, "topic": "/robot_1/odo"}}}, "did you mean `/robot_1/odom`"),
        ({"file": "bag", "bodies": {"van": {**BODY, "topic": "/robot_1/scan"}}}, "are sensor_msgs/msg/LaserScan"),
        ({"file": "bag", "bodies": {"van": {**BODY, "frame": "tram"}}}, "no frame `tram` is on /tf"),
        ({"file": "floor.mcap", "bodies": {"van": {**BODY, "agent": "robot.77"}}}, "no agent, group or entity"),
        ({"file": "bag/run.mcap", "bodies": {"van": {**BODY, "agent": "robot.1"}}}, "was not written by SymAware"),
        ({"file": "none", "bodies": {"van": {**BODY, "topic": "/a"}}}, "there is no file `none`"),
        ({"file": "street.yaml", "bodies": {"van": {**BODY, "topic": "/a"}}}, "neither .mcap nor .db3"),
        ({"file": "bag", "bodies": {"van": {**BODY, "topic": "/a", "frame": "b"}}}, "exactly one of"),
    ],
)
def test_unusable_recordings_are_refused_at_their_place(scenario: Place, recording: dict[str, Any], said: str) -> None:
    (problem,) = problems(scenario({"past": recording}))
    assert said in problem
    assert problem[0].isdigit()


def test_a_bag_that_is_too_large_is_not_opened(scenario: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bag_module, "MOST_BYTES", 1000)
    (problem,) = problems(scenario({"past": {"file": "bag", "bodies": {"van": {**BODY, "topic": "/robot_1/odom"}}}}))
    assert "are read: take the topics out" in problem


def test_a_damaged_bag_is_refused(scenario: Place, tmp_path: Path) -> None:
    path = scenario({"past": {"file": "bag", "bodies": {"van": {**BODY, "topic": "/robot_1/odom"}}}})
    content = (tmp_path / "bag" / "run.mcap").read_bytes()
    (tmp_path / "bag" / "run.mcap").write_bytes(content[: len(content) // 3])
    (problem,) = problems(path)
    assert "the log breaks off" in problem


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"SQLite format 3\0" + bytes(4000), "damaged"), (b"nothing", "no SQLite database"), (b"", "no SQLite database")],
)
def test_files_that_are_no_database_are_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "bag.db3").write_bytes(content)
    with pytest.raises(BagError, match=said):
        Bag("bag.db3", AssetFolders(tmp_path))


def test_a_database_of_something_else_is_refused(tmp_path: Path) -> None:
    connection = sqlite3.connect(tmp_path / "bag.db3")
    connection.execute("CREATE TABLE topics (id INTEGER)")
    connection.execute("CREATE VIEW messages AS SELECT 1")
    connection.commit()
    connection.close()
    with pytest.raises(BagError, match="no tables `topics` and `messages`"):
        Bag("bag.db3", AssetFolders(tmp_path))


def written(folder: Path, stamps: list[tuple[int, int]], turned: float = 1.0, frames: str = "mm") -> None:
    """Write a bag of poses, each with a stamp and a time of recording [ns]."""
    store = get_typestore(Stores.ROS2_JAZZY)
    make = store.types
    with Writer(folder / "poses", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kind = "geometry_msgs/msg/PoseStamped"
        connection = writer.add_connection("/pose", kind, typestore=store)
        for number, (stamp, received) in enumerate(stamps):
            time = make["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            pose = make[kind](
                header=make["std_msgs/msg/Header"](stamp=time, frame_id=frames[number % 2]),
                pose=make["geometry_msgs/msg/Pose"](
                    position=make["geometry_msgs/msg/Point"](x=float(number), y=0.0, z=2.0),
                    orientation=make["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=turned),
                ),
            )
            writer.write(connection, received, store.serialize_cdr(pose, kind))


#: Times in bags count from 1970.
EPOCH = 1_700_000_000_000_000_000


@pytest.mark.parametrize(("clock", "expected"), [("stamp", [0.0, 0.5, 2.0]), ("received", [0.0, 1.0, 2.0])])
def test_times_are_those_of_the_stamps_or_of_the_recording(
    scenario: Place, tmp_path: Path, clock: str, expected: list[float]
) -> None:
    written(tmp_path, [(EPOCH, EPOCH), (EPOCH + 500_000_000, EPOCH + 10**9), (EPOCH + 2 * 10**9, EPOCH + 2 * 10**9)])
    body = {**BODY, "topic": "/pose"}
    path = scenario({"past": {"file": "poses/poses.mcap", "clock": clock, "in_space": True, "bodies": {"van": body}}})
    obstacle = build(path, [], None).simulation.environment.obstacles["van"]
    assert obstacle.path is not None
    assert list(obstacle.path.times) == expected
    assert [list(each) for each in obstacle.path.positions] == [[0, 0, 2], [1, 0, 2], [2, 0, 2]]


@pytest.mark.parametrize(
    ("stamps", "more", "said"),
    [
        ([(EPOCH + 1, EPOCH), (EPOCH, EPOCH + 1)], {}, "go back"),
        ([(0, EPOCH), (0, EPOCH + 1)], {}, "`clock: received` takes the times of recording"),
        ([(EPOCH, EPOCH), (EPOCH + 1, EPOCH + 1)], {"turned": 0.0}, "no unit quaternion"),
        ([(EPOCH, EPOCH), (EPOCH + 1, EPOCH + 1)], {"turned": float("nan")}, "no unit quaternion"),
        ([(EPOCH, EPOCH), (EPOCH + 1, EPOCH + 1)], {"frames": "mo"}, "in several frames: m, o"),
        ([(EPOCH, EPOCH)], {}, "at one time only"),
    ],
)
def test_motions_that_make_no_sense_are_refused(
    scenario: Place, tmp_path: Path, stamps: list[tuple[int, int]], more: dict[str, Any], said: str
) -> None:
    written(tmp_path, stamps, **more)
    (problem,) = problems(
        scenario({"past": {"file": "poses/poses.mcap", "bodies": {"van": {**BODY, "topic": "/pose"}}}})
    )
    assert said in problem


def test_a_compressed_bag_is_refused_by_name(scenario: Place, tmp_path: Path) -> None:
    path = scenario({"past": {"file": "bag", "bodies": {"van": {**BODY, "topic": "/robot_1/odom"}}}})
    described = tmp_path / "bag" / "metadata.yaml"
    text = described.read_text(encoding="utf-8").replace("compression_mode: ''", "compression_mode: FILE")
    described.write_text(text, encoding="utf-8")
    (problem,) = problems(path)
    assert "compressed by file" in problem


def test_names_in_metadata_cannot_leave_the_folder(scenario: Place, tmp_path: Path) -> None:
    path = scenario({"past": {"file": "bag", "bodies": {"van": {**BODY, "topic": "/robot_1/odom"}}}})
    described = tmp_path / "bag" / "metadata.yaml"
    text = described.read_text(encoding="utf-8").replace("- run.mcap", "- ../../../etc/passwd")
    described.write_text(text, encoding="utf-8")
    (problem,) = problems(path)
    assert "there is no file `bag/passwd`" in problem
