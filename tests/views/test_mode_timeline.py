"""Strips of modes in plots: verdicts of specifications, and signals that take few values."""

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import Log, open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.line_styles import LineStyle
from symaware_cli.views.plotting.mode_timeline import ModeTimeline, strips_of
from symaware_cli.views.plotting.request import PlotRequest, Window
from symaware_cli.views.scene.specification_marks import verdict_in_words


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    path = tmp_path_factory.mktemp("log") / "shortcut.mcap"
    execute(build(CHECKOUT / "scenarios" / "shortcut.yaml", ["run.duration=10"]), path)
    return open_log(path)


def timeline(log: Log, name: str) -> ModeTimeline:
    (panel,) = gather(log, PlotRequest(show=(name,))).panels
    assert isinstance(panel, ModeTimeline)
    return panel


def test_each_specification_has_a_strip_of_its_verdicts(log: Log) -> None:
    strips = {strip.name: strip for strip in timeline(log, "verdicts").strips}
    assert {"safe", "fetch", "apart"} <= set(strips)
    modes = [phase.mode for phase in strips["safe"].phases]
    assert modes[0] == "undecided"
    assert "violated" in modes[-1]
    for strip in strips.values():
        assert [phase.end for phase in strip.phases[:-1]] == [phase.start for phase in strip.phases[1:]]


def test_verdicts_of_several_rows_are_counted() -> None:
    said = [([0], "undecided"), ([1], "satisfied"), ([-1], "violated"), ([1, 0], "1 of 2 satisfied")]
    said += [([1, -1, -1], "2 of 3 violated"), ([1, 1], "satisfied"), ([0, 0], "undecided")]
    for verdicts, words in said:
        assert verdict_in_words(np.array(verdicts, np.int8)) == words


def test_a_signal_of_few_whole_numbers_is_a_strip_and_others_are_curves() -> None:
    window, times = Window(0, 4, 4), np.array([0, 1, 2, 3, 4])
    line = (LineStyle("a", "#112233"),)

    def shown(values: list[float], unit: str = "") -> ModeTimeline | None:
        return strips_of(PlottedCurves("switched", unit, times, np.array(values)[:, None], line, stepwise=True), window)

    strips = shown([0, 0, 1, 1, 0])
    assert strips is not None
    assert [(phase.start, phase.end, phase.mode) for phase in strips.strips[0].phases] == [
        (0, 2, "0"),
        (2, 4, "1"),
        (4, 4, "0"),
    ]
    assert shown([0, 0.5, 1, 1, 0]) is None
    assert shown([0, 1, 2, 3, 4]) is None
    assert shown([0, 0, 1, 1, 0], "m") is None


def test_contacts_near_each_other_share_a_ring_with_their_number() -> None:
    from symaware_cli.views.plotting.plane import _clusters

    points = np.array([[0.0, 0.0], [0.1, 0.0], [5.0, 5.0]])
    assert _clusters(points, 0.5) == [((0.05, 0.0), 2), ((5.0, 5.0), 1)]
