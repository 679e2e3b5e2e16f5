"""Numbers that share a whole, such as probabilities, as bars beside the agents."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk, Frames
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.palette import AGENTS
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]

#: How high a bar of 1 is at least [m], where bodies are small or points.
_LEAST = 0.8
#: How far the bars stand from the middle of a body, how high a bar of 1 is, how far apart they are, and how thick;
#: in multiples of what the body extends to.
_AWAY, _HEIGHT, _APART, _THICK = 1.5, 2.0, 0.45, 0.17


class Bars(Drawing):
    """What is drawn as bars, of all whose minds are shown."""

    def begin(self) -> None:
        """Put up how thick the bars are."""
        import rerun as rr

        self._before: dict[str, Array] = {}
        for group_view in self.run_view.group_views.values():
            for name, _ in group_view.drawn("bars"):
                thick = rr.LineStrips3D.from_fields(radii=_THICK * _size(group_view))
                self.output.static(f"minds/{group_view.name}/{name}", thick)

    def draw(self, chunk: Chunk) -> None:
        """Draw the bars of a stretch of the log."""
        for group_view in self.run_view.group_views.values():
            rows = [row for row, id in enumerate(group_view.agents) if self.detail.minds or id in self.detail.focus]
            places = chunk.frames.get(group_view.whereabouts)
            for number, (name, topic) in enumerate(group_view.drawn("bars")):
                shares = self._shares(topic, chunk)
                if shares is None or places is None or not rows:
                    continue
                times = np.union1d(places.times, shares.times)
                positions = group_view.positions(places.at(times))[:, rows]
                path = f"minds/{group_view.name}/{name}"
                self._draw(path, group_view, number, times, positions, shares.at(times)[:, rows])

    def _shares(self, topic: str, chunk: Chunk) -> Frames | None:
        """The numbers of all agents: those of a vector, or the first ones of a series."""
        strips = chunk.strips.get(topic)
        if strips is None:
            return chunk.frames.get(topic)
        before = self._before.get(topic, np.full(strips.firsts.shape[1:], np.nan))
        self._before[topic] = strips.firsts[-1]
        return Frames(strips.times, strips.firsts, before)

    def _draw(
        self, path: str, group_view: GroupView, number: int, times: NDArray[np.int64], positions: Array, shares: Array
    ) -> None:
        size, columns = _size(group_view), shares.shape[2]
        across, up = (
            np.array([1.0, 0.0, 0.0]),
            np.array([0.0, 0.0, 1.0] if self.run_view.is_spatial else [0.0, 1.0, 0.0]),
        )
        # The next part stands to the right of this one.
        aside = (_AWAY + _APART * (np.arange(columns) + number * (columns + 1))) * size
        feet = positions[:, :, None] - 0.5 * _HEIGHT * size * up + aside[:, None] * across
        tops = feet + _HEIGHT * size * np.clip(shares, 0.0, 1.0)[..., None] * up
        ends = np.stack([feet, tops], axis=3).reshape(len(times), -1, 2, 3)
        colours = np.array([AGENTS[column % len(AGENTS)] for column in range(columns)], np.uint8)
        self.output.segments(path, times, ends, np.tile(colours, (positions.shape[1], 1)))


def legend(run_view: RunView) -> Iterator[tuple[str, str]]:
    """The name of each part that is drawn as bars, and what its bars stand for."""
    shown = {
        name: group_view.signals[name]
        for group_view in run_view.group_views.values()
        for name, _ in group_view.drawn("bars")
    }
    return ((name, ", ".join(signal.column_names) or signal.description) for name, signal in shown.items())


def _size(group_view: GroupView) -> float:
    """What the bars of a group are measured by [m]."""
    return max(group_view.extent, _LEAST / _HEIGHT)
