"""A robustness of -inf is the least of all: a picture shows it below all others, rather than as a gap."""

from pathlib import Path

import numpy as np
import pytest
from checkout import CHECKOUT
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rerun_files import saved

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.reader import Log
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.line_styles import LineStyle
from symaware_cli.views.plotting.request import PlotRequest
from symaware_cli.views.plotting.time import draw_curves
from symaware_cli.views.scene.specification_marks import _bars

NEVER = -np.inf


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    path = tmp_path_factory.mktemp("log") / "simplex.mcap"
    execute(build(CHECKOUT / "scenarios" / "simplex.yaml", ["run.duration=4"]), path)
    return open_log(path)


def curves(*columns: list[float], name: str = "specification seen", named: bool = True) -> PlottedCurves:
    values = np.array(columns, float).T
    lines = tuple(LineStyle(f"robot.{number}", "#123456") for number in range(values.shape[1]))
    times = np.arange(len(values), dtype=np.int64) * 1_000_000_000
    return PlottedCurves(name, "", times, values, lines, stepwise=True, level=0.0 if named else None, named=named)


def drawn(content: PlottedCurves) -> tuple[list[str], list[NDArray[np.float64]]]:
    """Return the words in a panel, and the heights of each line of more than two points."""
    axes = Figure().add_subplot()
    draw_curves(axes, content)
    lines = [np.asarray(line.get_ydata(), float) for line in axes.lines]
    return [text.get_text() for text in axes.texts], [heights for heights in lines if len(heights) > 2]


def test_the_least_of_many_curves_falls_below_all_others_and_has_the_name_of_those_that_fell() -> None:
    many = [[0.8, 0.8, 0.7]] * 7 + [[0.9, NEVER, NEVER], [0.9, 0.9, NEVER]]
    words, (least,) = drawn(curves(*many))
    assert least[0] == 0.8
    assert least[1] == least[2] < 0.0
    assert "-inf" in words
    assert "least of 9: robot.7, and 1 more, -inf; 2 below 0" in words


def test_of_few_curves_only_the_one_that_fell_is_at_the_lower_edge() -> None:
    words, (one, other) = drawn(curves([1.0, 0.5, 0.5], [1.0, NEVER, NEVER]))
    np.testing.assert_array_equal(one, [1.0, 0.5, 0.5])
    assert other[1] == other[2] < 0.0
    assert "-inf" in words


def test_an_infinite_risk_is_the_highest() -> None:
    risk = curves([0.0, np.inf, 0.2], [0.0, 0.5, 0.5], name="risk", named=False)
    assert risk.extreme() == (np.inf, 1.0, "robot.0")
    _, (one, other) = drawn(risk)
    assert one[1] > other.max()


def test_infinite_values_of_other_quantities_are_gaps() -> None:
    words, _ = drawn(curves([1.0, np.inf, 2.0], [1.0, 1.0, 1.0], name="range", named=False))
    assert words == []


def test_facts_of_a_plot_have_the_least_of_all_curves(log: Log) -> None:
    panels = {panel.name: panel for panel in gather(log, PlotRequest()).panels}
    facts = panels["specification sees"].facts()
    assert facts["minimum"] == {"value": NEVER, "time": 3.0, "who": ["watcher and robot.0"]}


def test_in_a_replay_a_triangle_marks_that_the_least_is_infinite(log: Log, tmp_path: Path) -> None:
    recording = saved(log, tmp_path)
    path = "/curves/specifications/sees/bottomless/0"
    assert recording.times(path, "Scalars:scalars")[0] == 3_000_000_000
    assert {height for row in recording.values(path, "Scalars:scalars") for height in row} == {0.0}
    assert "/curves/specifications/apart/bottomless/0" not in recording.entities


def test_the_table_of_a_replay_says_that_a_robustness_is_infinite() -> None:
    assert _bars(np.array([NEVER, 2.0, np.nan])) == [("-inf", ""), ("2.000", "`████████████████`"), ("", "")]
