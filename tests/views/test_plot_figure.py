"""Figures: the same bytes for the same log with any style of the user, and legible for any number of agents."""

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from plot_logs import AIRCRAFT, YARD, log_of
from simulating import present, untyped

from symaware_cli import Log
from symaware_cli.log.error import LogError, OutputError, UnknownNameError
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.figure import _Layout, prepared
from symaware_cli.views.plotting.paper_preset import GREY_SAFE, PRESETS
from symaware_cli.views.plotting.plane import extent
from symaware_cli.views.plotting.plot import plot
from symaware_cli.views.plotting.request import PlotRequest, SeriesName
from symaware_cli.views.scale_bar import round_interval


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return log_of(tmp_path_factory.mktemp("yard"), YARD)


def drawn(log: Log, request: PlotRequest = PlotRequest()) -> Figure:  # noqa: B008 (it is frozen)
    sheet, fill = prepared(gather(log, request), request.title)
    with sheet.drawn(request.size, fill) as figure:
        return figure


def titles(figure: Figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]


@pytest.mark.parametrize("suffix", [".PNG", ".svg", ".pdf", ".pgf"])
def test_the_same_log_gives_the_same_bytes_with_any_style_of_the_user(suffix: str, yard: Log, tmp_path: Path) -> None:
    request = PlotRequest(show=("trajectories", "risk"), dpi=50)
    plot(yard, tmp_path / f"one{suffix}", request)
    with mpl.rc_context({"font.size": 20, "axes.facecolor": "red", "svg.hashsalt": "other"}):
        mine = dict(mpl.rcParams)
        plot(yard, tmp_path / f"other{suffix}", request)
        assert dict(mpl.rcParams) == mine
    one = (tmp_path / f"one{suffix}").read_bytes()
    assert one == (tmp_path / f"other{suffix}").read_bytes()
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF", ".pgf": b"% A figure"}
    assert one.startswith(starts[suffix.lower()])
    assert not re.search(rb"matplotlib v|CreationDate|<dc:date>", one)


def test_a_figure_has_the_size_that_is_asked_for(yard: Log, tmp_path: Path) -> None:
    plot(yard, tmp_path / "small.png", PlotRequest(show=("separation",), size=(3.5, 2.5), dpi=100))
    header = (tmp_path / "small.png").read_bytes()[16:24]
    assert np.frombuffer(header, ">u4").tolist() == [350, 250]


def test_panels_that_do_not_fit_are_refused_before_anything_is_written(yard: Log, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="5 panels do not fit into 3 x 2 inches"):
        plot(yard, tmp_path / "small.png", PlotRequest(size=(3.0, 2.0)))
    assert list(tmp_path.iterdir()) == []


def test_names_are_written_literally(yard: Log) -> None:
    figure = drawn(yard, PlotRequest(title=r"a $\frac{1 of _b_", show=("risk",)))
    assert figure.get_suptitle() == r"a $\frac{1 of _b_"


def test_a_title_that_the_font_cannot_write_is_refused_before_anything_is_written(yard: Log, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="the font cannot write '字' in the title"):
        plot(yard, tmp_path / "a.png", PlotRequest(title="one 字"))
    assert list(tmp_path.iterdir()) == []


def test_panels_have_their_units_and_the_closest_two_are_named(yard: Log) -> None:
    figure = drawn(yard)
    assert titles(figure) == [
        "trajectories, bodies at 3 s",
        "least separation [m]",
        "contacts",
        "risk",
        "speed [m/s], mean over 0.5 s",
    ]
    remarks = [axes.get_title(loc="right") for axes in figure.axes]
    assert any(re.fullmatch(r"● -0\.\d+ m, .+ and .+ at [\d.]+ s", remark) for remark in remarks)
    assert figure.get_suptitle() == "yard: 3 agents, seed 0"


def test_bodies_and_intents_are_shown_at_the_time_that_is_asked_for(yard: Log) -> None:
    content = gather(yard, PlotRequest(at=1.0))
    plane = content.panels[0]
    assert untyped(plane).motion.times[untyped(plane).at] == 10**9
    assert set(untyped(plane).intents) == {"cart.0", "cart.1", "guard"}
    np.testing.assert_allclose(
        untyped(plane).intents["cart.0"][0], yard.series("cart.0", "world").values[20, :2], atol=1e-9
    )
    assert titles(drawn(yard, PlotRequest(at=1.0)))[0] == "trajectories, bodies at 1 s"
    assert untyped(gather(yard, PlotRequest()).panels[0]).intents == {}


def test_known_goals_are_drawn(yard: Log) -> None:
    goals = untyped(gather(yard, PlotRequest()).panels[0]).goals
    assert goals["cart.0"].tolist() == [[2, 0]]
    assert goals["guard"].tolist() == [[-1, -1], [1, -1]]


def test_the_plane_shows_agents_and_their_surroundings_but_not_the_end_of_a_long_wall(
    tmp_path: Path, yard: Log
) -> None:
    low, high = extent(untyped(gather(yard, PlotRequest()).panels[0]))
    assert (low < [-3.1, -2.1]).all()
    assert (high > [3.1, 2.5]).all()
    long = YARD.replace("[3, -2], [3, 4]", "[3, -2], [3, 4000]")
    low, high = extent(untyped(gather(log_of(tmp_path, long), PlotRequest()).panels[0]))
    assert high[1] < 10


