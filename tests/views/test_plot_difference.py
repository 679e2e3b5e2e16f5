"""Figures of two runs show both, the time and place at which they part, and their distance."""

from pathlib import Path

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import compare
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.error import LogError
from symaware_cli.log.reader import open_log
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.panels import Trajectories
from symaware_cli.views.plotting.plot import plot_logs

SCENARIOS = CHECKOUT / "scenarios"
HELLO = SCENARIOS / "hello.yaml"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    execute(build(HELLO, ["run.duration=2"]), folder / "one.mcap")
    execute(build(HELLO, ["run.duration=1", "agents.robot.state.circle.radius=4"]), folder / "moved.mcap")
    execute(build(SCENARIOS / "gusts.yaml", ["run.duration=0.5"]), folder / "others.mcap")
    return folder


def test_the_distance_is_that_of_the_recorded_states_and_ends_with_the_shorter_run(logs: Path, tmp_path: Path) -> None:
    one, moved = open_log(logs / "one.mcap"), open_log(logs / "moved.mcap")
    content = plot_logs(one, moved, tmp_path / "apart.svg", since=0)
    trajectories, apart = content.panels[:2]
    assert isinstance(trajectories, Trajectories)
    assert isinstance(apart, PlottedCurves)
    assert trajectories.compared is not None
    first, second = trajectories.motion, trajectories.compared
    for instant, row in zip(apart.times, apart.values, strict=True):
        if instant > 1_000_000_000:
            assert np.isnan(row).all()
        else:
            steps = first.index(int(instant)), second.index(int(instant))
            difference = second.positions[steps[1]] - first.positions[steps[0]]
            assert np.allclose(row, np.sqrt((difference * difference).sum(axis=1)), atol=1e-12)
    # The two runs part at the starts of the robots.
    assert np.allclose(trajectories.departures["robot.0"], first.positions[0, 0, :2])
    assert "one.mcap (solid) and moved.mcap (dashed)" in (tmp_path / "apart.svg").read_text()


def test_equal_runs_are_nowhere_apart(logs: Path, tmp_path: Path) -> None:
    one = open_log(logs / "one.mcap")
    content = plot_logs(one, one, tmp_path / "same.svg", since=None)
    trajectories, apart = content.panels
    assert isinstance(trajectories, Trajectories)
    assert isinstance(apart, PlottedCurves)
    assert not trajectories.departures
    assert not apart.values.any()


def test_a_figure_needs_two_logs_with_agents_in_common(logs: Path, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="a figure of differences needs two logs"):
        compare(HELLO, logs / "one.mcap", tmp_path / "none.svg")
    with pytest.raises(LogError, match="have no agent in common"):
        compare(logs / "one.mcap", logs / "others.mcap", tmp_path / "none.svg")
    assert not (tmp_path / "none.svg").exists()
