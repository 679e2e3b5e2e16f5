"""Where agents are to go, as far as their knowledge tells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording.text import read_json
from symaware_cli.viewing.cast import Cast, Troupe, in_space
from symaware_cli.viewing.detail import FEW, Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.palette import faded
from symaware_cli.viewing.stage import Stage

Array = NDArray[np.float64]


#: What goals and waypoints are called in knowledge databases.
_NAMES = ("goal", "target", "waypoint", "waypoints")


class Goals(Drawing):
    """Goals as crosses, waypoints as crosses joined by lines, each in its agent's colour.

    They are what the knowledge calls ``goal``, ``target``, ``waypoint`` or ``waypoints``.
    """

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        self._known: dict[str, list[list[Array]]] = {
            troupe.name: [[] for _ in troupe.agents] for troupe in cast.troupes.values()
        }

    def begin(self) -> None:
        """Put up how thick the lines are."""
        import rerun as rr

        for troupe in self.cast.troupes.values():
            width = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([1.5 if self._few else 0.75]))
            self.stage.static(f"world/agents/{troupe.name}/goal", width)

    def draw(self, excerpt: Excerpt) -> None:
        """Draw the goals that became known."""
        for troupe in self.cast.troupes.values():
            told = excerpt.entries.get(f"/agents/{troupe.name}/knowledge", ())
            for place, (time, message) in enumerate(told):
                rows = message.rows or range(len(message.values))
                for row, value in zip(rows, message.values, strict=True):
                    self._known[troupe.name][row] = known_ways(read_json(value), len(troupe.position))
                if place + 1 == len(told) or told[place + 1][0] > time:
                    self._draw(troupe, time)

    def _draw(self, troupe: Troupe, time: int) -> None:
        size = 0.8 * troupe.radius or 0.2
        strips, colours = [], []
        for row, ways in enumerate(self._known[troupe.name]):
            lines = [line for way in ways for line in (*crosses(way, size), *([way] if len(way) > 1 else []))]
            strips += lines
            colours += [faded(troupe.colours[row], 0.35 if self._few else 0.7)] * len(lines)
        if strips:
            lengths = [len(strip) for strip in strips]
            shades, points = np.array(colours, np.uint8), np.concatenate(strips)
            path = f"world/agents/{troupe.name}/goal"
            self.stage.strips(path, np.array([time]), points, lengths, [len(strips)], shades)

    @property
    def _few(self) -> bool:
        return self.cast.agent_count <= FEW


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
