"""A plot shows specifications with a line at zero, and regions under the trajectories."""

from pathlib import Path

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.panels import Content, Trajectories
from symaware_cli.views.plotting.request import PlotRequest

SCENARIO = CHECKOUT / "scenarios" / "shortcut.yaml"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "shortcut.mcap"
    execute(build(SCENARIO, ["run.duration=10"]), path)
    return path


def content(log: Path, **request: tuple[str, ...]) -> Content:
    return gather(open_log(log), PlotRequest(**request))  # type: ignore[arg-type]


def test_each_specification_has_a_panel_with_a_line_at_zero(log: Path) -> None:
    panels = {panel.name: panel for panel in content(log).panels}
    apart = panels["specification apart"]
    assert isinstance(apart, PlottedCurves)
    assert apart.level == 0.0
    assert [line.name for line in apart.lines] == ["robot.0 and robot.1", "robot.0 and robot.2", "robot.1 and robot.2"]
    assert apart.values[0, 0] > 0 > apart.values[-1, 0]


def test_only_specifications_of_chosen_agents_are_shown(log: Path) -> None:
    shown = content(log, agents=("robot.0",))
    panels = {panel.name: panel for panel in shown.panels}
    assert "specification apart" not in panels
    safe = panels["specification safe"]
    assert isinstance(safe, PlottedCurves)
    assert [line.name for line in safe.lines] == ["robot.0"]


def test_trajectories_have_regions(log: Path) -> None:
    (plane,) = [panel for panel in content(log).panels if isinstance(panel, Trajectories)]
    regions = {mark.label: mark.outlines for mark in plane.regions}
    assert set(regions) == {"arena", "pickup", "shelf", "wall"}
    np.testing.assert_allclose(regions["pickup"][0], [[30, 2], [38, 2], [38, 10], [30, 10]])
