"""What Foxglove is given: read back with nothing but what the file itself says."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import export_foxglove
from foxglove_files import Messages, read
from google.protobuf.message import Message as ProtobufMessage
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation
from sensing_log import write_sensing
from simulating import Team, present, simulate

from symaware_cli import Log
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.log.error import LogError, OutputError
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter
from symaware_cli.views.views import run_view_of

SECOND = 1_000_000_000


def nanoseconds(time: Any) -> int:
    return int(time.seconds * SECOND + time.nanos)


def exported(log: Path, folder: Path) -> Messages:
    path = folder / "foxglove.mcap"
    export_foxglove(open_log(log), path)
    return read(path)


@pytest.fixture(scope="session")
def crossing(scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of robots with risks, intents, uncertainties and walls around them."""
    path = tmp_path_factory.mktemp("crossing") / "crossing.mcap"
    execute(build(scenarios / "crossing.yaml", ["run.duration=4"], None), path)
    return path


@pytest.fixture(scope="session")
def shown(crossing: Path, tmp_path_factory: pytest.TempPathFactory) -> Messages:
    """The same for Foxglove."""
    return exported(crossing, tmp_path_factory.mktemp("shown"))


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a log of two robots and a moving cart out of (time, topic, kind, data)."""
    model: dict[str, Any] = {
        "use": "unicycle",
        "state": [["x", "m"], ["y", "m"], ["heading", "rad"]],
        "control_input": [],
    }
    model |= {"position": [0, 1], "heading": 2}
    agents = ["robot.0", "robot.1"]
    body = {"shape": {"box": {"length": 2.0, "width": 1.0}}, "mass": 1.0}
    cart = body | {"position": [5.0, 5.0], "heading": 0.0, "path": {"times": [0, 1], "positions": [[5, 5], [6, 5]]}}
    group = {"agents": agents, "indexed": True, "model": model, "entity": body, "components": {}}
    manifest = {"format": 1, "name": "hand", "seed": 1, "mode": "synchronous", "time_step": SECOND, "steps": 3}
    manifest |= {"groups": {"robot": group}, "entities": {"cart": cart}, "roster": [*agents, "cart"]}

    def write(*entries: tuple[int, str, str, bytes | ProtobufMessage]) -> Path:
        with LogWriter(tmp_path / "hand.mcap") as writer:
            writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
            channels: dict[Any, Any] = {}
            for time, topic, kind, data in entries:
                metadata = {"columns": "x,y", "units": "m,m"} if kind == "SeriesRows" else {}
                if kind == "Rows":
                    metadata = {"columns": "x,y,heading", "units": "m,m,rad"}
                channel = channels.setdefault(topic, None) or writer.channel(topic, kind, metadata)
                channels[topic] = channel
                writer.add(channel, time, data if isinstance(data, bytes) else data.SerializeToString())
            writer.finish({})
        return writer.path

    return write


class Scene:
    """What is up, as Foxglove keeps it: an update deletes, then adds or replaces."""

    def __init__(self) -> None:
        self.up: dict[Any, Any] = {}

    def apply(self, update: Any) -> None:
        for deletion in update.deletions:
            entity = self.up.get(deletion.id)
            if entity is not None and nanoseconds(entity.timestamp) < nanoseconds(deletion.timestamp):
                del self.up[deletion.id]
        for entity in update.entities:
            self.up[entity.id] = entity

    def at(self, time: int) -> set[str]:
        lasting = {id: nanoseconds(entity.timestamp) + nanoseconds(entity.lifetime) for id, entity in self.up.items()}
        return {id for id, end in lasting.items() if end == nanoseconds(self.up[id].timestamp) or time < end}


def test_every_agent_is_a_frame_that_moves_as_it_truly_did(crossing: Path, shown: Messages) -> None:
    log = open_log(crossing)
    series = log.series("robot", "world")
    frames = shown["/tf/robot"]
    assert [time for time, _ in frames] == series.times.tolist()
    for (time, message), values in zip(frames, series.values, strict=True):
        assert [each.child_frame_id for each in message.transforms] == log.manifest["groups"]["robot"]["agents"]
        assert {each.parent_frame_id for each in message.transforms} == {"world"}
        assert {nanoseconds(each.timestamp) for each in message.transforms} == {time}
        places = [(each.translation.x, each.translation.y, each.translation.z) for each in message.transforms]
        np.testing.assert_array_equal(places, np.column_stack([values[:, :2], np.zeros(len(values))]))
        turns = [2.0 * np.arctan2(each.rotation.z, each.rotation.w) for each in message.transforms]
        np.testing.assert_allclose(np.cos(turns), np.cos(values[:, 2]), atol=1e-6)
        np.testing.assert_allclose(np.sin(turns), np.sin(values[:, 2]), atol=1e-6)


def test_a_body_keeps_its_name_and_stays_in_its_frame(crossing: Path, shown: Messages) -> None:
    agents = open_log(crossing).manifest["groups"]["robot"]["agents"]
    for _, update in shown["/bodies/robot"]:
        assert [entity.id for entity in update.entities] == agents
        assert all(entity.frame_id == entity.id and entity.frame_locked for entity in update.entities)
        assert all(round(entity.cylinders[0].size.x, 9) == 0.6 for entity in update.entities)
        assert not update.deletions


def test_a_body_is_the_redder_the_more_risk_it_is_at(write: Callable[..., Path], tmp_path: Path) -> None:
    risks = [[0.0, 0.0], [1.0, 0.5], [1.0, 0.51], [np.inf, 0.0]]
    told = []
    for time, risk in enumerate(risks):
        told += [
            (time, "/world/robot/state", "Rows", wire.encode_rows([[1.0, 2.0, 0.0], [4.0, 6.0, 0.0]])),
            (time, "/agents/robot/risk", "SeriesRows", wire.encode_series([time], np.reshape(risk, (2, 1, 1)))),
        ]
    messages = exported(write(*told), tmp_path)
    bodies = messages["/bodies/robot"]
    # What is not to be seen makes no message.
    assert [time for time, _ in bodies] == [0, 1, 3]
    reds = [[round(255 * entity.cubes[0].color.r) for entity in update.entities] for _, update in bodies]
    assert reds == [[68, 34], [230, 132], [230, 34]]
    assert [bodies[0][1].entities[0].cubes[0].size.x, bodies[0][1].entities[0].cubes[0].size.y] == [2.0, 1.0]


def test_walls_stand_where_they_stand(crossing: Path, shown: Messages) -> None:
    (time, scenery), *more = shown["/scenery"]
    assert (time, more) == (0, [])
    entities = open_log(crossing).manifest["entities"]
    assert [entity.id for entity in scenery.entities] == list(entities)
    for entity in scenery.entities:
        ((_, frames),) = shown[f"/tf/{entity.id}"]
        (frame,) = frames.transforms
        assert frame.child_frame_id == entity.frame_id == entity.id
        assert [frame.translation.x, frame.translation.y] == entities[entity.id]["position"]
        xs = [point.x for triangles in entity.triangles for point in triangles.points]
        assert (min(xs), max(xs)) == (-5.0, 5.0)


def test_intents_are_lines_through_their_points(crossing: Path, shown: Messages) -> None:
    messages = list(open_log(crossing).messages("/agents/robot/intent"))
    assert len(shown["/intents/robot"]) == len(messages)
    for message, (time, update) in zip(messages, shown["/intents/robot"], strict=True):
        assert time == message.time
        for (_, values), entity in zip(message.decode(), update.entities, strict=True):
            assert [[point.x, point.y] for point in entity.lines[0].points] == values.tolist()


def test_uncertainties_are_ellipses_of_95_percent(crossing: Path, shown: Messages) -> None:
    log = open_log(crossing)
    believed, uncertainty = log.series("robot", "state"), log.series("robot", "uncertainty")
    time, update = shown["/uncertainties/robot"][-1]
    place = int(np.searchsorted(uncertainty.times, time))
    covariance = uncertainty.values[place].reshape(-1, 3, 3)[:, :2, :2]
    assert len(update.entities) == len(covariance)
    for entity, matrix, state in zip(update.entities, covariance, believed.values[place], strict=True):
        ball = entity.spheres[0]
        assert [ball.pose.position.x, ball.pose.position.y] == state[:2].tolist()
        # The 95 % quantile of the chi-square distribution with 2 degrees of freedom is 5.9915.
        area = np.pi * 5.9915 * np.sqrt(np.linalg.det(matrix))
        assert np.pi / 4.0 * ball.size.x * ball.size.y == pytest.approx(area, rel=1e-3)


def test_numbers_can_be_plotted_by_name_and_agent(crossing: Path, shown: Messages) -> None:
    log = open_log(crossing)
    for field, topic in (("world", "/world/robot/state"), ("state", "/agents/robot/state")):
        series = log.series("robot", field)
        for place, (time, message) in enumerate(shown[topic]):
            assert time == series.times[place]
            np.testing.assert_array_equal(
                np.column_stack([message.x, message.y, message.heading]), series.values[place]
            )
    for field, topic in (("applied_control", "/world/robot/control"), ("requested_control", "/agents/robot/control")):
        time, message = shown[topic][5]
        series = log.series("robot", field)
        assert time == series.times[5]
        np.testing.assert_array_equal(message.turn_rate, series.values[5, :, 1])
    _, risk = shown["/agents/robot/risk"][5]
    np.testing.assert_array_equal(risk.risk, log.series("robot", "risk").values[5, :, 0])


def test_events_are_lines_of_a_log(crossing: Path, shown: Messages) -> None:
    events = list(open_log(crossing).events())
    assert [time for time, _ in shown["/events"]] == [event.time for event in events]
    assert [(line.name, line.level) for _, line in shown["/events"]] == [(event.source, 2) for event in events]
    assert shown["/events"][0][1].message == f"started {events[0].text}"


def test_trails_end_where_agents_are(crossing: Path, shown: Messages) -> None:
    series = open_log(crossing).series("robot", "world")
    for time, update in shown["/trails/robot"]:
        values = series.values[np.searchsorted(series.times, time)]
        ends = [(entity.lines[0].points[-1].x, entity.lines[0].points[-1].y) for entity in update.entities]
        np.testing.assert_array_equal(ends, values[:, :2])


def test_messages_come_in_the_order_of_simulated_time(crossing: Path, tmp_path: Path) -> None:
    counts = export_foxglove(open_log(crossing), tmp_path / "one.mcap")
    with open(tmp_path / "one.mcap", "rb") as file:
        reader = make_reader(file)
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        statistics = present(reader.get_summary()).statistics
    assert times == sorted(times)
    assert statistics is not None
    assert sum(counts.values()) == len(times) == statistics.message_count


def test_the_same_log_makes_the_same_bytes(crossing: Path, tmp_path: Path) -> None:
    for name in ("one.mcap", "two.mcap"):
        export_foxglove(open_log(crossing), tmp_path / name)
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


def test_an_intent_that_is_given_up_is_taken_down(write: Callable[..., Path], tmp_path: Path) -> None:
    ways = np.arange(12.0).reshape(2, 3, 2)
    messages = exported(
        write(
            (0, "/agents/robot/intent", "SeriesRows", wire.encode_series([0, 1, 2], ways)),
            (5, "/agents/robot/intent", "SeriesRows", wire.encode_series([], np.empty((0, 2)), [0], [1])),
            (7, "/agents/robot/intent", "SeriesRows", wire.encode_series([7, 8], ways[1, :2], [2], [1])),
        ),
        tmp_path,
    )
    scene, up = Scene(), []
    for _, update in messages["/intents/robot"]:
        scene.apply(update)
        up.append(sorted(scene.up))
    assert up == [["robot.0", "robot.1"], ["robot.0"], ["robot.0", "robot.1"]]
    assert [len(entity.lines[0].points) for entity in scene.up.values()] == [3, 2]


def test_a_contact_is_marked_while_it_lasts(write: Callable[..., Path], tmp_path: Path) -> None:
    def contact(a: str, b: str, stage: v1.Contact.Stage) -> v1.Contact:
        return v1.Contact(a=a, b=b, point=[1.0, 2.0], depth=0.1, stage=stage)

    states = wire.encode_rows([[1.0, 2.0, 0.0], [4.0, 6.0, 0.0]])
    messages = exported(
        write(
            (0, "/world/robot/state", "Rows", states),
            (10, "/contacts", "Contact", contact("robot.0", "robot.1", v1.Contact.BEGIN)),
            (20, "/contacts", "Contact", contact("robot.0", "cart", v1.Contact.BEGIN)),
            (30, "/contacts", "Contact", contact("robot.0", "robot.1", v1.Contact.END)),
            (40, "/contacts", "Contact", contact("robot.0", "cart", v1.Contact.END)),
        ),
        tmp_path,
    )
    scene, up = Scene(), []
    for _, update in messages["/contacts"]:
        scene.apply(update)
        up.append(sorted(scene.up))
    assert up == [["robot.0 robot.1"], ["robot.0 cart", "robot.0 robot.1"], ["robot.0 cart"], []]


def test_whoever_jumps_into_the_middle_sees_all_that_is_up(shown: Messages) -> None:
    checked = 0
    for topic, messages in shown.items():
        if topic.split("/")[1] in ("bodies", "labels", "trails", "goals", "intents", "uncertainties", "scenery"):
            scene = Scene()
            for _, update in messages:
                scene.apply(update)
                assert set(scene.up) == {entity.id for entity in update.entities}
                checked += 1
    assert checked > 100


def test_a_message_is_an_arrow_for_a_moment(write: Callable[..., Path], tmp_path: Path) -> None:
    def message(stage: v1.Message.Stage) -> v1.Message:
        return v1.Message(id=3, sender="robot.0", receiver="robot.1", kind="hello", stage=stage)

    states = wire.encode_rows([[1.0, 2.0, 0.0], [4.0, 6.0, 0.0]])
    messages = exported(
        write(
            (0, "/world/robot/state", "Rows", states),
            (SECOND, "/messages", "Message", message(v1.Message.SENT)),
            (2 * SECOND, "/messages", "Message", message(v1.Message.DELIVERED)),
            (4 * SECOND, "/world/robot/state", "Rows", states),
        ),
        tmp_path,
    )
    ((time, update),) = messages["/messages"]
    assert (time, update.entities[0].lifetime.nanos) == (2 * SECOND, 300_000_000)
    ((arrow,),) = (entity.lines for entity in update.entities)
    assert (update.entities[0].id, arrow.color.a) == ("robot.0 robot.1", 1.0)
    # From one to the other, rim to rim; the tip of the head is its last point but one.
    way = np.array([3.0, 4.0]) / 5.0
    ends = np.array([[point.x, point.y] for point in (arrow.points[0], arrow.points[-2])]) - [1.0, 2.0]
    assert 0.5 < ends[0] @ way < 1.5 < 3.5 < ends[1] @ way < 4.5


def test_entities_that_move_have_frames_as_well(write: Callable[..., Path], tmp_path: Path) -> None:
    messages = exported(write((5, "/world/cart/state", "Rows", wire.encode_rows([[5.5, 5.0, 1.0]]))), tmp_path)
    ((time, frames),) = messages["/tf/cart"]
    assert (time, frames.transforms[0].child_frame_id, frames.transforms[0].translation.x) == (5, "cart", 5.5)
    assert messages["/scenery"][0][1].entities[0].frame_id == "cart"


def test_a_tilting_body_has_a_tilting_frame(tmp_path: Path) -> None:
    state = [0.0, 0.0, 1.0, 0.3, -0.2, 0.7, *[0.0] * 6]
    simulate({"drone": Team(count=1, state=[state], model=Quadrotor())}, 1, tmp_path / "tilt.mcap")
    _, frames = exported(tmp_path / "tilt.mcap", tmp_path)["/tf/drone"][0]
    (frame,) = frames.transforms
    turned = Rotation.from_quat([getattr(frame.rotation, axis) for axis in "xyzw"])
    np.testing.assert_allclose(turned.as_euler("ZYX"), [0.7, -0.2, 0.3], atol=1e-9)


def test_where_the_truth_was_not_recorded_bodies_follow_the_belief(write: Callable[..., Path], tmp_path: Path) -> None:
    states = wire.encode_rows([[1.0, 2.0, 0.0], [4.0, 6.0, 0.0]])
    later = wire.encode_rows([[9.0, 2.0, 0.0]], [1])
    messages = exported(
        write((0, "/agents/robot/state", "Rows", states), (5, "/agents/robot/state", "Rows", later)), tmp_path
    )
    places = [[each.translation.x for each in frames.transforms] for _, frames in messages["/tf/robot"]]
    assert places == [[1.0, 4.0], [1.0, 9.0]]


def test_a_malformed_message_is_reported_with_its_place(write: Callable[..., Path], tmp_path: Path) -> None:
    states = wire.encode_rows([[1.0, 2.0, 0.0]], [7])
    log = open_log(write((5, "/world/robot/state", "Rows", states)))
    with pytest.raises(LogError, match=r"the messages on /world/robot/state in .* do not fit together: at 5 ns"):
        export_foxglove(log, tmp_path / "out.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["hand.mcap"]


def test_a_missing_folder_is_reported_and_leaves_no_file(crossing: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="its folder does not exist"):
        export_foxglove(open_log(crossing), tmp_path / "nowhere" / "out.mcap")
    assert list(tmp_path.iterdir()) == []


# --- sensors ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def sensing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Messages]:
    """A log of all that sensors measure, and the same for Foxglove."""
    folder = tmp_path_factory.mktemp("sensing")
    path = write_sensing(folder / "sensing.mcap")
    return open_log(path), exported(path, folder)


def test_a_scan_ends_where_its_rays_ended(sensing: tuple[Log, Messages]) -> None:
    log, shown = sensing
    for agent in ("robot.0", "robot.1"):
        scans = list(log.scans(agent))
        assert [time for time, _ in shown[f"/scan/{agent}/scan"]] == [scan.time for scan in scans]
        for scan, (_, message) in zip(scans, shown[f"/scan/{agent}/scan"], strict=True):
            ranges = np.array(message.ranges)
            np.testing.assert_array_equal(ranges, scan.distances)
            angles = np.linspace(message.start_angle, message.end_angle, len(ranges))
            turned = message.pose.orientation
            bearings = angles + 2.0 * np.arctan2(turned.z, turned.w)
            met = np.isfinite(ranges)
            places = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)[met] * ranges[met, None]
            places += [message.pose.position.x, message.pose.position.y]
            np.testing.assert_allclose(places, scan.points[:, :2], atol=1e-6)
            height = scan.pose[2] if run_view_of(log).is_spatial else 0.0
            assert (message.frame_id, message.pose.position.z) == ("world", height)


def test_rays_that_are_not_spread_evenly_make_no_scan(write: Callable[..., Path], tmp_path: Path) -> None:
    scan = v1.Scan(angles=[0.0, 0.1, 0.5], distances=[1.0] * 6, poses=[0.0] * 8, range=9.0)
    assert "/scan/robot.0/look" not in exported(write((0, "/agents/robot/scan/look", "Scan", scan)), tmp_path)


def test_images_are_shown_as_they_were_taken(sensing: tuple[Log, Messages]) -> None:
    log, shown = sensing
    colours = [image for image in log.images("robot.1") if image.kind == "COLOUR"]
    depths = [image.pixels for image in log.images("robot.1") if image.kind == "DEPTH"]
    assert [message.data for _, message in shown["/camera/robot.1/eye/colour"]] == [image.data for image in colours]
    for (_, message), depth in zip(shown["/camera/robot.1/eye/depth"], depths, strict=True):
        pixels = np.frombuffer(message.data, "<u2").reshape(message.height, message.step // 2)
        np.testing.assert_array_equal(pixels == 0, np.isinf(depth))
        np.testing.assert_allclose(pixels[pixels > 0] / 1e3, depth[pixels > 0], atol=1e-9)


def test_the_lens_maps_bodies_to_their_places(sensing: tuple[Log, Messages]) -> None:
    """A pixel and its depth, through the lens and the frame of the camera, are a point on the front of the crate."""
    log, shown = sensing
    (_, frame), (_, lens) = shown["/tf/robot.0/eye"][0], shown["/camera/robot.0/eye/calibration"][0]
    assert (frame.child_frame_id, frame.parent_frame_id) == (lens.frame_id, "world")
    images = {image.kind: image.pixels for image in log.images("robot.0") if image.time == 0}
    crate = images["SEGMENTS"] == 3
    row, column = (int(each[0]) for each in np.nonzero(crate))  # its upper left corner
    depth = images["DEPTH"][row, column]
    seen = depth * np.linalg.solve(np.array(lens.K).reshape(3, 3), [column + 0.5, row + 0.5, 1.0])
    turned = Rotation.from_quat([getattr(frame.rotation, axis) for axis in "xyzw"])
    place = turned.apply(seen) + [getattr(frame.translation, axis) for axis in "xyz"]
    # The crate is a cube of 1 m on the ground, 2.5 m ahead; a pixel is 0.12 m there.
    np.testing.assert_allclose(place, [2.5, 0.5, 1.0], atol=0.13)


def test_readings_can_be_plotted_by_name_and_agent(sensing: tuple[Log, Messages]) -> None:
    log, shown = sensing
    series = log.series("robot", "inertia")
    for (time, message), instant, values in zip(
        shown["/agents/robot/measurement/inertia"], series.times, series.values, strict=True
    ):
        assert time == instant
        np.testing.assert_array_equal(message.acceleration_z, values[:, 2])
    assert list(shown["/agents/robot/measurement/bumper"][0][1].touching) == [0.0, 0.0]
