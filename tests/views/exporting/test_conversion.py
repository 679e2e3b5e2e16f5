"""A log as tables: nothing is lost, nothing added, and nothing left behind when it fails."""

import csv
import io
import itertools
import json
import math
import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import CSV, PARQUET, export_tables
from google.protobuf.message import Message as ProtobufMessage
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from numpy.typing import NDArray
from pyarrow import parquet
from sample_log import write_sample
from simulating import present, untyped

from symaware_cli import Log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log import others_message, wire
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter
from symaware_cli.views.exporting import conversion
from symaware_cli.views.exporting.log_selection import Selection, select

PLANAR = {"columns": "x,y,heading", "units": "m,m,rad"}


def read(path: Path) -> Any:
    return parquet.read_table(path, partitioning=None)


def read_text(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"), newline="")))


def of(table: Any, agent: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The rows of one agent: instants in ns, and numbers (k, columns)."""
    rows = table.filter(np.array(table["agent"].to_pylist()) == agent)
    times = np.rint(rows["time"].to_numpy() * 1e9).astype(np.int64)
    return times, np.stack([rows[name].to_numpy() for name in rows.column_names[2:]], axis=1)


def test_states_are_those_of_the_log(noisy: Path, tmp_path: Path) -> None:
    log = open_log(noisy)
    export_tables(log, tmp_path / "tables", PARQUET)
    for kind in ("state", "world"):
        for agent in ("watcher", "straight", "turner"):
            table = read(tmp_path / "tables" / kind / f"{agent}.parquet")
            assert table.column_names == ["time", "agent", "x", "y", "heading"]
            times, values = of(table, agent)
            series = log.series(agent, kind)
            np.testing.assert_array_equal(times, series.times)
            np.testing.assert_array_equal(values, series.values)


def test_control_inputs_are_recorded_as_applied_and_as_requested(tmp_path: Path) -> None:
    log = open_log(write_sample(tmp_path / "sample.mcap"))
    export_tables(log, tmp_path / "tables", PARQUET, Selection(fields=frozenset({"control"})))
    made = sorted(path.relative_to(tmp_path / "tables").as_posix() for path in (tmp_path / "tables").rglob("*.parquet"))
    assert [each for each in made if "robot" in each] == ["control/robot.parquet", "control_requested/robot.parquet"]
    for table_name, field in (("control", "applied_control"), ("control_requested", "requested_control")):
        table = read(tmp_path / "tables" / table_name / "robot.parquet")
        assert table.column_names[2:] == ["speed", "turn"]
        for agent in ("robot.0", "robot.1", "robot.2"):
            times, values = of(table, agent)
            np.testing.assert_array_equal(times, log.series(agent, field).times)
            np.testing.assert_array_equal(values, log.series(agent, field).values)


def test_every_point_of_a_time_series_has_a_row(noisy: Path, table: Callable[[Path, str], Any]) -> None:
    rows = table(noisy, "intent/straight").to_pylist()
    expected = [
        {"time": m.time / 1e9, "agent": "straight", "point": k, "point_time": time / 1e9, "x": x, "y": y}
        for m in open_log(noisy).messages("/agents/straight/intent")
        for times, values in m.decode()
        for k, (time, (x, y)) in enumerate(zip(times.tolist(), values.tolist(), strict=True))
    ]
    assert len(expected) > 100
    assert rows == expected


def test_every_belief_of_another_has_a_row(noisy: Path, table: Callable[[Path, str], Any]) -> None:
    rows = table(noisy, "awareness/watcher").to_pylist()
    log = open_log(noisy)
    roster, seen = log.manifest["roster"], 0
    for message, own in zip(
        log.messages("/agents/watcher/awareness"), itertools.groupby(rows, lambda row: row["time"]), strict=True
    ):
        content, found = message.decode(), list(own[1])
        assert own[0] == message.time / 1e9
        if not len(content.entities):
            assert [row["other"] for row in found] == [None]
            continue
        assert [row["other"] for row in found] == [roster[entity] for entity in content.entities]
        values = [[row[name] for name in ("x", "y", "vx", "vy")] for row in found]
        assert np.ravel(values).tolist() == content.values.tolist()
        matrix = [[row[f"cov_{one}_{other}"] for one in ("x", "vx") for other in ("x", "vx")] for row in found]
        assert np.ravel(matrix).tolist() == content.covariances.reshape(-1, 4, 4)[:, ::2, ::2].ravel().tolist()
        assert [row["age"] for row in found] == (content.ages.tolist() or [0.0] * len(found))
        seen += len(found)
    assert seen > 20


def test_entries_have_a_row_each(tmp_path: Path) -> None:
    log = open_log(write_sample(tmp_path / "sample.mcap"))
    export_tables(log, tmp_path / "tables", PARQUET)
    events, messages, contacts, knowledge, timing = (
        read(tmp_path / "tables" / f"{name}.parquet").to_pylist()
        for name in ("events", "messages", "contacts", "knowledge/robot", "timing")
    )
    assert [row["time"] for row in events] == [event.time / 1e9 for event in log.events()]
    assert (events[0]["source"], events[0]["data"]) == ("agents.robot.1.steer", '{"step": 3}')
    first = {"time": 0.15, "id": 3, "sender": "robot.0", "receiver": "car", "kind": "hello", "stage": "SENT"}
    assert messages[0] == first | {"sent_time": 0.15, "reason": "", "payload": '{"text": "hello"}', "size": 0}
    where = {name: contacts[0].pop(name) for name in ("x", "y", "z")}
    assert contacts[0] == {"time": 0.15, "a": "car", "b": "wall", "stage": "BEGIN", "depth": 0.1, "impulse": 0.0}
    assert (where["x"], where["y"], math.isnan(where["z"])) == (1.0, 2.0, True)
    assert knowledge == [{"time": 0.0, "agent": "robot.0", "key": "goal", "value": "[1, 2]"}]
    assert len(timing) == 8


def test_events_that_recur_have_a_row_each(tmp_path: Path) -> None:
    record = v1.Recurring(names=["stepping", "computed"], sources=["run", "agents.robot.1.steer"])
    record.name.extend([0, 1, 1])
    record.source.extend([0, 1, 1])
    with LogWriter(tmp_path / "log.mcap") as writer:
        manifest = {"format": 1, "groups": {"robot": {"agents": ["robot.0", "robot.1"]}}, "entities": {}, "roster": []}
        writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
        writer.add(writer.channel("/events/recurring", "Recurring"), 5, record.SerializeToString())
        writer.finish({})
    log = open_log(tmp_path / "log.mcap")
    for agents, expected in ((None, ["stepping", "computed", "computed"]), (["robot.1"], ["computed", "computed"])):
        folder = tmp_path / f"tables-{len(expected)}"
        export_tables(log, folder, CSV, select(log, agents=agents))
        rows = read_text(folder / "recurring.csv")
        assert [row["name"] for row in rows] == expected
        assert {row["time"] for row in rows} == {"5e-09"}


def test_every_ray_of_a_scan_has_a_row(sensing: Path, table: Callable[[Path, str], Any]) -> None:
    rows = table(sensing, "scan/robot/scan")
    assert rows.column_names[:6] == ["time", "agent", "ray", "measured", "angle", "distance"]
    scans = list(open_log(sensing).scans())
    assert len(rows) == 180 * len(scans)
    for number, scan in enumerate(scans):
        own = rows.slice(180 * number, 180)
        assert set(own["agent"].to_pylist()) == {scan.agent}
        assert own["time"].to_pylist() == [scan.time / 1e9] * 180
        assert own["measured"].to_pylist() == [scan.measured / 1e9] * 180
        assert own["ray"].to_pylist() == list(range(180))
        np.testing.assert_array_equal(own["angle"].to_numpy(), scan.angles)
        np.testing.assert_array_equal(own["distance"].to_numpy(), scan.distances)
        pose = [own[name][0].as_py() for name in ("x", "y", "z", "heading")]
        assert pose == scan.pose.tolist()


def test_numeric_measurements_have_a_row_for_each_agent(sensing: Path, tmp_path: Path) -> None:
    log = open_log(sensing)
    export_tables(log, tmp_path / "tables", PARQUET, select(log, fields=["measurement"]))
    for sensor in ("bumper", "inertia"):
        rows = read(tmp_path / "tables" / "measurement" / "robot" / f"{sensor}.parquet")
        series = log.series("robot.1", sensor)
        assert rows.column_names[2:] == list(series.columns)
        times, values = of(rows, "robot.1")
        np.testing.assert_array_equal(times, series.times)
        np.testing.assert_array_equal(values, series.values)
    assert not (tmp_path / "tables" / "scan").exists()


def test_images_are_in_parquet_and_beside_csv(sensing: Path, tmp_path: Path) -> None:
    log = open_log(sensing)
    chosen = select(log, fields=["image"], agents=["robot.1"])
    images = list(log.images("robot.1"))
    export_tables(log, tmp_path / "parquet", PARQUET, chosen)
    rows = read(tmp_path / "parquet" / "image" / "robot" / "eye.parquet").to_pylist()
    assert [(row["time"], row["kind"], row["image"]) for row in rows] == [
        (image.time / 1e9, image.kind, image.data) for image in images
    ]
    assert {(row["agent"], row["width"], row["height"]) for row in rows} == {("robot.1", 32, 24)}
    assert [row["encoding"] for row in rows[:3]] == ["rgb8", "16UC1", "16UC1"]
    written = export_tables(log, tmp_path / "csv", CSV, chosen)
    folder = tmp_path / "csv" / "image" / "robot"
    texts = read_text(folder / "eye.csv")
    assert [(folder / text["image"]).read_bytes() for text in texts] == [image.data for image in images]
    assert len(list((folder / "eye").iterdir())) == len(images)
    size = next(each.size for each in written if each.file == "image/robot/eye.csv")
    assert size == sum(path.stat().st_size for path in folder.rglob("*.*"))


def test_images_are_numbered_on_where_a_table_is_written_on(
    sensing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conversion, "_HELD", 2000)
    log = open_log(sensing)
    export_tables(log, tmp_path / "csv", CSV, select(log, fields=["image"]))
    texts = read_text(tmp_path / "csv" / "image" / "robot" / "eye.csv")
    assert [text["image"] for text in texts] == [f"eye/{row:06}.png" for row in range(len(list(log.images())))]


def test_units_and_the_origin_of_the_log_are_in_the_metadata(noisy: Path, tmp_path: Path) -> None:
    export_tables(open_log(noisy), tmp_path / "tables", PARQUET)
    schema = parquet.read_schema(tmp_path / "tables" / "uncertainty" / "watcher.parquet")
    units = {field.name: (field.metadata or {}).get(b"unit") for field in schema}
    assert [units[name] for name in ("time", "agent", "point", "point_time")] == [b"s", None, b"1", b"s"]
    assert [units[name] for name in ("cov_x_x", "cov_x_heading")] == [b"m*m", b"m*rad"]
    assert (schema.metadata[b"symaware.name"], schema.metadata[b"symaware.seed"]) == (b"noisy", b"11")
    assert "numpy" in json.loads(schema.metadata[b"symaware.versions"])


def test_csv_says_in_two_more_tables_what_parquet_has_in_its_metadata(noisy: Path, tmp_path: Path) -> None:
    written = export_tables(open_log(noisy), tmp_path / "tables", CSV)
    rows = read_text(tmp_path / "tables" / "columns.csv")
    described = {(f"{row['table']}.csv", row["column"]) for row in rows}
    assert described == {(each.file, column) for each in written for column in each.columns}
    assert {row["unit"] for row in rows if row["column"] == "heading"} == {"rad"}
    facts = {row["key"]: row["value"] for row in read_text(tmp_path / "tables" / "run.csv")}
    assert (facts["name"], facts["seed"], facts["time_step"], facts["status"]) == ("noisy", "11", "0.05", "finished")


def test_both_formats_hold_the_same(noisy: Path, tmp_path: Path) -> None:
    for form in (PARQUET, CSV):
        export_tables(open_log(noisy), tmp_path / form.table_suffix, form)
    names = {path.relative_to(tmp_path / ".csv").with_suffix("") for path in (tmp_path / ".csv").rglob("*.csv")}
    compared = 0
    for name in names - {Path("run"), Path("columns")}:
        rows = read(tmp_path / ".parquet" / f"{name}.parquet").to_pylist()
        texts = read_text(tmp_path / ".csv" / f"{name}.csv")
        assert len(rows) == len(texts)
        for row, text in zip(rows, texts, strict=True):
            for key, value in row.items():
                cell = text[key]
                if isinstance(value, float):
                    assert float(cell or "nan") == value or (math.isnan(value) and not cell)
                else:
                    assert cell == ("" if value is None else str(value))
                compared += 1
    assert compared > 5_000


@pytest.mark.parametrize("form", [PARQUET, CSV], ids=["parquet", "csv"])
def test_the_same_log_makes_the_same_bytes(noisy: Path, tmp_path: Path, form: Any) -> None:
    contents = []
    for attempt in ("one", "two"):
        export_tables(open_log(noisy), tmp_path / attempt, form)
        files = sorted((tmp_path / attempt).rglob("*.*"))
        contents.append([(path.relative_to(tmp_path / attempt), path.read_bytes()) for path in files])
    assert contents[0] == contents[1]


def test_the_agents_are_a_table(noisy: Path, tmp_path: Path) -> None:
    export_tables(open_log(noisy), tmp_path / "tables", PARQUET)
    agents = read(tmp_path / "tables" / "agents.parquet").to_pylist()
    assert [row["agent"] for row in agents] == ["straight", "turner", "watcher"]
    assert (agents[0]["model"], agents[0]["mass"], json.loads(agents[0]["shape"])) == (
        *("unicycle", 1.0),
        {"circle": {"radius": 0.3}},
    )
    entities = read(tmp_path / "tables" / "entities.parquet").to_pylist()
    assert [(row["entity"], row["x"]) for row in entities] == [("wall", 0.0)]


def test_fields_agents_and_times_can_be_chosen(tmp_path: Path) -> None:
    log = open_log(write_sample(tmp_path / "sample.mcap"))
    chosen = select(log, fields=["state", "messages"], agents=["robot.1", "car"], start=500_000_000, end=1_000_000_001)
    written = export_tables(log, tmp_path / "tables", PARQUET, chosen)
    names = ["agents", "entities", "messages", "state/car", "state/robot"]
    assert [each.file for each in written] == [f"{name}.parquet" for name in names]
    rows = read(tmp_path / "tables" / "state" / "robot.parquet").to_pylist()
    assert {row["agent"] for row in rows} == {"robot.1"}
    assert [rows[0]["time"], rows[-1]["time"]] == [0.5, 1.0]
    assert [row["agent"] for row in read(tmp_path / "tables" / "agents.parquet").to_pylist()] == ["robot.1", "car"]


def test_events_messages_and_contacts_are_those_of_chosen_agents(tmp_path: Path) -> None:
    log = open_log(write_sample(tmp_path / "sample.mcap"))
    counts = {}
    for agent in ("robot.0", "robot.1", "car", "wall"):
        written = export_tables(log, tmp_path / agent, CSV, Selection(agents=frozenset([agent])))
        rows = {each.file: each.rows for each in written}
        counts[agent] = [rows[f"{name}.csv"] for name in ("events", "messages", "contacts")]
    messages = [{entry.sender, entry.receiver} for entry in log.communications()]
    contacts = [{contact.a, contact.b} for contact in log.contacts()]
    assert counts == {
        agent: [sum(f"agents.{agent}." in f"{event.source}." for event in log.events())]
        + [sum(agent in each for each in entries) for entries in (messages, contacts)]
        for agent in counts
    }
    assert sum(map(sum, counts.values())) > 10


@pytest.mark.parametrize(("what", "name"), [("fields", "rsk"), ("agents", "robot.7")])
def test_a_name_that_nobody_has_is_refused(tmp_path: Path, what: str, name: str) -> None:
    log = open_log(write_sample(tmp_path / "sample.mcap"))
    with pytest.raises(UnknownNameError, match=name) as refusal:
        select(log, **untyped({what: [name]}))
    assert refusal.value.name == name
    assert "risk" in refusal.value.known or "robot.1" in refusal.value.known


def test_of_two_messages_at_one_instant_the_last_counts(
    write: Callable[..., Path], table: Callable[[Path, str], Any]
) -> None:
    entries = [
        (0, wire.encode_rows([[0.0], [1.0], [2.0]])),
        (0, wire.encode_rows([[10.0]], [1])),
        (0, wire.encode_rows([[20.0], [30.0]], [1, 2])),
        (5, wire.encode_rows([[4.0]], [2])),
    ]
    rows = table(write("state", "Rows", entries, {"columns": "x", "units": "m"}), "state/robot").to_pylist()
    assert [(row["time"], row["agent"], row["x"]) for row in rows] == [
        *[(0.0, "robot.0", 0.0), (0.0, "robot.1", 20.0), (0.0, "robot.2", 30.0)],
        (5e-9, "robot.2", 4.0),
    ]


def test_a_series_without_points_has_a_row_that_says_so(
    write: Callable[..., Path], table: Callable[[Path, str], Any]
) -> None:
    entries = [
        (0, wire.encode_series([0, 5], np.arange(6.0).reshape(3, 2, 1))),
        (7, wire.encode_series([7, 8], [[1.0], [2.0]], [0, 2], [0, 2])),
        (9, wire.encode_series([], np.empty((3, 0, 1)))),
    ]
    rows = table(write("risk", "SeriesRows", entries), "risk/robot").to_pylist()
    assert [(row["agent"], row["point"], row["value_0"]) for row in rows[6:]] == [
        *[("robot.0", 0, pytest.approx(math.nan, nan_ok=True)), ("robot.2", 0, 1.0), ("robot.2", 1, 2.0)],
        *[(agent, 0, pytest.approx(math.nan, nan_ok=True)) for agent in ("robot.0", "robot.1", "robot.2")],
    ]
    assert math.isnan(rows[6]["point_time"])


def test_beliefs_of_different_length_share_columns(
    write: Callable[..., Path], table: Callable[[Path, str], Any]
) -> None:
    entries = [
        (
            0,
            others_message.encode_awareness([2, 0, 1], [1, 2, 0], [3, 2, 3], [1, 2, 3, 4, 5, 6, 7, 8], ages=[0, 1, 2]),
        )
    ]
    rows = table(write("awareness", "Awareness", entries), "awareness/robot").to_pylist()
    assert [(row["agent"], row["other"], row["age"], row["value_0"], row["value_2"]) for row in rows] == [
        ("robot.0", "robot.1", 0.0, 1.0, 3.0),
        ("robot.0", "robot.2", 1.0, 4.0, pytest.approx(math.nan, nan_ok=True)),
        ("robot.1", None, *[pytest.approx(math.nan, nan_ok=True)] * 3),
        ("robot.2", "robot.0", 2.0, 6.0, 8.0),
    ]


def test_a_state_may_have_an_element_called_time(write: Callable[..., Path], table: Callable[[Path, str], Any]) -> None:
    entries = [(3_000_000_000, wire.encode_rows([[1.0, 2.0]], [0]))]
    log = write("state", "Rows", entries, {"columns": "time,agent", "units": "s,1"})
    assert table(log, "state/robot").to_pylist() == [{"time": 3.0, "agent": "robot.0", "time_2": 1.0, "agent_2": 2.0}]


def test_the_name_of_a_group_leads_nowhere_else(write: Callable[..., Path], tmp_path: Path) -> None:
    def named(group: str) -> Log:
        content = [(0, wire.encode_rows([[1.0]], [0]))]
        return open_log(write("state", "Rows", content, {"columns": "x", "units": "m"}, group=group))

    export_tables(named("..\\C: %2F"), tmp_path / "tables", CSV)
    assert [path.name for path in (tmp_path / "tables" / "state").iterdir()] == ["..%5CC%3A%20%252F.csv"]
    assert {path.name for path in tmp_path.iterdir()} == {"log.mcap", "tables"}
    with pytest.raises(LogError, match="is damaged"):
        export_tables(named("../../up"), tmp_path / "more", CSV)


@pytest.mark.parametrize(
    ("field", "kind", "data"),
    [
        ("state", "Rows", wire.encode_rows([[1.0], [2.0], [3.0], [4.0]])),
        ("state", "Rows", wire.encode_rows([[1.0]], [3])),
        ("state", "Rows", wire.encode_rows([[1.0, 2.0]], [0])),
        ("state", "Event", v1.Event(name="what is this here")),
        ("intent", "SeriesRows", v1.SeriesRows(columns=1, lengths=[2, 5], times=[1, 2], values=[1, 2])),
        ("awareness", "Awareness", others_message.encode_awareness([1], [7], [1], [1.0], [0])),
        ("awareness", "Awareness", v1.Awareness(lengths=[1, 1, 9], entities=[0, 1], columns=[1], values=[1.0, 2.0])),
        ("knowledge", "Knowledge", v1.Knowledge(values=["{"])),
        ("knowledge", "Knowledge", v1.Knowledge(rows=[9], values=["{}"])),
        ("scan/look", "Scan", v1.Scan(angles=[0.0, 1.0], distances=[1.0, 2.0, 3.0], poses=[0.0] * 12)),
        ("scan/look", "Scan", v1.Scan(rows=[3], angles=[0.0], distances=[1.0], poses=[0.0] * 4)),
        ("image/look", "Image", v1.Image(row=3, kind=v1.Image.COLOUR)),
        ("image/look", "Image", v1.Image(row=1, kind=v1.Image.COLOUR, data=b"no PNG")),
        ("measurement/look", "Rows", wire.encode_rows([[1.0, 2.0]], [0])),
    ],
)
def test_a_malformed_message_is_reported_with_its_topic(
    write: Callable[..., Path], tmp_path: Path, field: str, kind: str, data: bytes | ProtobufMessage
) -> None:
    content = data if isinstance(data, bytes) else data.SerializeToString()
    log = write(field, kind, [(0, content)], {"columns": "x", "units": "m"})
    with pytest.raises(
        LogError,
        match=rf"the messages on /agents/robot/{field} .*(do not fit together|\(symaware.v1.Event\).* are not Sym)",
    ):
        export_tables(open_log(log), tmp_path / "tables", CSV)
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_a_table_is_the_same_however_often_it_is_written_on(
    noisy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export_tables(open_log(noisy), tmp_path / "at-once", PARQUET)
    monkeypatch.setattr(conversion, "_HELD", 2000)
    export_tables(open_log(noisy), tmp_path / "bit-by-bit", PARQUET)
    groups = []
    for path in (tmp_path / "at-once").rglob("*.parquet"):
        other = tmp_path / "bit-by-bit" / path.relative_to(tmp_path / "at-once")
        assert repr(read(path).to_pydict()) == repr(read(other).to_pydict())
        groups.append(parquet.ParquetFile(other).num_row_groups)
    assert max(groups) > 10


def test_memory_does_not_grow_with_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conversion, "_HELD", 50_000)
    peaks = []
    for steps in (100, 500):
        log = open_log(write_sample(tmp_path / f"{steps}.mcap", steps=steps, flush_every=50))
        tracemalloc.start()
        export_tables(log, tmp_path / f"{steps}", CSV)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] + 100_000


def test_a_truncated_log_is_shown_up_to_its_end(tmp_path: Path) -> None:
    whole = write_sample(tmp_path / "whole.mcap")
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    log = open_log(broken)
    export_tables(log, tmp_path / "tables", PARQUET)
    times, values = of(read(tmp_path / "tables" / "world" / "robot.parquet"), "robot.1")
    expected = open_log(whole).series("robot.1", "world")
    assert 0 < len(times) < len(expected.times)
    np.testing.assert_array_equal(values, expected.values[: len(times)])
    assert present(log.damage).lost


def test_a_log_cut_off_anywhere_is_exported_or_refused_in_a_sentence(tmp_path: Path) -> None:
    data = write_sample(tmp_path / "whole.mcap", steps=6).read_bytes()
    path = tmp_path / "cut.mcap"
    sizes = [*range(0, len(data), 499), len(data) - 1]
    refusals = []
    for size in sizes:
        path.write_bytes(data[:size])
        with tempfile.TemporaryDirectory(dir=tmp_path) as folder:
            try:
                export_tables(open_log(path), Path(folder) / "tables", CSV)
            except LogError as error:
                refusals.append((str(error), list(Path(folder).iterdir())))
    assert 0 < len(refusals) < len(sizes)
    assert all("\n" not in sentence and left == [] for sentence, left in refusals)


def test_the_log_of_another_program_is_refused(tmp_path: Path) -> None:
    with open(tmp_path / "foreign.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        untyped(writer).finish()
    with pytest.raises(LogError, match="was not written by SymAware"):
        export_tables(open_log(tmp_path / "foreign.mcap"), tmp_path / "tables", CSV)
    assert [path.name for path in tmp_path.iterdir()] == ["foreign.mcap"]


def test_a_folder_with_something_in_it_stays_as_it_is(noisy: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    with pytest.raises(LogError, match="it is not an empty folder"):
        export_tables(open_log(noisy), tmp_path, CSV)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@st.composite
def runs(draw: st.DrawFn) -> list[tuple[int, list[list[float]], list[int] | None]]:
    """Instants of simulated time, each with states of some of three agents; an instant may come more than once."""
    numbers = st.floats(allow_nan=False, allow_infinity=True)
    instants = draw(st.lists(st.integers(0, 2**50), min_size=1, max_size=8))
    messages = []
    for time in sorted(instants):
        rows = sorted(draw(st.sets(st.integers(0, 2), min_size=1)))
        values = [[draw(numbers), draw(numbers)] for _ in rows]
        messages.append((time, values, None if len(rows) == 3 and draw(st.booleans()) else rows))
    return messages


@settings(max_examples=20)
@given(messages=runs(), held=st.sampled_from([1, 2000, 1 << 20]))
def test_any_states_come_back_as_they_were(
    messages: list[tuple[int, list[list[float]], list[int] | None]], held: int
) -> None:
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(conversion, "_HELD", held)
        with LogWriter(Path(folder) / "log.mcap") as writer:
            agents = ["robot.0", "robot.1", "robot.2"]
            manifest = {"format": 1, "groups": {"robot": {"agents": agents}}, "entities": {}, "roster": agents}
            writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
            channel = writer.channel("/agents/robot/state", "Rows", {"columns": "x,y", "units": "m,m"})
            for time, values, rows in messages:
                writer.add(channel, time, wire.encode_rows(values, rows))
            writer.finish({})
        log = open_log(writer.path)
        export_tables(log, Path(folder) / "tables", PARQUET, select(log, fields=["state"]))
        table = read(Path(folder) / "tables" / "state" / "robot.parquet")
        assert table["time"].to_pylist() == sorted(table["time"].to_pylist())
        for agent in agents:
            series = log.series(agent, "state")
            times, found = of(table, agent)
            np.testing.assert_array_equal(times, series.times)
            np.testing.assert_array_equal(found, series.values if len(times) else np.empty((0, 2)))


def test_poses_and_joints_are_those_of_the_log(scenarios: Path, tmp_path: Path) -> None:
    path = tmp_path / "racecars.mcap"
    execute(build(scenarios / "racecars.yaml", ["run.duration=0.2"]), path)
    log = open_log(path)
    export_tables(log, tmp_path / "tables", PARQUET)
    for kind in ("pose", "joints"):
        times, values = of(read(tmp_path / f"tables/{kind}/inner.parquet"), "inner.1")
        expected = log.series("inner.1", kind)
        np.testing.assert_array_equal(times, expected.times)
        np.testing.assert_array_equal(values, expected.values)
        assert len(times) > 5
