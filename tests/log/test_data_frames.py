"""Frames and datasets of a log have the values of its series."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.log.reader import Log, open_log
from symaware_cli.log.writer import LogWriter

STEP = 50_000_000
STATE = ["world.x", "world.y", "world.heading"]
LIBRARIES = ("pandas", "polars", "arrow")


@pytest.fixture
def log(sample: Path) -> Log:
    return open_log(sample)


@pytest.fixture
def absences(tmp_path: Path) -> Log:
    """A group of two, of which the second enters at 2 s and leaves at 4 s, and nothing is recorded at 4 s."""
    with LogWriter(tmp_path / "absences.mcap") as writer:
        groups = {"robot": {"agents": ["robot.0", "robot.1"], "absent": ["robot.1"]}}
        writer.attach("manifest.json", "application/json", json.dumps({"format": 1, "groups": groups}).encode())
        state = writer.channel("/world/robot/state", "Rows", {"columns": "x", "units": "m"})
        events = writer.channel("/events", "Event")

        def happens(name: str, second: int) -> None:
            event = v1.Event(name=name, source="agents.robot.1", level=v1.Event.INFO)
            writer.add(events, second * 10**9, event.SerializeToString())

        for second in range(4):
            if second == 2:
                happens("added", second)
            rows = [[float(second)], [10.0 + second]] if second >= 2 else [[float(second)]]
            writer.add(state, second * 10**9, wire.encode_rows(rows, list(range(len(rows)))))
        happens("removed", 4)
        writer.finish({})
    return open_log(writer.path)


def same(found: Any, expected: Any) -> bool:
    return np.array_equal(np.asarray(found), expected, equal_nan=True)


@pytest.mark.parametrize("name", ["robot", "robot.1", "car"])
@pytest.mark.parametrize("to", LIBRARIES)
def test_values_are_those_of_the_series(log: Log, name: str, to: Any) -> None:
    field = "state" if name == "car" else "world"
    series, frame = log.series(name, field), log.frame(name, field, to=to)
    count = 3 if name == "robot" else 1
    for column in series.columns:
        assert same(frame[f"{field}.{column}"], series.column(column).ravel())
    assert same(frame["time"], np.repeat(series.seconds, count))
    agents = log.agents["robot"] if name == "robot" else [name]
    assert list(map(str, frame["agent"].to_pylist() if to == "arrow" else frame["agent"])) == [*agents] * len(
        series.times
    )


def test_all_libraries_agree(log: Log) -> None:
    import pandas as pd
    import polars as pl

    pandas, polars, arrow = (log.frame("robot", to=to) for to in LIBRARIES)  # type: ignore[arg-type]
    assert polars.equals(pl.from_arrow(arrow), null_equal=True)
    pd.testing.assert_frame_equal(pandas, arrow.to_pandas(), check_exact=True)
    pd.testing.assert_frame_equal(pandas, polars.to_pandas(), check_exact=True)


def test_types_and_units(log: Log) -> None:
    import polars as pl

    pandas, polars, arrow = (log.frame("robot", to=to) for to in LIBRARIES)  # type: ignore[arg-type]
    names = ["time", "agent", *STATE, *(name.replace("world", "state") for name in STATE)]
    assert list(pandas.columns) == polars.columns == arrow.column_names == names
    assert all(pandas[name].dtype == np.float64 for name in names if name != "agent")
    assert polars.dtypes == [pl.Float64, pl.String, *[pl.Float64] * 6]
    assert list(map(str, arrow.schema.types)) == ["double", "string", *["double"] * 6]
    units = dict(zip(STATE, ("m", "m", "rad"), strict=True))
    assert pandas.attrs["units"] == {"time": "s"} | units | {
        key.replace("world", "state"): unit for key, unit in units.items()
    }
    assert arrow.schema.field("world.heading").metadata == {b"unit": b"rad"}
    assert arrow.schema.field("agent").metadata is None


def test_a_field_is_nan_at_the_instants_of_others(log: Log) -> None:
    frame = log.frame("robot.0", ["world", "state"])
    believed = log.series("robot.0", "state")
    assert len(frame) == len(log.series("robot.0", "world").times) > len(believed.times)
    held = frame[frame["state.x"].notna()]
    assert same(held["time"], believed.seconds)
    assert same(held["state.x"], believed.column("x"))


def test_an_absent_agent_is_nan(absences: Log) -> None:
    frame = absences.frame("robot")
    assert list(frame["agent"]) == ["robot.0", "robot.1"] * 5
    assert same(frame["world.x"], absences.series("robot", "world").values.ravel())
    assert same(frame["world.x"][1::2], [np.nan, np.nan, 12, 13, np.nan])
    assert same(absences.to_xarray("robot").world.sel(agent="robot.1", column="x"), frame["world.x"][1::2])


@pytest.mark.parametrize("to", LIBRARIES)
def test_an_interval_includes_its_start_and_may_be_empty(log: Log, to: Any) -> None:
    part = log.frame("robot", "world", to=to, start=2 * STEP, end=4 * STEP)
    assert same(part["time"], np.repeat([0.1, 0.15], 3))
    whole = log.frame("robot", "world", to=to)
    for start, end in ((1000 * STEP, None), (4 * STEP, 2 * STEP)):
        empty = log.frame("robot", "world", to=to, start=start, end=end)
        assert len(empty) == 0
        assert list(empty.columns if to != "arrow" else empty.column_names) == ["time", "agent", *STATE]
    if to == "polars":
        assert empty.schema == whole.schema
    assert log.to_xarray("robot", start=1000 * STEP).world.shape == (3, 0, 3)


def test_a_dataset_has_agents_time_and_columns_with_units(log: Log) -> None:
    found = log.to_xarray("robot", ["world", "state", "applied_control"])
    series = log.series("robot", "world")
    assert found.world.dims == found.state.dims == ("agent", "time", "column")
    assert found.applied_control.dims == ("agent", "time", "column_applied_control")
    assert same(found.world, series.values.transpose(1, 0, 2))
    assert same(found.time, series.seconds)
    assert (found.world.attrs["units"], found.time.attrs["units"]) == (["m", "m", "rad"], "s")
    assert list(found.agent.values) == list(log.agents["robot"])
    assert same(found.world.sel(agent="robot.2", column="heading"), series.column("heading")[:, 2])
    assert log.to_xarray("car").state.shape == (1, 40, 3)


def test_a_table_has_a_separate_frame(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "table.mcap") as writer:
        groups = {"robot": {"agents": ["robot"]}}
        writer.attach("manifest.json", "application/json", json.dumps({"format": 1, "groups": groups}).encode())
        metadata = {"columns": "range", "units": "m", "signal": "table"}
        channel = writer.channel("/agents/robot/returns/radar", "TableRows", metadata)
        for time in (0, 10**9):
            writer.add(channel, time, wire.encode_tables([[1.0 + time], [2.0]], [2]))
        writer.finish({})
    log = open_log(writer.path)
    frame = log.frame("robot", "radar.returns")
    assert frame["time"].tolist() == [0, 0, 1, 1]
    assert same(frame["radar.returns.range"], log.series("robot", "radar.returns").values[:, 0])
    with pytest.raises(LogError, match=r"radar\.returns is a table"):
        log.to_xarray("robot", "radar.returns")


@pytest.mark.parametrize(
    ("name", "field"), [("robto", "world"), ("robot", "wrold"), ("robot", "pose"), ("car", "world")]
)
def test_unknown_names_raise_the_same_errors_as_in_series(log: Log, name: str, field: str) -> None:
    with pytest.raises(LogError) as expected:
        log.series(name, field)
    for call in (log.frame, log.to_xarray):
        with pytest.raises(LogError) as error:
            call(name, field)
        assert (type(error.value), str(error.value)) == (type(expected.value), str(expected.value))


def test_a_library_that_is_unknown_or_missing_is_named(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match="no library 'numpy' of frames; there are pandas, polars, arrow"):
        log.frame("robot", to="numpy")  # type: ignore[arg-type]
    for to, module in (("pandas", "pandas"), ("polars", "polars"), ("arrow", "pyarrow")):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(LogError, match=f"`{module}`, which is not installed: pip install 'symaware-cli.frames.'"):
            log.frame("robot", to=to)  # type: ignore[arg-type]
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(LogError, match="`xarray`, which is not installed"):
        log.to_xarray("robot")
