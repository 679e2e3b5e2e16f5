"""Scenery: the entities of the environment, and the ground."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.rotation import about
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.marks import Ground, Solid
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import ObstacleView, RunView

Array = NDArray[np.float64]

#: Height of obstacles without a height in spatial worlds [m].
_HEIGHT = 2.0
#: Share of the background in the colour of obstacles that do not move.
_FADED = 0.45


class SceneryDrawing(Drawing):
    """Draws walls, boxes and other obstacles as solid bodies, flat in planar worlds; and the ground."""

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._begun = False

    def marks(self, chunk: Chunk) -> Iterator[Solid | Ground]:
        """Yield obstacles without a figure: at the beginning, and whenever one moves."""
        start = np.array([chunk.start])
        if not self._begun and self.run_view.ground is not None:
            yield Ground(path="world/ground", times=start, height=self.run_view.ground)
        for obstacle_view in self.run_view.obstacle_views.values():
            if obstacle_view.figure is not None:
                continue
            frames = chunk.frames.get(f"/world/{obstacle_view.name}/state")
            if not self._begun and (frames is None or chunk.start not in frames.times[:1]):
                yield self._solid(obstacle_view, start, obstacle_view.position[None], np.array([obstacle_view.heading]))
            if frames is not None and len(frames.times):
                values = frames.values[:, 0]
                yield self._solid(obstacle_view, frames.times, obstacle_view.positions(values), values[:, -1])
        self._begun = True

    def _solid(self, obstacle_view: ObstacleView, times: NDArray[np.int64], positions: Array, headings: Array) -> Solid:
        low, high = self._extent(obstacle_view)
        return Solid(
            path=f"world/scenery/{obstacle_view.name}",
            layer="scenery",
            times=times,
            name=obstacle_view.name,
            pieces=obstacle_view.shape.pieces,
            low=low,
            high=high,
            colour=obstacle_view.colour,
            faded=0.0 if obstacle_view.moves else _FADED,
            positions=positions,
            orientations=about((0.0, 0.0, 1.0), headings),
        )

    def _extent(self, obstacle_view: ObstacleView) -> tuple[float, float]:
        """Return the lower and upper end of an obstacle [m]; in planar worlds it is just below the agents."""
        if not self.run_view.is_spatial:
            return -0.05, -0.05
        height = _HEIGHT
        if obstacle_view.shape.box and obstacle_view.shape.box.height:
            height = obstacle_view.shape.box.height
        elif obstacle_view.shape.cylinder:
            height = obstacle_view.shape.cylinder.height
        return (0.0, height) if obstacle_view.stands else (-0.5 * height, 0.5 * height)
