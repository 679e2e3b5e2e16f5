"""Shares of a whole, such as probabilities, as bars beside the agents."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.palette import AGENTS
from symaware_cli.viewing.scene.marks import Lines
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]

#: Minimum height of a bar of 1 [m], for small bodies and points.
_LEAST = 0.8
#: Distance of the bars from the centre of a body, height of a bar of 1, distance between bars, and thickness, in
#: multiples of the extent of the body.
_AWAY, _HEIGHT, _APART, _THICK = 1.5, 2.0, 0.45, 0.17


class Bars(Drawing):
    """Draws parts of awareness and signals as bars, for agents whose awareness is shown."""

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield a mark for each part or signal of a group."""
        for group_view in self.run_view.group_views.values():
            rows, places = self.shown_rows(group_view), chunk.frames.get(group_view.state_topic)
            for number, (name, topic) in enumerate(group_view.drawn("bars")):
                series = chunk.strips.get(topic)
                # The values of a vector, or the first values of a series.
                shares = chunk.frames.get(topic) if series is None else series.firsts
                if shares is None or places is None or not rows:
                    continue
                times = np.union1d(places.times, shares.times)
                positions = group_view.positions(places.at(times))[:, rows]
                bars = self._bars(group_view, number, positions, shares.at(times)[:, rows])
                count, columns = bars.shape[1:3]
                colours = np.array([AGENTS[column % len(AGENTS)] for column in range(columns)], np.uint8)
                yield Lines(
                    path=f"awareness/{group_view.name}/{name}",
                    layer=f"{name}/{group_view.name}",
                    times=times,
                    counts=[count * columns] * len(times),
                    points=bars.reshape(-1, 3),
                    lengths=np.full(len(times) * count * columns, 2),
                    colours=np.tile(colours, (len(times) * count, 1)),
                    thickness=_THICK * _size(group_view),
                    names=group_view.agents,
                    who=np.tile(np.repeat(rows, columns), len(times)),
                )

    def _bars(self, group_view: GroupView, number: int, positions: Array, shares: Array) -> Array:
        """Return both ends of each bar, (k, n, columns, 2, 3) [m]."""
        size, columns = _size(group_view), shares.shape[2]
        across = np.array([1.0, 0.0, 0.0])
        up = np.array([0.0, 0.0, 1.0] if self.run_view.is_spatial else [0.0, 1.0, 0.0])
        # Each further part is to the right of the previous one.
        aside = (_AWAY + _APART * (np.arange(columns) + number * (columns + 1))) * size
        feet = positions[:, :, None] - 0.5 * _HEIGHT * size * up + aside[:, None] * across
        tops = feet + _HEIGHT * size * np.clip(shares, 0.0, 1.0)[..., None] * up
        return np.stack([feet, tops], axis=3)


def legend(run_view: RunView) -> Iterator[tuple[str, str]]:
    """Yield the name of each part that is drawn as bars, and the meaning of its bars."""
    shown = {
        name: group_view.signals[name]
        for group_view in run_view.group_views.values()
        for name, _ in group_view.drawn("bars")
    }
    return ((name, ", ".join(signal.column_names) or signal.description) for name, signal in shown.items())


def _size(group_view: GroupView) -> float:
    """Return the unit of length of the bars of a group [m]."""
    return max(group_view.extent, _LEAST / _HEIGHT)
