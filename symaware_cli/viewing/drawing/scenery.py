"""The entities of the environment."""

from __future__ import annotations

import numpy as np

from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.outline import mesh, outlines
from symaware_cli.viewing.palette import faded
from symaware_cli.viewing.rerun_output import RerunOutput
from symaware_cli.viewing.views import ObstacleView, RunView

#: How high obstacles without a height are drawn in space [m].
_HEIGHT = 2.0


class Scenery(Drawing):
    """Walls, boxes and the like as solid bodies, flat in a plane and upright in space."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        self._placed = False
        #: Those of which no more is known than their outline.
        self._props = [
            obstacle_view for obstacle_view in run_view.obstacle_views.values() if obstacle_view.figure is None
        ]

    def begin(self) -> None:
        """Put up what they look like."""
        import rerun as rr

        for obstacle_view in self._props:
            path = _path(obstacle_view)
            low, high = self._extent(obstacle_view)
            for number, outline in enumerate(outlines(obstacle_view.shape)):
                vertices, triangles = mesh(outline, low, high)
                solid = rr.Mesh3D(
                    vertex_positions=vertices, triangle_indices=triangles, albedo_factor=_shade(obstacle_view)
                )
                self.output.static(f"{path}/{number}", solid)

    def draw(self, chunk: Chunk) -> None:
        """Put them where they are at the beginning, and move those that move."""
        for obstacle_view in self._props:
            frames = chunk.frames.get(f"/world/{obstacle_view.name}/state")
            if not self._placed and (frames is None or chunk.start not in frames.times[:1]):
                position, heading = obstacle_view.position[None], np.array([obstacle_view.heading])
                self.output.poses(_path(obstacle_view), np.array([chunk.start]), position, heading)
            if frames is not None:
                values = frames.values[:, 0]
                self.output.poses(_path(obstacle_view), frames.times, obstacle_view.positions(values), values[:, -1])
        self._placed = True

    def _extent(self, obstacle_view: ObstacleView) -> tuple[float, float]:
        """Where it begins and ends, upwards [m]; a plane's scenery lies just below the agents."""
        if not self.run_view.is_spatial:
            return -0.05, -0.05
        height = _HEIGHT
        if obstacle_view.shape.box and obstacle_view.shape.box.height:
            height = obstacle_view.shape.box.height
        elif obstacle_view.shape.cylinder:
            height = obstacle_view.shape.cylinder.height
        return (0.0, height) if obstacle_view.stands else (-0.5 * height, 0.5 * height)


def _path(obstacle_view: ObstacleView) -> str:
    return f"world/scenery/{obstacle_view.name}"


def _shade(obstacle_view: ObstacleView) -> tuple[int, ...]:
    return (
        obstacle_view.colour
        if obstacle_view.moves
        else tuple(faded(np.array(obstacle_view.colour, np.uint8), 0.45).tolist())
    )
