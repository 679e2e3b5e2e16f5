"""Bodies of agents at their true poses, tinted by risk."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.marks import Bodies
from symaware_cli.viewing.scene.risk import tinted_by_risk
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]

#: Minimum height of rings above the ground, so that they are visible [m].
_ABOVE = 5e-3


class Agents(Drawing):
    """Draws every agent as its shape, or as a ring if its figure is drawn."""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._shown: set[str] = set()

    def marks(self, chunk: Chunk) -> Iterator[Bodies]:
        """Yield a mark for each group with known positions."""
        for group_view in self.run_view.group_views.values():
            frames = chunk.frames.get(group_view.state_topic)
            times = frames.times if frames else np.empty(0, np.int64)
            if group_view.name not in self._shown:
                self._shown.add(group_view.name)
                if not len(times) or times[0] > chunk.start:
                    # A body with a size but without a position would be drawn at the origin.
                    nowhere = np.full((1, len(group_view.agents), 7), np.nan)
                    yield self._mark(group_view, np.array([chunk.start]), nowhere[..., :3], nowhere[..., 3:], chunk)
            if len(times):
                yield self._mark(group_view, times, *self.postures(group_view, times, chunk), chunk)

    def _mark(
        self, group_view: GroupView, times: NDArray[np.int64], positions: Array, orientations: Array, chunk: Chunk
    ) -> Bodies:
        figure, ground = group_view.figure, self.run_view.ground
        return Bodies(
            path=f"world/agents/{group_view.name}",
            layer=f"bodies/{group_view.name}",
            times=times,
            names=group_view.agents,
            positions=positions,
            orientations=orientations,
            colours=tinted_by_risk(group_view, times, chunk),
            shape=group_view.shape,
            labels=self._labels(group_view),
            label_colours=group_view.colours,
            nosed=group_view.heading is not None and bool(group_view.radius) and self.detail.awareness,
            ring=(figure.middle, group_view.extent) if figure else None,
            floor=-np.inf if ground is None else ground + _ABOVE,
            extent=group_view.extent,
            spatial=self.run_view.is_spatial,
        )

    def _labels(self, group_view: GroupView) -> dict[int, str]:
        """Return the labels by row: ids, without the name of the group if there is only one group."""
        prefix = f"{group_view.name}." if len(self.run_view.group_views) == 1 else ""
        return {
            row: id.removeprefix(prefix)
            for row, id in enumerate(group_view.agents)
            if self.detail.labels or id in self.detail.focus
        }
