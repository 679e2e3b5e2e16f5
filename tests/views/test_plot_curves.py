"""Quantities over time, and the agents that they belong to."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plot_logs import AIRCRAFT, YARD, log_of
from sensing_log import write_sensing
from simulating import present, untyped

from symaware_cli import Log, open_log
from symaware_cli.log import wire
from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.log.writer import LogWriter
from symaware_cli.views.chunk import ChunkReader
from symaware_cli.views.palette import hexadecimal
from symaware_cli.views.plotting.content import choose, gather
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.line_styles import LineStyle
from symaware_cli.views.plotting.motion import held
from symaware_cli.views.plotting.plot import plot
from symaware_cli.views.plotting.request import PlotRequest, SeriesName
from symaware_cli.views.views import run_view_of


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return log_of(tmp_path_factory.mktemp("yard"), YARD)


def panels(log: Log, **request: Any) -> dict[str, Any]:
    names = tuple(SeriesName.parse(name) for name in request.pop("series", ()))
    return {panel.name: panel for panel in gather(log, PlotRequest(series=names, **request)).panels}


def test_a_value_holds_until_the_next_and_is_unknown_before_the_first() -> None:
    values = held(np.array([10, 20]), np.array([[1.0], [2.0]]), np.array([5, 10, 15, 20, 99]))
    np.testing.assert_array_equal(values[:, 0], [np.nan, 1, 1, 2, 2])


def test_a_log_has_the_panels_that_it_has_data_for(tmp_path: Path, yard: Log) -> None:
    assert list(panels(yard)) == ["trajectories", "separation", "contacts", "risk", "speed"]
    assert list(panels(log_of(tmp_path, "hello.yaml", "run.duration=0.2"))) == ["trajectories", "separation", "speed"]
    assert list(panels(log_of(tmp_path, AIRCRAFT, "run.duration=0.5")))[-1] == "altitude"
    alone = log_of(tmp_path, "hello.yaml", "run.duration=0.2", "agents.robot.count=1")
    assert list(panels(alone)) == ["trajectories", "speed"]


def test_panels_come_in_the_order_in_which_they_are_asked_for(yard: Log) -> None:
    shown = panels(yard, show=("risk", "control"))
    assert list(shown) == [*("risk", "control speed", "control turn_rate", "control velocity_x", "control velocity_y")]
    assert [line.name for line in shown["control speed"].lines] == ["cart.0", "cart.1"]
    assert [line.name for line in shown["control velocity_x"].lines] == ["guard"]


def test_a_log_of_many_chunks_has_the_same_plot(yard: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    request = PlotRequest(show=("trajectories", "separation", "risk", "speed", "control", "state"), at=1.0)
    whole = gather(yard, request)
    monkeypatch.setattr(ChunkReader.chunks, "__defaults__", (2_000,))
    chunked = gather(yard, request)
    assert chunked.facts() == whole.facts()
    one, other = whole.panels[0], chunked.panels[0]
    for field in ("goals", "intents"):
        assert {name: points.tolist() for name, points in getattr(one, field).items()} == {
            name: points.tolist() for name, points in getattr(other, field).items()
        }


def test_speed_is_that_of_the_true_positions(yard: Log) -> None:
    speed = panels(yard, show=("speed",))["speed"]
    assert [line.name for line in speed.lines] == ["cart.0", "cart.1", "guard"]
    truth = yard.series("cart.0", "world")
    middle = len(truth.times) // 2
    before, after = truth.values[middle - 5, :2], truth.values[middle + 5, :2]
    assert speed.values[middle, 0] == pytest.approx(np.linalg.norm(after - before) / 0.5)
    value, _, who = speed.extreme()
    assert value <= 1.0 + 1e-9
    assert who in ("cart.0", "cart.1", "guard")


def test_risk_is_the_present_one_of_those_that_have_one(yard: Log) -> None:
    risk = panels(yard, show=("risk",))["risk"]
    recorded = yard.series("cart.0", "risk")
    assert [line.name for line in risk.lines] == ["cart.0", "cart.1"]
    at = np.searchsorted(risk.times, recorded.times)
    np.testing.assert_array_equal(risk.values[at, 0], recorded.values[:, 0])
    assert risk.facts()["maximum"]["value"] == np.nanmax(risk.values)


def test_the_altitude_is_the_third_coordinate(tmp_path: Path) -> None:
    altitude = panels(log_of(tmp_path, AIRCRAFT, "run.duration=0.5"), show=("altitude",))["altitude"]
    assert altitude.values[0].tolist() == [100.0, 112.0]
    assert altitude.unit == "m"


def test_a_series_by_name_has_a_panel_for_each_column(yard: Log) -> None:
    shown = panels(yard, series=["cart.0:world"])
    assert {name: curves.unit for name, curves in shown.items()} == {"x": "m", "y": "m", "heading": "rad"}
    truth = yard.series("cart.0", "world")
    np.testing.assert_array_equal(shown["x"].times, truth.times)
    np.testing.assert_array_equal(shown["x"].values[:, 0], truth.values[:, 0])
    assert list(panels(yard, series=["cart.0:world:heading"])) == ["heading"]
    assert list(panels(yard, series=["cart.0:world:2"])) == ["heading"]


def test_series_of_one_quantity_share_a_panel_in_different_styles(yard: Log) -> None:
    shown = panels(yard, series=["cart.0:world:x", "cart.1:world:x", "gate:world:x"])
    assert [line.name for line in shown["x"].lines] == ["cart.0", "cart.1", "gate"]
    assert len({line.colour for line in shown["x"].lines}) == 3
    both = panels(yard, series=["cart:world:x", "cart:state:x"])["x"].lines
    assert [line.name for line in both] == ["cart.0 world", "cart.1 world", "cart.0 state", "cart.1 state"]
    assert [line.dashed for line in both] == [False, False, True, True]


def test_a_window_begins_with_the_values_before_it(yard: Log) -> None:
    times = panels(yard, series=["guard:applied_control:0"], start=1.01, end=1.52)["velocity_x"].times
    assert (times[0], times[-1]) == (1_010_000_000, 1_520_000_000)
    truth = panels(yard, show=("trajectories",), start=1.01, end=1.52)["trajectories"].motion.times
    assert (truth[0], truth[-1]) == (1_050_000_000, 1_500_000_000)


@pytest.mark.parametrize(
    ("request_of", "name", "known"),
    [
        ({"agents": ("cart.7",)}, "cart.7", "cart.1"),
        ({"series": ["fense:world"]}, "fense", "fence"),
        ({"series": ["cart.0:wordl"]}, "wordl", "world"),
        ({"series": ["cart.0:world:haeding"]}, "haeding", "heading"),
        ({"show": ("trajectory",)}, "trajectory", "trajectories"),
    ],
    ids=str,
)
def test_unknown_names_are_reported_with_the_known_ones(
    yard: Log, request_of: dict[str, Any], name: str, known: str
) -> None:
    with pytest.raises(UnknownNameError) as caught:
        panels(yard, **request_of)
    assert caught.value.name == name
    assert known in caught.value.known


@pytest.mark.parametrize(
    "request_of",
    [
        {"series": ["fence:world"]},
        {"series": ["guard:risk"]},
        {"series": ["cart"]},
        {"series": ["cart:world:x:y"]},
        {"series": ["cart:world"], "agents": ("guard",)},
        {"show": ("altitude",)},
        {"show": ("risk",), "agents": ("guard",)},
        {"start": 3.5},
        {"end": -1.0},
        {"start": 2.0, "end": 1.0},
        {"at": 9.0},
    ],
    ids=str,
)
def test_requests_without_values_are_refused_in_one_line(yard: Log, request_of: dict[str, Any]) -> None:
    with pytest.raises(LogError) as caught:
        panels(yard, **request_of)
    assert "\n" not in str(caught.value)


def test_agents_are_plotted_as_if_there_were_no_others(yard: Log) -> None:
    content = gather(yard, PlotRequest(agents=("cart.1", "guard")))
    assert content.chosen.agents == ("cart.1", "guard")
    assert untyped(content.panels[0]).motion.positions.shape[1] == 2
    assert content.facts()["agents"] == 2


def test_colours_are_those_of_the_replay_and_nobody_has_those_of_another(tmp_path: Path) -> None:
    log = log_of(tmp_path, "hello.yaml", "run.duration=0.05", "agents.robot.count=14")
    run_view = run_view_of(log)
    lines = choose(run_view).lines
    assert [line.colour for line in lines] == [hexadecimal(colour) for colour in run_view.group_views["robot"].colours]
    assert len({(line.colour, line.dashed) for line in lines}) == 14


def test_a_few_chosen_agents_of_many_have_different_colours(tmp_path: Path) -> None:
    log = log_of(tmp_path, "hello.yaml", "run.duration=0.05", "agents.robot.count=40")
    everybody = choose(run_view_of(log))
    assert everybody.many
    assert len({line.colour for line in everybody.lines}) == 1
    few = choose(run_view_of(log), ["robot.3", "robot.30"])
    assert not few.many
    assert len({line.colour for line in few.lines}) == 2


def test_an_infinite_value_is_no_extreme() -> None:
    times = np.arange(2) * 10**9
    curves = PlottedCurves(
        "x", "", times, np.array([[np.nan, 1.0], [np.inf, 0.0]]), (LineStyle("a", "#000"), LineStyle("b", "#000"))
    )
    assert curves.extreme() == (1.0, 0.0, "b")
    assert curves.extreme(-1) == (0.0, 1.0, "b")
    nothing = PlottedCurves("x", "", times, np.full((2, 1), np.nan), (LineStyle("a", "#000"),))
    assert nothing.extreme() is None


def test_beliefs_stand_in_for_a_truth_that_was_not_recorded(tmp_path: Path) -> None:
    log = log_of(tmp_path, "hello.yaml", "run.duration=0.5", "recording.omit=[world]")
    content = gather(log, PlotRequest())
    assert untyped(content.panels[0]).believed == ("robot",)
    assert "states of robot are believed" in content.notes[0]
    bare = log_of(tmp_path, "hello.yaml", "run.duration=0.5", "recording.omit=[world, state]")
    assert gather(bare, PlotRequest(show=("control",))).panels
    with pytest.raises(LogError, match="holds nothing to plot"):
        gather(bare, PlotRequest())


def test_a_group_whose_states_are_lost_does_not_take_the_others_along(yard: Log, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "part.mcap") as writer:
        writer.attach("manifest.json", "application/json", yard.attachments["manifest.json"])
        channel = writer.channel("/world/cart/state", "Rows", {"columns": "x,y,heading", "units": "m,m,rad"})
        for time in (0, 10**9):
            writer.add(channel, time, wire.encode_rows(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])))
        writer.finish({"status": "finished"})
    plane, separation, speed = gather(open_log(tmp_path / "part.mcap"), PlotRequest()).panels
    assert np.isnan(untyped(plane).motion.positions[:, 2, :2]).all()
    assert present(untyped(separation).agents).pair.tolist() == [[0, 1], [0, 1]]
    assert untyped(speed).extreme() == (0.0, 0.0, "cart.0")
    plot(open_log(tmp_path / "part.mcap"), tmp_path / "part.png")


def test_readings_are_series_by_the_name_of_their_sensor(tmp_path: Path) -> None:
    log = open_log(write_sensing(tmp_path / "sensing.mcap"))
    shown = panels(log, series=("robot:inertia:rate_z", "robot.1:bumper"))
    assert [(panel.name, panel.unit) for panel in shown.values()] == [
        ("rate_z", "rad/s"),
        ("touching", "1"),
        ("impulse", "N s"),
    ]
    series = log.series("robot", "inertia")
    at = held(series.times, series.column("rate_z"), shown["rate_z"].times)
    np.testing.assert_array_equal(shown["rate_z"].values, at)
    assert shown["touching"].stepwise
    with pytest.raises(UnknownNameError, match="there is no field 'inerta'") as refusal:
        panels(log, series=("robot:inerta",))
    assert "inertia" in refusal.value.known