def test_a_standing_agent_has_a_plane_of_some_size(tmp_path: Path) -> None:
    still = log_of(
        tmp_path,
        "hello.yaml",
        "run.duration=0.1",
        "agents.robot.count=1",
        "agents.robot.knowledge={}",
        "agents.robot.components={}",
    )
    low, high = extent(untyped(gather(still, PlotRequest()).panels[0]))
    assert (high - low > 0.1).all()
    plot(still, tmp_path / "still.png")


@pytest.mark.parametrize("count", [1, 10, 60])
def test_one_ten_and_many_agents_are_drawn_without_a_warning(count: int, tmp_path: Path) -> None:
    log = log_of(tmp_path, "circle-swap.yaml", "run.duration=1", f"agents.robot.count={count}")
    figure = drawn(log)
    shown = "\n".join(text.get_text() for axes in figure.axes for text in axes.texts)
    assert ("median" in shown) == (count > 20)
    legends = [
        text.get_text() for axes in figure.axes if axes.get_legend() for text in present(axes.get_legend()).get_texts()
    ]
    assert ("robot.0" in legends) == (count <= 20)


def test_many_agents_of_two_groups_have_the_colours_of_their_groups(tmp_path: Path) -> None:
    teams = YARD.replace("count: 2\n", "count: 30\n").replace(
        "state: [[-2, 0, 0], [2, 0.3, 3.14]]", "state: {circle: {radius: 4}}"
    )
    teams = teams.replace("goal: [[2, 0], [-2, 0.3]]", "goal: [0, 0]")
    figure = drawn(log_of(tmp_path, teams, "run.duration=0.5"))
    legends = [
        text.get_text() for axes in figure.axes if axes.get_legend() for text in present(axes.get_legend()).get_texts()
    ]
    assert {"cart", "guard"} <= set(legends)


def test_a_view_from_above_of_space_is_labelled(tmp_path: Path) -> None:
    log = log_of(tmp_path, AIRCRAFT, "run.duration=0.5")
    assert titles(drawn(log))[0].startswith("trajectories from above")


def test_a_single_instant_is_drawn(yard: Log, tmp_path: Path) -> None:
    plot(yard, tmp_path / "instant.svg", PlotRequest(start=1.0, end=1.0))
    plot(yard, tmp_path / "series.svg", PlotRequest(series=(SeriesName("cart", "risk"),), start=1.0, end=1.0))


def test_a_wide_plane_stands_above_the_other_panels_and_a_tall_one_leaves_them_room() -> None:
    assert _Layout.of(5.0, 3).above
    assert not _Layout.of(1.0, 3).above
    assert not _Layout.of(5.0, 0).above
    assert _Layout.of(0.1, 2).size[1] < 10
    assert _Layout.of(None, 8).columns == 2
    for ratio in (None, 0.05, 1.0, 30.0):
        for count in range(ratio is None, 17):
            layout = _Layout.of(ratio, count)
            figure = Figure(figsize=layout.size)
            places = layout.places(figure.add_gridspec(1, 1)[0], count)
            assert len(places) == count + (ratio is not None)
            boxes = [place.get_position(figure) for place in places]
            assert all(box.width > 0 and box.height > 0 for box in boxes)
            assert len({(box.x0, box.y0) for box in boxes}) == len(boxes)


@pytest.mark.parametrize(("span", "interval"), [(12, 2), (34, 5), (65, 10), (0.4, 0.05), (1e6, 1e5), (0, 1)])
def test_intervals_are_round(span: float, interval: float) -> None:
    assert round_interval(span) == pytest.approx(interval)


def test_a_name_that_cannot_be_drawn_leaves_nothing(yard: Log, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError) as caught:
        plot(yard, tmp_path / "a.pgn")
    assert caught.value.known == (".png", ".svg", ".pdf", ".pgf")
    with pytest.raises(UnknownNameError, match="a name without a suffix"):
        plot(yard, tmp_path / "a")
    for request in (PlotRequest(size=(1.0, 1.0)), PlotRequest(size=(60.0, 60.0), dpi=1200)):
        with pytest.raises(LogError):
            plot(yard, tmp_path / "a.png", request)
    with pytest.raises(OutputError):
        plot(yard, tmp_path / "missing" / "a.png")
    with pytest.raises(LogError):
        plot(yard, yard.path.with_suffix(".mcap"))
    assert list(tmp_path.iterdir()) == []


def test_a_preset_has_the_width_and_the_type_of_a_column_and_colours_that_differ_in_grey(
    yard: Log, tmp_path: Path
) -> None:
    request = PlotRequest(show=("trajectories", "risk"), preset=PRESETS["ieee-column"])
    plot(yard, tmp_path / "a.svg", request)
    text = (tmp_path / "a.svg").read_text()
    assert re.search(r'<svg[^>]*width="252pt"', text)
    assert "STIXGeneral" in text
    assert {line.colour for line in gather(yard, request).chosen.lines} <= {*GREY_SAFE}


def test_text_in_an_svg_stays_text(yard: Log, tmp_path: Path) -> None:
    plot(yard, tmp_path / "a.svg", PlotRequest(show=("separation",)))
    assert "simulated time [s]</text>" in (tmp_path / "a.svg").read_text()
