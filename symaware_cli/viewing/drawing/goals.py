"""Where agents are to go, as far as their knowledge tells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording.json_text import read_json
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import FEW, Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.palette import faded
from symaware_cli.viewing.rerun_output import RerunOutput
from symaware_cli.viewing.views import GroupView, RunView, in_space

Array = NDArray[np.float64]


#: What goals and waypoints are called in knowledge databases.
_NAMES = ("goal", "target", "waypoint", "waypoints")


class Goals(Drawing):
    """Goals as crosses, waypoints as crosses joined by lines, each in its agent's colour.

    They are what the knowledge calls ``goal``, ``target``, ``waypoint`` or ``waypoints``.
    """

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        self._known: dict[str, list[list[Array]]] = {
            group_view.name: [[] for _ in group_view.agents] for group_view in run_view.group_views.values()
        }

    def begin(self) -> None:
        """Put up how thick the lines are."""
        import rerun as rr

        for group_view in self.run_view.group_views.values():
            width = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([1.5 if self._few else 0.75]))
            self.output.static(f"world/agents/{group_view.name}/goal", width)

    def draw(self, chunk: Chunk) -> None:
        """Draw the goals that became known."""
        for group_view in self.run_view.group_views.values():
            told = chunk.entries.get(f"/agents/{group_view.name}/knowledge", ())
            for place, (time, message) in enumerate(told):
                rows = message.rows or range(len(message.values))
                for row, value in zip(rows, message.values, strict=True):
                    self._known[group_view.name][row] = known_ways(read_json(value), len(group_view.position))
                if place + 1 == len(told) or told[place + 1][0] > time:
                    self._draw(group_view, time)

    def _draw(self, group_view: GroupView, time: int) -> None:
        size = 0.8 * group_view.radius or 0.2
        strips, colours = [], []
        for row, ways in enumerate(self._known[group_view.name]):
            lines = [line for way in ways for line in (*crosses(way, size), *([way] if len(way) > 1 else []))]
            strips += lines
            colours += [faded(group_view.colours[row], 0.35 if self._few else 0.7)] * len(lines)
        if strips:
            lengths = [len(strip) for strip in strips]
            shades, points = np.array(colours, np.uint8), np.concatenate(strips)
            path = f"world/agents/{group_view.name}/goal"
            self.output.strips(path, np.array([time]), points, lengths, [len(strips)], shades)

    @property
    def _few(self) -> bool:
        return self.run_view.agent_count <= FEW


def known_ways(knowledge: Any, dimension: int) -> list[Array]:
    """The goal and the waypoints in a knowledge database, each (m, 3); none where they are something else."""
    ways = []
    for name in _NAMES:
        try:
            points = np.atleast_2d(np.array(knowledge.get(name, []), float))
        except (ValueError, TypeError, OverflowError):
            continue
        if points.ndim == 2 and points.shape[1] >= dimension and np.isfinite(points).all():
            ways.append(in_space(points[:, :dimension]))
    return ways


def crosses(points: Array, size: float) -> list[Array]:
    """Two strokes through each point."""
    strokes = size * np.array([[[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]], [[-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]])
    return [point + stroke for point in points for stroke in strokes]
