"""Lanes are drawn once, as a surface and the lines between them."""

from collections.abc import Callable

import numpy as np
from road_groups import group

from symaware_cli import Log
from symaware_cli.roads.lane_drawing import LaneDrawing
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import detail_of
from symaware_cli.views.scene.marks import Lines, Solid
from symaware_cli.views.views import run_view_of


def test_the_lanes_of_a_log_are_drawn_at_its_beginning(drive: Callable[..., Log]) -> None:
    lanes = {"one": {"points": [[0, 0], [50, 0], [100, 20]]}, "two": {"points": [[0, 4], [50, 4]], "width": 4}}
    log = drive({"lanes": lanes}, 0.2, car=group([0, 0, 0], {"use": "control.lane-keeping", "with": {"speed": 5.0}}))
    run_view = run_view_of(log)
    drawing = LaneDrawing(run_view, detail_of(run_view))
    surface, lines = drawing.marks(Chunk({}, {}, {}, 0, 0))
    assert isinstance(surface, Solid)
    assert isinstance(lines, Lines)
    assert len(surface.pieces) == 3
    assert len(np.asarray(lines.lengths)) == 6, "two sides of three legs"
    assert np.abs(lines.points[:, 1]).max() < 24.0
    assert list(drawing.marks(Chunk({}, {}, {}, 1, 1))) == []
    assert list(drawing.legend()) == [("grey areas with lines", "lanes of the road")]
