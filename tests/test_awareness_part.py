"""A plugin adds a part of awareness in one file: the example of docs/plugins.md, installed outside the package."""

import csv
import json
from pathlib import Path

import pytest
from documented_plugins import command, install
from simulating import Command

from symaware_cli import open_log

#: One process prepares what all of these tests look at.
pytestmark = pytest.mark.xdist_group("part of awareness")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    points = {"mine.attend": "my_attention:Attend", "mine.notice": "my_attention:Notice"}
    folder = tmp_path_factory.mktemp("attention")
    return install(folder, {"my_attention": '"""Attention'}, points, "attention.yaml")


@pytest.fixture(scope="module")
def symaware(folder: Path) -> Command:
    return command(folder)


@pytest.fixture(scope="module")
def log(folder: Path, symaware: Command) -> Path:
    symaware("run", "attention.yaml", "--quiet", process=True)
    return folder / "attention.mcap"


def test_the_plugin_is_one_file_of_less_than_sixty_lines(folder: Path) -> None:
    lines = (folder / "site" / "my_attention.py").read_text(encoding="utf-8").splitlines()
    assert len(lines) < 60
    assert [line for line in lines if "symaware_cli" in line] == [
        "from symaware_cli import Component, GroupComponent, Parameters, Part, Quantity"
    ]


def test_the_log_has_the_part_with_its_declaration(log: Path) -> None:
    series = open_log(log).series("robot", "attention")
    assert series.columns == ("ahead", "left", "behind", "right")
    assert series.values.shape == (160, 3, 4)
    assert series.values.sum(axis=2) == pytest.approx(1.0)
    part = open_log(log).parts("robot")["attention"]
    assert (part.kind, part.drawn, part.description) == ("vector", "bars", "share of each side")


def test_a_component_that_writes_the_part_may_compute_in_a_separate_process(
    log: Path, folder: Path, symaware: Command
) -> None:
    here = folder / "here.mcap"
    symaware(
        "run", "attention.yaml", "--quiet", "--output", here, "--set", "agents.robot.components.attend.run_in=here"
    )
    one, other = (open_log(path).series("robot", "attention").values for path in (log, here))
    assert one.tobytes() == other.tobytes()


def test_the_part_is_sent_with_awareness_and_found_in_beliefs_about_others(log: Path) -> None:
    told = next(each for each in open_log(log).communications() if each.payload)
    assert len(told.payload["awareness"]["attention"]) == 4
    assert any(event.name == "inattentive" for event in open_log(log).events())


def test_a_condition_and_the_end_of_a_run_may_refer_to_the_part(folder: Path, symaware: Command) -> None:
    condition = "agents.robot.components.steer.condition=attention[3] < 0"
    symaware("run", "attention.yaml", "--quiet", "--output", folder / "still.mcap", "--set", condition)
    assert not open_log(folder / "still.mcap").series("robot", "applied_control").values.any()
    until = 'run.until=max(attention["robot.1"]) > 0.7'
    symaware("run", "attention.yaml", "--quiet", "--output", folder / "ended.mcap", "--set", until)
    greatest = open_log(folder / "ended.mcap").series("robot.1", "attention").values.max(axis=1)
    assert greatest[-1] > 0.7
    assert (greatest[:-1] <= 0.7).all()


def test_a_name_that_is_nearly_that_of_the_part_is_found_out(symaware: Command) -> None:
    done = symaware(
        "validate", "attention.yaml", "--set", "agents.robot.components.steer.condition=attenton[0] < 1", status=2
    )
    assert "did you mean `attention`?" in done.stderr


def test_the_log_alone_suffices_to_inspect_export_plot_and_replay_it(
    log: Path, folder: Path, symaware: Command
) -> None:
    shown = symaware("log", "series", log, "robot.0:attention:ahead", plugin=False)
    assert "ahead [1]" in shown.stdout
    symaware("export", log, "--format", "csv", "--fields", "attention", "--output", folder / "tables", plugin=False)
    with open(folder / "tables" / "attention" / "robot.csv", encoding="utf-8") as file:
        assert next(csv.reader(file)) == ["time", "agent", "ahead", "left", "behind", "right"]
    symaware("export", log, "--format", "foxglove", "--output", folder / "fox.mcap", plugin=False)
    plotted = symaware("plot", log, "--output", folder / "attention.png", "--json", plugin=False)
    panels = {panel["panel"]: panel for panel in json.loads(plotted.stdout)["panels"]}
    assert set(panels["attention of robot.2"]["shares"]) == {"ahead", "left", "behind", "right"}
    alone = symaware("plot", log, "--show", "attention", "--output", folder / "alone.png", "--json", plugin=False)
    assert [panel["panel"] for panel in json.loads(alone.stdout)["panels"]] == [
        f"attention of robot.{row}" for row in range(3)
    ]
    symaware("replay", log, "--save", folder / "attention.rrd", plugin=False)


def test_the_replay_has_bars_beside_the_agents_and_curves_in_their_tabs(
    log: Path, folder: Path, symaware: Command
) -> None:
    from rerun_files import Recording

    symaware("replay", log, "--save", folder / "shown.rrd", plugin=False)
    recording = Recording(folder / "shown.rrd")
    assert recording.values("/awareness/robot/attention", "LineStrips3D:strips")
    assert recording.values("/curves/agents/robot.0/attention", "Scalars:scalars")


def test_it_can_be_left_out_of_the_log(folder: Path, symaware: Command) -> None:
    symaware(
        *("run", "attention.yaml", "--quiet", "--output", folder / "less.mcap", "--set", "recording.omit=[attention]"),
    )
    assert "/agents/robot/attention" not in open_log(folder / "less.mcap").channels
    done = symaware("validate", "attention.yaml", "--set", "recording.omit=[atention]", status=2)
    assert "did you mean `attention`?" in done.stderr


def test_the_schema_for_editors_has_the_part(symaware: Command) -> None:
    schema = json.loads(symaware("schema").stdout)
    assert "attention" in schema["$defs"]["Recording"]["properties"]["omit"]["items"]["enum"]
