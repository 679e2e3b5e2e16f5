"""Trails: the past positions of agents."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import FEW, MANY, Detail
from symaware_cli.viewing.scene.marks import Lines
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import RunView

#: Minimum interval between two points of a trail [ns], and with many agents.
_STEP, _CROWD_STEP = 100_000_000, 300_000_000


class Trails(Drawing):
    """Draws a line segment for each instant, which is shown for some time."""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._last: dict[str, tuple[int, NDArray[np.float64]]] = {}

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the segments between the instants."""
        step = _STEP if self.run_view.agent_count <= MANY else _CROWD_STEP
        for group_view in self.run_view.group_views.values():
            frames = chunk.frames.get(group_view.state_topic)
            if not frames:
                continue
            last = self._last.get(group_view.name)
            chosen = _spaced(frames.times, step, last[0] if last else None)
            if not len(chosen):
                continue
            times, places = frames.times[chosen], group_view.positions(frames.values[chosen])
            starts = np.concatenate([places[:1] if last is None else last[1][None], places[:-1]])
            self._last[group_view.name] = int(times[-1]), places[-1]
            count = len(group_view.agents)
            yield Lines(
                path=f"world/agents/{group_view.name}/trail",
                layer=f"trails/{group_view.name}",
                times=times,
                counts=[count] * len(times),
                points=np.stack([starts, places], axis=2).reshape(-1, 3),
                lengths=np.full(count * len(times), 2),
                colours=np.tile(group_view.colours, (len(times), 1)),
                transparency=0.45 if self.run_view.agent_count <= FEW else 0.65,
                names=group_view.agents,
                who=np.tile(np.arange(count), len(times)),
                width=1.5 if self.detail.awareness else 1.0,
                lasting=self.detail.trail,
            )


def _spaced(times: NDArray[np.int64], step: int, last: int | None) -> NDArray[np.intp]:
    """Return the indices of times that are at least a step apart."""
    chosen = []
    for place, time in enumerate(times.tolist()):
        if last is None or time - last >= step:
            chosen.append(place)
            last = time
    return np.array(chosen, np.intp)
