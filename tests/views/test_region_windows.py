"""Regions are drawn by the time windows of specifications about them, and links as arrows between agents."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulating import STEP, Team, simulate

from symaware_cli import Component, Quantity, Signal, open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views.detail import detail_of
from symaware_cli.views.region_windows import phases
from symaware_cli.views.scene.marks import ACTIVE, PAST, TO_COME, Lines, Mark, Solid
from symaware_cli.views.scene.scene import scene_of
from symaware_cli.views.views import run_view_of

SECOND = 1_000_000_000
SCENARIO = """
symaware: 1
name: windows
run: {duration: 6.0}
environment: {use: kinematic, with: {time_step: 0.1}}
agents:
  robot:
    count: 2
    state: [[0.0, 0.0], [4.0, 0.0]]
    model: {use: single-integrator}
    knowledge: {goal: [9.0, 0.0]}
    components: {sense: {use: perception.self}, steer: {use: control.go-to-goal}}
regions:
  soon: {box: [0, 1, 0, 1]}
  slot: {around: robot.0, box: [-1, 1, -1, 1]}
  whole: {box: [5, 6, 0, 1]}
specifications:
  visit: {each: robot, from: 2, to: 4, formula: "eventually inside(position, soon)"}
  keep: {each: robot, from: 1, to: 3, formula: "eventually inside(position, slot)"}
  stay: {each: robot, formula: "eventually inside(position, whole)"}
"""


def drawn(path: Path) -> Sequence[Mark]:
    log = open_log(path)
    run_view = run_view_of(log)
    scene = scene_of(run_view, detail_of(run_view), "foxglove")
    return [mark for chunk in scene.chunk_reader().chunks(log.messages(), 2_000) for mark in scene.marks(chunk)]


def test_an_area_is_to_come_until_a_specification_about_it_counts_and_past_afterwards(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    execute(build(tmp_path / "scenario.yaml"), tmp_path / "log.mcap")
    areas: dict[str, list[tuple[float, int]]] = {"soon": [], "slot": []}
    for mark in drawn(tmp_path / "log.mcap"):
        if isinstance(mark, Solid) and mark.name in areas:
            assert mark.phases is not None
            areas[mark.name] += zip((mark.times / SECOND).tolist(), mark.phases.tolist(), strict=True)
        elif isinstance(mark, Solid) and mark.name == "whole":
            assert mark.phases is None
    assert areas["soon"] == [(0.0, TO_COME), (2.0, ACTIVE), (pytest.approx(4.0), PAST)]
    assert [phase for time, phase in areas["slot"] if time in (0.9, 1.0, 3.0, 3.1)] == [TO_COME, ACTIVE, ACTIVE, PAST]


def test_between_two_windows_an_area_is_to_come_again() -> None:
    windows = ((SECOND, 2 * SECOND), (4 * SECOND, None))
    found = phases(windows, np.arange(0, 6) * SECOND)
    assert found.tolist() == [TO_COME, ACTIVE, ACTIVE, TO_COME, ACTIVE, ACTIVE]


LINK = Signal("tows", "table", [Quantity("agent", "1")], drawn="links", description="who is towed")


class Tow(Component):
    """The first robot tows the second one for a while."""

    signals = (LINK,)

    def _compute(self) -> Any:
        return self.now // STEP

    def _update(self, value: Any) -> None:
        if self.agent.row == 0 and value in (1, 3):
            self.record(LINK, np.array([[1.0]]) if value == 1 else np.empty((0, 1)))


def test_links_are_arrows_from_an_agent_to_those_that_a_component_records(tmp_path: Path) -> None:
    simulate({"robot": Team({"tow": Tow}, count=2)}, 6, tmp_path / "log.mcap")
    found = [mark for mark in drawn(tmp_path / "log.mcap") if isinstance(mark, Lines) and "/links/" in mark.path]
    assert {mark.path for mark in found} == {"world/links/tow.tows/robot.0"}
    times = np.concatenate([mark.times for mark in found])
    counts = np.concatenate([np.asarray(mark.counts) for mark in found])
    assert (times[counts > 0] // STEP).tolist() == [1, 2]
    assert (times[counts == 0] // STEP).tolist() == [3, 4, 5, 6]
    first, tip = found[0].points[0], found[0].points[6]
    np.testing.assert_allclose(first + (tip - first) * 0.5, found[0].points[3])  # straight, from one to the other


def test_links_need_a_column_with_the_other_agent() -> None:
    with pytest.raises(ValueError, match="drawn as links, which takes a column `agent`"):
        Signal("tows", "table", [Quantity("other", "1")], drawn="links")
