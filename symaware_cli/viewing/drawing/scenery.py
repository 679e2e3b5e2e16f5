"""The entities of the environment."""

from __future__ import annotations

import numpy as np

from symaware_cli.viewing.cast import Cast, Prop
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.outline import mesh, outlines
from symaware_cli.viewing.palette import faded
from symaware_cli.viewing.stage import Stage

#: How high obstacles without a height are drawn in space [m].
_HEIGHT = 2.0


class Scenery(Drawing):
    """Walls, boxes and the like as solid bodies, flat in a plane and upright in space."""

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        self._placed = False
        #: Those of which no more is known than their outline.
        self._props = [prop for prop in cast.props.values() if prop.figure is None]

    def begin(self) -> None:
        """Put up what they look like."""
        import rerun as rr

        for prop in self._props:
            path = _path(prop)
            low, high = self._extent(prop)
            for number, outline in enumerate(outlines(prop.shape)):
                vertices, triangles = mesh(outline, low, high)
                solid = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=_shade(prop))
                self.stage.static(f"{path}/{number}", solid)

    def draw(self, excerpt: Excerpt) -> None:
        """Put them where they are at the beginning, and move those that move."""
        for prop in self._props:
            frames = excerpt.frames.get(f"/world/{prop.name}/state")
            if not self._placed and (frames is None or excerpt.start not in frames.times[:1]):
                position, heading = prop.position[None], np.array([prop.heading])
                self.stage.poses(_path(prop), np.array([excerpt.start]), position, heading)
            if frames is not None:
                values = frames.values[:, 0]
                self.stage.poses(_path(prop), frames.times, prop.positions(values), values[:, -1])
        self._placed = True

    def _extent(self, prop: Prop) -> tuple[float, float]:
        """Where it begins and ends, upwards [m]; a plane's scenery lies just below the agents."""
        if not self.cast.is_spatial:
            return -0.05, -0.05
        height = _HEIGHT
        if prop.shape.box and prop.shape.box.height:
            height = prop.shape.box.height
        elif prop.shape.cylinder:
            height = prop.shape.cylinder.height
        return (0.0, height) if prop.stands else (-0.5 * height, 0.5 * height)


def _path(prop: Prop) -> str:
    return f"world/scenery/{prop.name}"


def _shade(prop: Prop) -> tuple[int, ...]:
    return prop.colour if prop.moves else tuple(faded(np.array(prop.colour, np.uint8), 0.45).tolist())
