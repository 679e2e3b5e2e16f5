"""A replay shows regions with their names, the robustness of specifications, and who violates one."""

from collections.abc import Sequence

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views.detail import detail_of
from symaware_cli.views.scene.marks import Curves, Mark, Rings, Solid
from symaware_cli.views.scene.scene import scene_of
from symaware_cli.views.views import run_view_of

SCENARIO = CHECKOUT / "scenarios" / "shortcut.yaml"


@pytest.fixture(scope="module")
def marks(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Mark]:
    path = tmp_path_factory.mktemp("log") / "shortcut.mcap"
    overrides = ["run.duration=10", 'regions.slot={"around": "robot.0", "box": [-3, -1, -1, 1]}']
    execute(build(SCENARIO, overrides), path)
    log = open_log(path)
    run_view = run_view_of(log)
    scene = scene_of(run_view, detail_of(run_view), "replay")
    return [mark for chunk in scene.chunk_reader().chunks(log.messages()) for mark in scene.marks(chunk)]


def test_regions_are_areas_with_names_the_largest_lowest(marks: Sequence[Mark]) -> None:
    areas = {mark.name: mark for mark in marks if isinstance(mark, Solid) and mark.path.startswith("world/regions/")}
    assert set(areas) == {"arena", "wall", "pickup", "shelf", "slot"}
    assert all(mark.label == name and mark.low == mark.high for name, mark in areas.items())
    assert areas["arena"].low == min(mark.low for mark in areas.values())
    assert isinstance(areas["wall"], Solid)
    np.testing.assert_allclose(areas["wall"].outlines[0], [[17, 0], [21, 0], [21, 14], [17, 14]])


def test_a_region_around_an_agent_moves_and_turns_with_it(marks: Sequence[Mark]) -> None:
    (slot,) = [mark for mark in marks if isinstance(mark, Solid) and mark.name == "slot"]
    assert len(slot.times) == 101
    np.testing.assert_allclose(slot.positions[0, :2], [4, 14])
    assert slot.positions[-1, 0] > 20
    assert not np.allclose(slot.orientations[0], slot.orientations[-1])


def test_each_specification_has_a_curve_for_each_row_and_a_line_at_zero(marks: Sequence[Mark]) -> None:
    curves = {mark.path: mark for mark in marks if isinstance(mark, Curves)}
    apart = curves["curves/specifications/apart"]
    assert list(apart.names) == ["robot.0 and robot.1", "robot.0 and robot.2", "robot.1 and robot.2"]
    assert apart.level == ("violated below", 0.0)
    assert apart.values[0, 0] > 0 > apart.values[-1, 0]
    assert list(curves["curves/specifications/safe"].names) == ["robot.0", "robot.1", "robot.2"]


def test_an_agent_that_violates_a_specification_has_a_ring_from_then_on(marks: Sequence[Mark]) -> None:
    rings = {mark.path: mark for mark in marks if isinstance(mark, Rings) and "violations" in mark.path}
    assert set(rings) == {"world/violations/robot.0", "world/violations/robot.1"}
    assert rings["world/violations/robot.1"].times[0] == 2_600_000_000
