"""The results of reading a sound log."""

import json
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from sample_log import MANIFEST
from simulating import untyped

from symaware_cli.log import others_message, wire
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.error import LogError
from symaware_cli.log.log_schema import descriptor_set
from symaware_cli.log.reader import open_log
from symaware_cli.log.symaware_v1_pb2 import Knowledge
from symaware_cli.log.writer import LogWriter

STEP = 50_000_000


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a log of one group of three out of (time, message) on /agents/robot/<field>."""

    def write(
        field: str, message_name: str, entries: Sequence[tuple[int, bytes]], metadata: Mapping[str, Any] | None = None
    ) -> Path:
        with LogWriter(tmp_path / "log.mcap") as writer:
            manifest = {"format": 1, "groups": {"robot": {"agents": ["robot.0", "robot.1", "robot.2"]}}}
            writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
            channel = writer.channel(f"/agents/robot/{field}", message_name, metadata)
            for time, data in entries:
                writer.add(channel, time, data)
            writer.finish({})
        return writer.path

    return write


def test_a_log_lists_its_content(sample: Path) -> None:
    log = open_log(sample)
    assert log.manifest["name"] == "sample"
    assert (log.start_time, log.end_time) == (0, 39 * STEP)
    assert log.outcome == {"status": "done", "steps": 40}
    assert (log.damage, log.verify()) == (None, None)
    assert not log.foreign
    assert list(log.attachments) == ["manifest.json", "scenario/hello.yaml", "resolved.yaml", "versions.json"]
    assert log.attachments["scenario/hello.yaml"].startswith(b"symaware: 1")
    state = log.channels["/agents/robot/state"]
    assert (state.schema, state.encoding, state.count) == ("symaware.v1.Rows", "protobuf", 40)
    assert state.metadata == {"columns": "x,y,heading", "units": "m,m,rad"}
    assert sum(channel.count for channel in log.channels.values()) == log.message_count
    assert list(log.channels) == sorted(log.channels)


def test_messages_come_in_the_order_of_time_and_sequence(sample: Path) -> None:
    order = [(m.time, m.sequence) for m in open_log(sample).messages() if m.channel.topic != "/timing"]
    assert order == sorted(order)
    assert [sequence for _, sequence in order] == list(range(len(order)))


def test_messages_are_chosen_by_topic_and_time(sample: Path) -> None:
    log = open_log(sample)
    assert {m.channel.topic for m in log.messages("/events")} == {"/events"}
    assert {m.channel.topic for m in log.messages(["/events", "/contacts"])} == {"/events", "/contacts"}
    assert list(log.messages("/nowhere")) == []
    assert list(log.messages([])) == []
    times = [m.time for m in log.messages("/agents/car/state", start=5 * STEP, end=8 * STEP)]
    assert times == [5 * STEP, 6 * STEP, 7 * STEP]
    assert list(log.messages(start=1000 * STEP)) == []


def test_every_message_of_ours_decodes(sample: Path) -> None:
    kinds = {m.channel.topic: type(m.decode()) for m in open_log(sample).messages()}
    assert kinds == {
        "/timing": v1.Timing,
        "/world/robot/state": wire.Rows,
        "/agents/robot/state": wire.Rows,
        "/agents/car/state": wire.Rows,
        "/agents/robot/control": wire.Rows,
        "/world/robot/control": wire.Rows,
        "/agents/robot/risk": wire.SeriesRows,
        "/agents/robot/awareness": others_message.Awareness,
        "/agents/robot/knowledge": v1.Knowledge,
        "/events": v1.Event,
        "/messages": v1.Message,
        "/contacts": v1.Contact,
    }


def test_a_group_has_a_series_in_which_rows_keep_their_last_value(write: Callable[..., Path]) -> None:
    entries = [
        (0, wire.encode_rows([[1.0, 10.0]], [1])),
        (5, wire.encode_rows([[2.0, 20.0], [3.0, 30.0]], [0, 2])),
        (5, wire.encode_rows([[4.0, 40.0]], [2])),
        (9, wire.encode_rows([[7.0, 70.0], [8.0, 80.0], [9.0, 90.0]])),
    ]
    series = open_log(write("state", "Rows", entries, {"columns": "x,y", "units": "m,m"})).series("robot", "state")
    nan = np.nan
    assert series.times.tolist() == [0, 5, 9]
    assert series.times.dtype == np.int64
    expected: Any = [[nan, 1, nan], [2, 1, 4], [7, 8, 9]]
    assert np.array_equal(series.values[:, :, 0], expected, equal_nan=True)
    assert np.array_equal(series.values[:, :, 1], 10 * np.array(expected), equal_nan=True)
    assert (series.columns, series.units) == (("x", "y"), ("m", "m"))


def test_an_agent_has_a_series_of_the_instants_at_which_it_was_recorded(write: Callable[..., Path]) -> None:
    entries = [
        (0, wire.encode_rows([[1.0]], [1])),
        (5, wire.encode_rows([[2.0], [3.0]], [0, 2])),
        (5, wire.encode_rows([[4.0]], [2])),
        (9, wire.encode_rows([[7.0], [8.0], [9.0]])),
    ]
    log = open_log(write("state", "Rows", entries))
    assert [log.series(f"robot.{row}", "state").times.tolist() for row in range(3)] == [[5, 9], [0, 9], [5, 9]]
    assert log.series("robot.2", "state").values.tolist() == [[4.0], [9.0]]


def test_the_first_point_of_a_time_series_is_used(write: Callable[..., Path]) -> None:
    shared = wire.encode_series([0, 10], np.arange(6).reshape(3, 2, 1))
    own = wire.encode_series([5, 15, 5], [[7.0], [8.0], [9.0]], [2, 0, 1])
    log = open_log(write("risk", "SeriesRows", [(0, shared), (5, own)]))
    assert np.array_equal(
        log.series("robot", "risk").values[:, :, 0], np.array([[0, 2, 4], [7, np.nan, 9]]), equal_nan=True
    )
    assert log.series("robot.2", "risk").values.tolist() == [[4], [9]]


@pytest.mark.parametrize("columns", [0, 1])
def test_a_series_without_points_is_an_instant_without_values(write: Callable[..., Path], columns: int) -> None:
    none = wire.encode_series([], np.empty((3, 0, columns)))
    own = wire.encode_series([], np.empty((0, columns)), [0, 0], [0, 2])
    entries = [(0, none), (1, wire.encode_series([1], np.ones((3, 1, 1)))), (2, own), (3, none)]
    log = open_log(write("risk", "SeriesRows", entries))
    nan = np.nan
    expected: Any = [[nan, nan, nan], [1, 1, 1], [nan, 1, nan], [nan, nan, nan]]
    series = log.series("robot", "risk")
    assert series.times.tolist() == [0, 1, 2, 3]
    assert np.array_equal(series.values[:, :, 0], expected, equal_nan=True)
    assert log.series("robot.1", "risk").times.tolist() == [0, 1, 3]
    assert np.array_equal(log.series("robot.1", "risk").values[:, 0], [nan, 1, nan], equal_nan=True)


def test_predictions_are_the_whole_series_of_an_agent_at_each_instant(write: Callable[..., Path]) -> None:
    shared = wire.encode_series([0, 10], np.arange(12).reshape(3, 2, 2))
    own = wire.encode_series([5, 15, 5], [[7.0, 7], [8.0, 8], [9.0, 9]], [2, 1], [0, 2])
    none = wire.encode_series([], np.empty((3, 0, 2)))
    log = open_log(write("intent", "SeriesRows", [(0, shared), (5, own), (6, none)]))

    def found(agent: str) -> list[tuple[int, list[int], list[list[Any]]]]:
        return [(each.time, each.times.tolist(), each.values.tolist()) for each in log.predictions(agent, "intent")]

    assert found("robot.0") == [(0, [0, 10], [[0, 1], [2, 3]]), (5, [5, 15], [[7, 7], [8, 8]]), (6, [], [])]
    assert found("robot.1") == [(0, [0, 10], [[4, 5], [6, 7]]), (6, [], [])]
    assert found("robot.2") == [(0, [0, 10], [[8, 9], [10, 11]]), (5, [5], [[9, 9]]), (6, [], [])]


@pytest.mark.parametrize(
    ("agent", "field", "sentence"),
    [
        ("robot", "intent", "'robot' is a group of 3: name one of its agents"),
        ("robot.7", "intent", "has no agent, group or entity 'robot.7'"),
        ("robot.0", "state", "no field 'state' of predictions; there are intent, uncertainty, risk"),
        ("robot.0", "risk", "has no risk of 'robot.0'"),
    ],
)
def test_missing_predictions_are_reported_at_once(
    write: Callable[..., Path], agent: str, field: str, sentence: str
) -> None:
    log = open_log(write("intent", "SeriesRows", []))
    with pytest.raises(LogError, match=sentence):
        log.predictions(agent, field)


def test_knowledge_is_an_entry_whenever_it_changed(write: Callable[..., Path]) -> None:
    entries = [
        (0, v1.Knowledge(values=['{"goal": [1, 2]}', "{}", '{"a": null}'])),
        (7, v1.Knowledge(rows=[0, 2], values=['{"goal": [3, 4]}', '{"b": true}'])),
    ]
    data = [(time, message.SerializeToString()) for time, message in entries]
    log = open_log(write("knowledge", "Knowledge", data))
    assert [(each.time, each.values) for each in log.knowledge("robot.0")] == [
        (0, {"goal": [1, 2]}),
        (7, {"goal": [3, 4]}),
    ]
    everybody = [(each.time, each.agent) for each in log.knowledge()]
    assert everybody == [(0, "robot.0"), (0, "robot.1"), (0, "robot.2"), (7, "robot.0"), (7, "robot.2")]
    assert list(log.knowledge("robot")) == list(log.knowledge())
    with pytest.raises(LogError, match="has no agent, group or entity 'nobody'"):
        log.knowledge("nobody")


@pytest.mark.parametrize(
    "message", [v1.Knowledge(rows=[3], values=["{}"]), v1.Knowledge(rows=[0], values=[]), v1.Knowledge(values=["{"])]
)
def test_unsuitable_knowledge_is_reported(write: Callable[..., Path], message: Knowledge) -> None:
    log = open_log(write("knowledge", "Knowledge", [(0, message.SerializeToString())]))
    with pytest.raises(LogError, match=r"on /agents/robot/knowledge .* do not fit together"):
        list(log.knowledge())


def test_a_series_has_times_in_seconds_and_columns_by_name(sample: Path) -> None:
    series = open_log(sample).series("robot", "state")
    assert series.seconds[:3].tolist() == [0.0, 0.05, 0.1]
    assert np.array_equal(series.column("y"), series.values[:, :, 1])
    with pytest.raises(LogError, match="there is no column 'z'; there are x, y, heading"):
        series.column("z")


def test_a_log_names_its_agents_by_group(sample: Path) -> None:
    assert open_log(sample).agents == {"robot": ("robot.0", "robot.1", "robot.2"), "car": ("car",)}


def test_entries_are_chosen_by_time(sample: Path) -> None:
    log = open_log(sample)
    assert [event.time // STEP for event in log.events(4 * STEP, 23 * STEP)] == [13]
    assert [entry.time // STEP for entry in log.communications(start=33 * STEP)] == [33, 34]
    assert [entry.time // STEP for entry in log.contacts(end=4 * STEP)] == [3]


def test_the_latency_of_a_message_is_the_time_since_it_was_sent(sample: Path) -> None:
    assert [entry.latency for entry in open_log(sample).communications()][:2] == [0, STEP]


def test_values_in_the_missing_part_of_a_log_are_reported_as_such(sample: Path) -> None:
    sample.write_bytes(sample.read_bytes()[:1000])
    log = open_log(sample)
    ask: Callable[[], object]
    for ask in (lambda: log.series("robot", "state"), lambda: log.series("robot.0", "risk")):
        with pytest.raises(LogError, match="breaks off before its first message"):
            ask()


def test_the_truth_is_in_world(sample: Path) -> None:
    log = open_log(sample)
    assert log.series("robot", "world").values.shape == (40, 3, 3)
    assert np.array_equal(log.series("robot.1", "world").values, log.series("robot.1", "state").values)


def test_the_name_of_a_group_of_one_is_its_agents(sample: Path) -> None:
    assert open_log(sample).series("car", "state").values.shape == (40, 3)


@pytest.mark.parametrize(
    ("name", "field", "sentence"),
    [
        ("robot", "staet", "no field 'staet'; there are applied_control, intent, joints, pose, requested_control"),
        ("robto", "state", "has no agent, group or entity 'robto'; there are robot, car, wall"),
        ("car", "risk", r"has no risk of 'car' \(no channel /agents/car/risk\); there is state$"),
    ],
)
def test_a_missing_series_is_reported(sample: Path, name: str, field: str, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        open_log(sample).series(name, field)


def test_a_row_beyond_the_group_is_reported(write: Callable[..., Path]) -> None:
    log = open_log(write("state", "Rows", [(0, wire.encode_rows([[1.0]], [2**32 - 1]))]))
    with pytest.raises(LogError, match="row 4294967295 of a group of 3"):
        log.series("robot", "state")


def test_malformed_data_are_reported(write: Callable[..., Path]) -> None:
    log = open_log(write("state", "Rows", [(7, b"\x1a\xff")]))
    with pytest.raises(LogError, match=r"the message on /agents/robot/state at 7 ns in .* is not a symaware\.v1\.Rows"):
        log.series("robot", "state")


def test_events_messages_and_contacts_are_read_as_entries(sample: Path) -> None:
    log = open_log(sample)
    events = list(log.events())
    assert [event.time for event in events] == [step * STEP for step in (3, 13, 23, 33)]
    assert (events[0].name, events[0].level, events[0].data) == ("computed", "INFO", {"step": 3})
    sent = next(log.communications())
    assert (sent.id, sent.sender, sent.receiver, sent.kind) == (3, "robot.0", "car", "hello")
    assert (sent.stage, sent.sent_time, sent.payload) == ("SENT", 3 * STEP, {"text": "hello"})
    contact = next(log.contacts())
    assert (contact.a, contact.b, contact.stage, contact.point) == ("car", "wall", "BEGIN", (1.0, 2.0))


def test_an_entry_of_a_later_version_is_still_read(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/events", "Event")
        writer.add(channel, 0, v1.Event(name="x", level=untyped(17)).SerializeToString())
        writer.finish({})
    assert next(open_log(writer.path).events()).level == "17"


def test_an_instant_that_spans_many_chunks_keeps_its_order(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/state", "Rows")
        for number in range(100):
            writer.add(channel, 5, bytes([number]))
            if number % 7 == 0:
                writer.flush()
        writer.finish({})
    assert [message.data[0] for message in open_log(writer.path).messages()] == list(range(100))


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    peaks = []
    for size in (1000, 8000):
        random = np.random.default_rng(0)
        with LogWriter(tmp_path / f"{size}.mcap") as writer:
            channel = writer.channel("/state", "Rows")
            for time in range(size):
                writer.add(channel, time, wire.encode_rows(random.normal(size=(100, 3))))
            writer.finish({})
        log = open_log(writer.path)
        tracemalloc.start()
        assert sum(1 for _ in log.messages()) == size
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] + 100_000
    assert peaks[1] < 3_000_000


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("summary", [True, False])
def test_a_foreign_log_out_of_order_is_listed_in_order(
    tmp_path: Path, compression: CompressionType, chunked: bool, summary: bool
) -> None:
    path = tmp_path / "foreign.mcap"
    random = np.random.default_rng(3)
    times = random.integers(0, 500, 400).tolist()
    with open(path, "wb") as file:
        options: dict[str, Any] = (
            {} if summary else {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False}
        )
        writer = Writer(file, chunk_size=500, compression=compression, use_chunking=chunked, **options)
        writer.start(profile="ros2")
        schema = writer.register_schema("pkg/Thing", "ros2msg", b"int32 a")
        channel = writer.register_channel("/thing", "cdr", schema)
        bare = writer.register_channel("/bare", "json", 0)
        for sequence, time in enumerate(times):
            writer.add_message(channel if sequence % 3 else bare, time, b"{}", time, sequence)
        writer.add_metadata("m", {"a": "b"})
        untyped(writer).finish()
    log = open_log(path)
    assert log.foreign
    assert log.manifest == {}
    assert log.damage is None
    assert [(m.time, m.sequence) for m in log.messages()] == sorted(
        (time, sequence) for sequence, time in enumerate(times)
    )
    assert {topic: (info.schema, info.count) for topic, info in log.channels.items()} == {
        "/bare": ("", 134),
        "/thing": ("pkg/Thing", 266),
    }
    assert log.metadata == {"m": {"a": "b"}}
    with pytest.raises(LogError, match="are not SymAware messages"):
        next(log.messages()).decode()
    with pytest.raises(LogError, match="there are none"):
        log.series("thing", "state")


def test_our_messages_written_by_others_are_read(tmp_path: Path) -> None:
    with open(tmp_path / "log.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("symaware.v1.Rows", "protobuf", descriptor_set())
        channel = writer.register_channel("/world/ball/state", "protobuf", schema)
        for time in (3, 1, 2):
            writer.add_message(channel, time, v1.Rows(columns=1, values=[time]).SerializeToString(), time)
        untyped(writer).finish()
    log = open_log(tmp_path / "log.mcap")
    assert log.series("ball", "world").values.tolist() == [[[1.0]], [[2.0]], [[3.0]]]


def manifest_only(path: Path, content: bytes) -> Path:
    with LogWriter(path) as writer:
        writer.attach("manifest.json", "application/json", content)
        writer.finish({})
    return path


def test_a_log_of_a_newer_format_is_refused(tmp_path: Path) -> None:
    path = manifest_only(tmp_path / "log.mcap", b'{"format": 2}')
    with pytest.raises(LogError, match="newer SymAware: its format is 2, this one reads up to 1"):
        open_log(path)


NO_MANIFESTS = {
    "empty": b"",
    "no text": b"\xff",
    "list": b"[]",
    "no format": b"{}",
    "text as format": b'{"format": "1"}',
    "deep": b'{"format": 1, "groups": ' + b"[" * 100_000,
    "closed deep": b'{"format": 1, "later": ' + b"[" * 500 + b"]" * 500 + b"}",
    "long number": b'{"format": 1, "seed": ' + b"9" * 4000 + b"}",
    **{
        content: f'{{"format": 1, {content}}}'.encode()
        for content in (
            '"groups": [1]',
            '"groups": {"robot": 1}',
            '"groups": {"robot": {"agents": "ab"}}',
            '"groups": {"robot": {"agents": ["a", "a"]}}',
            '"groups": {"a": {"agents": ["x"]}, "b": {"agents": ["x"]}}',
            '"groups": {"a/b": {}}',
            '"groups": {"robot": {"agents": ["new\\nline"]}}',
            '"groups": {"robot": {"model": {"state": [["x", "m"]], "position": [0, 1]}}}',
            '"groups": {"robot": {"model": {"state": [["x"]]}}}',
            '"groups": {"robot": {"model": {"state": [["x", "m"]], "heading": -1}}}',
            '"groups": {"robot": {"entity": {"shape": {"circle": {"radius": -1}}}}}',
            '"groups": {"robot": {"entity": {"mass": NaN}}}',
            '"entities": []',
            '"entities": {"wall": {"position": [1]}}',
            '"entities": {"wall": {"heading": 1e999}}',
            '"roster": ["a", 1]',
            '"roster": ["a", "a"]',
            '"groups": {"robot": {"agents": ["a"]}}, "roster": ["a", "b"]',
            '"time_step": 0.5',
            '"steps": -1',
            '"steps": 99999999999999999999',
            '"seed": []',
            '"name": 1',
            '"part": {}',
        )
    },
}


@pytest.mark.parametrize("kind", NO_MANIFESTS)
def test_an_invalid_manifest_is_left_out_as_damaged(tmp_path: Path, kind: str) -> None:
    log = open_log(manifest_only(tmp_path / "log.mcap", NO_MANIFESTS[kind]))
    assert (log.manifest, log.foreign, log.agents) == ({}, False, {})
    assert log.damage is not None
    assert log.damage.lost
    assert str(log.damage) == "1 damaged attachment left out"
    with pytest.raises(LogError, match=r"the manifest in .* is damaged"):
        log.require_manifest()


def test_a_manifest_may_have_entries_unknown_to_this_version(tmp_path: Path) -> None:
    content = {**MANIFEST, "weather": "fair", "entities": {"wall": {"colour": "red"}}}
    log = open_log(manifest_only(tmp_path / "log.mcap", json.dumps(content).encode()))
    assert log.manifest == content
    assert log.damage is None


def test_files_that_are_no_logs_are_refused_in_a_sentence(tmp_path: Path) -> None:
    empty, text, magic, fifo = (tmp_path / name for name in ("empty", "text", "magic", "fifo"))
    empty.touch()
    text.write_text("symaware: 1\n")
    magic.write_bytes(b"\x89MCAP0\r\n")
    os.mkfifo(fifo)
    for path, sentence in (
        (empty, f"{empty} is empty"),
        (text, f"{text} is not a log: it does not begin like an MCAP"),
        (magic, f"{magic} is not a log: it breaks off in its first record"),
        (tmp_path / "missing", f"there is no file {tmp_path / 'missing'}"),
        (tmp_path, f"cannot read the log {tmp_path}: it is not a file"),
        (fifo, f"cannot read the log {fifo}: it is not a file"),
    ):
        with pytest.raises(LogError) as caught:
            open_log(path)
        assert str(caught.value) == sentence


@pytest.mark.usefixtures("ordinary_rights")
def test_a_log_without_permission_is_refused(sample: Path) -> None:
    sample.chmod(0)
    with pytest.raises(LogError, match="permission denied"):
        open_log(sample)


def test_a_log_that_vanishes_is_reported(sample: Path) -> None:
    log = open_log(sample)
    sample.unlink()
    with pytest.raises(LogError, match="there is no file"):
        next(log.messages())


def test_reading_the_log_of_a_run_in_progress(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "log.mcap")
    channel = writer.channel("/state", "Rows")
    for time in range(3):
        writer.add(channel, time, b"")
        writer.flush()
        log = open_log(writer.path)
        assert [message.time for message in log.messages()] == list(range(time + 1))
        assert log.damage is not None
        assert log.damage.end_missing
    writer.abort()


def test_importing_the_package_imports_neither_mcap_nor_protobuf() -> None:
    code = "import sys, symaware_cli.log; sys.exit(any(m in sys.modules for m in ('mcap', 'google.protobuf')))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_a_log_with_a_similar_name_is_suggested_for_a_missing_one(tmp_path: Path) -> None:
    (tmp_path / "hello.mcap").touch()
    with pytest.raises(LogError, match=r"there is no file .*helo\.mcap; did you mean hello\.mcap\?$"):
        open_log(tmp_path / "helo.mcap")
    with pytest.raises(LogError, match=r"there is no file .*hello; did you mean hello\.mcap\?$"):
        open_log(tmp_path / "hello")


@pytest.mark.parametrize("name", ["hello.yaml", "hello.yml", "hello.toml"])
def test_opening_a_scenario_as_a_log_suggests_running_it(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("symaware: 1\n")
    with pytest.raises(LogError, match=f"is not a log; `symaware run .*{name}` writes that of a scenario"):
        open_log(tmp_path / name)
