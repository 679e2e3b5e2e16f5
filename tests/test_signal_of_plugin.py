"""A plugin adds a channel, and a sensor with a new kind of reading, in a file each: examples of docs/plugins.md."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from documented_plugins import command, install
from simulating import Command

from symaware_cli import open_log

#: One process prepares what all of these tests look at.
pytestmark = pytest.mark.xdist_group("plugins of a signal and a sensor")

MODULES = {"my_effort": '"""Effort', "my_radar": '"""Radar'}
POINTS = {"mine.gauge": "my_effort:Gauge", "mine.radar": "my_radar:Radar", "mine.warn": "my_radar:Warn"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("signals"), MODULES, POINTS, "radar.yaml")


@pytest.fixture(scope="module")
def symaware(folder: Path) -> Command:
    return command(folder)


@pytest.fixture(scope="module")
def log(folder: Path, symaware: Command) -> Path:
    symaware("run", "radar.yaml", "--quiet", process=True)
    return folder / "radar.mcap"


def test_each_plugin_is_one_file_that_knows_the_public_interface_alone(folder: Path) -> None:
    for module, most in (("my_effort", 30), ("my_radar", 60)):
        lines = (folder / "site" / f"{module}.py").read_text(encoding="utf-8").splitlines()
        assert len(lines) < most
        assert len([line for line in lines if "symaware_cli" in line]) == 1


def test_numbers_are_a_series_by_component_and_name(log: Path) -> None:
    read = open_log(log)
    effort = read.series("robot", "gauge.effort")
    assert (effort.columns, effort.units) == (("power", "energy"), ("W", "J"))
    assert effort.values.shape == (160, 3, 2)
    assert (np.diff(effort.column("energy"), axis=0) >= 0).all()
    signal = read.signals("robot")["gauge.effort"]
    assert (signal.name, signal.kind, signal.drawn, signal.description) == (
        "effort",
        "vector",
        "curve",
        "of the motion",
    )
    assert "/agents/robot/effort/gauge" in read.channels


def test_a_table_is_read_whole_or_entry_by_entry(log: Path) -> None:
    read = open_log(log)
    tables = list(read.tables("robot.0", "radar.returns"))
    assert {len(table.values) for table in tables} <= {0, 1, 2}
    assert len({len(table.values) for table in tables}) > 1
    entries = read.series("robot.0", "radar.returns")
    assert entries.columns == tables[0].columns == ("distance", "bearing", "approach")
    assert np.array_equal(entries.values, np.concatenate([table.values for table in tables]))
    assert entries.times.tolist() == [table.time for table in tables for _ in table.values]
    # What was measured becomes known with the sensor's delay.
    assert tables[0].time == 100_000_000
    assert entries.column("distance").max() < 6.5


def test_a_sensor_may_compute_in_a_separate_process(log: Path, folder: Path, symaware: Command) -> None:
    here = "agents.robot.components.radar.run_in=here"
    symaware("run", "radar.yaml", "--quiet", "--output", folder / "here.mcap", "--set", here)
    one, other = (open_log(path).series("robot.1", "radar.returns") for path in (log, folder / "here.mcap"))
    assert one.values.tobytes() == other.values.tobytes()
    assert one.times.tolist() == other.times.tolist()


def test_a_component_of_an_agent_reads_the_signal_of_the_sensor_of_its_group(log: Path) -> None:
    assert any(event.name == "approached" for event in open_log(log).events())


def test_two_components_of_one_class_have_a_signal_each(folder: Path, symaware: Command) -> None:
    second = "agents.robot.components.meter={use: mine.gauge, period: 1.0}"
    symaware("run", "radar.yaml", "--quiet", "--output", folder / "two.mcap", "--set", second)
    read = open_log(folder / "two.mcap")
    assert {"gauge.effort", "meter.effort"} <= set(read.signals("robot"))
    assert len(read.series("robot.0", "meter.effort").times) == 8


def test_the_log_alone_suffices_to_inspect_export_plot_and_replay_it(
    log: Path, folder: Path, symaware: Command
) -> None:
    for series in ("robot.0:gauge.effort:power", "robot.0:radar.returns"):
        assert "[" in symaware("log", "series", log, series, plugin=False).stdout
    refused = symaware("log", "series", log, "robot:radar.returns", plugin=False, status=2)
    assert "name one of its agents" in refused.stderr
    fields = ("--fields", "effort,returns")
    symaware("export", log, "--format", "csv", *fields, "--output", folder / "tables", plugin=False)
    with open(folder / "tables" / "returns" / "robot" / "radar.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time", "agent", "entry", "distance", "bearing", "approach"]
    first = next(table for table in open_log(log).tables("robot.0", "radar.returns") if len(table.values) == 2)
    told = [row for row in rows if row["agent"] == "robot.0" and float(row["time"]) == first.time / 1e9]
    assert [[int(row["entry"]), float(row["distance"])] for row in told] == [
        [number, pytest.approx(entry[0])] for number, entry in enumerate(first.values)
    ]
    symaware("export", log, "--format", "parquet", *fields, "--output", folder / "parquet", plugin=False)
    assert (folder / "parquet" / "effort" / "robot" / "gauge.parquet").exists()
    plotted = symaware("plot", log, "--output", folder / "radar.png", "--json", plugin=False)
    panels = {panel["panel"] for panel in json.loads(plotted.stdout)["panels"]}
    assert {"gauge.effort power", "gauge.effort energy"} <= panels
    asked = symaware(
        *("plot", log, "--show", "radar.returns", "--output", folder / "returns.png", "--json"), plugin=False
    )
    shown = {panel["panel"]: panel for panel in json.loads(asked.stdout)["panels"]}
    assert set(shown) == {f"radar.returns {column}" for column in ("distance", "bearing", "approach")}
    assert shown["radar.returns distance"]["maximum"]["value"] < 6.5


def test_a_replay_has_a_dot_where_each_return_came_from_and_curves_of_the_numbers(
    log: Path, folder: Path, symaware: Command
) -> None:
    from rerun_files import Recording

    symaware("replay", log, "--save", folder / "radar.rrd", plugin=False)
    recording = Recording(folder / "radar.rrd")
    dots = recording.values("/awareness/robot/radar.returns", "Points3D:positions")
    assert any(dots.values() if isinstance(dots, dict) else dots)
    assert recording.values("/curves/agents/robot.0/effort/gauge/0", "Scalars:scalars")
    assert recording.values("/curves/agents/robot.0/effort/gauge/1", "Scalars:scalars")


def test_foxglove_has_the_numbers_and_the_dots(log: Path, folder: Path, symaware: Command) -> None:
    symaware("export", log, "--format", "foxglove", "--output", folder / "fox.mcap", plugin=False)
    channels = open_log(folder / "fox.mcap").channels
    assert "/radar.returns/robot" in channels
    assert "/agents/robot/effort/gauge" in channels


def test_it_can_be_left_out_of_the_log_by_its_name(folder: Path, symaware: Command) -> None:
    symaware("run", "radar.yaml", "--quiet", "--output", folder / "less.mcap", "--set", "recording.omit=[returns]")
    channels = open_log(folder / "less.mcap").channels
    assert "/agents/robot/returns/radar" not in channels
    assert "/agents/robot/effort/gauge" in channels
    done = symaware("validate", "radar.yaml", "--set", "recording.omit=[retruns]", status=2)
    assert "did you mean `returns`?" in done.stderr


def test_show_and_the_schema_for_editors_have_the_signal(symaware: Command) -> None:
    assert "effort  a vector of power, energy: of the motion" in symaware("show", "mine.gauge").stdout
    schema = json.loads(symaware("schema").stdout)
    assert {"effort", "returns"} <= set(schema["$defs"]["Recording"]["properties"]["omit"]["items"]["enum"])


def test_several_processes_record_the_signals_of_their_own_agents_and_their_logs_are_one(
    log: Path, folder: Path, symaware: Command
) -> None:
    from concurrent.futures import ThreadPoolExecutor

    from ports import free_port

    here, port = ("--set", "agents.robot.components.radar.run_in=here"), free_port()
    with ThreadPoolExecutor() as both:
        done = [
            both.submit(symaware, "run", "radar.yaml", "--quiet", *here, *role, process=True)
            for role in (
                ("--listen", port, "--only", "robot.0", "--output", folder / "host.mcap"),
                ("--join", f"127.0.0.1:{port}", "--only", "robot.1,robot.2", "--output", folder / "member.mcap"),
            )
        ]
        for each in done:
            each.result()
    symaware("merge", folder / "host.mcap", folder / "member.mcap", "--output", folder / "whole.mcap")
    whole, single = open_log(folder / "whole.mcap"), open_log(log)
    for row in range(3):
        for field in ("radar.returns", "gauge.effort"):
            one, other = (each.series(f"robot.{row}", field) for each in (whole, single))
            assert one.values.tobytes() == other.values.tobytes()
