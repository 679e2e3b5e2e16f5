"""The entities of the environment."""

from __future__ import annotations

import numpy as np

from symaware_cli.core import Mesh
from symaware_cli.viewing.cast import Cast, Prop, in_space
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.outline import mesh, outlines
from symaware_cli.viewing.palette import SCENERY, faded
from symaware_cli.viewing.stage import Stage

#: How high obstacles without a height are drawn in space [m].
_HEIGHT = 2.0


class Scenery(Drawing):
    """Walls, boxes and the like as solid bodies, flat in a plane and upright in space."""

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        self._placed = False

    def begin(self) -> None:
        """Put up what they look like."""
        import rerun as rr

        for prop in self.cast.props.values():
            path = _path(prop)
            if prop.shape.mesh and prop.shape.mesh.file in self.cast.assets:
                self._put_up_mesh(path, prop.shape.mesh, prop)
                continue
            low, high = self._extent(prop)
            for number, outline in enumerate(outlines(prop.shape)):
                vertices, triangles = mesh(outline, low, high)
                solid = rr.Mesh3D(
                    vertex_positions=vertices, triangle_indices=triangles, albedo_factor=_shade(prop.moves)
                )
                self.stage.static(f"{path}/{number}", solid)

    def draw(self, excerpt: Excerpt) -> None:
        """Put them where they are at the beginning, and move those that move."""
        for prop in self.cast.props.values():
            frames = excerpt.frames.get(f"/world/{prop.name}/state")
            if not self._placed and (frames is None or excerpt.start not in frames.times[:1]):
                position, heading = prop.position[None], np.array([prop.heading])
                self.stage.poses(_path(prop), np.array([excerpt.start]), position, heading)
            if frames is not None:
                values = frames.values[:, 0]
                self.stage.poses(_path(prop), frames.times, in_space(values[:, :-1]), values[:, -1])
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

    def _put_up_mesh(self, path: str, shape: Mesh, prop: Prop) -> None:
        """Show the surface that a file describes."""
        import rerun as rr

        surface = rr.Asset3D(
            contents=self.cast.assets[shape.file],
            media_type="model/stl" if shape.file.lower().endswith(".stl") else "model/obj",
            albedo_factor=_shade(prop.moves),
        )
        self.stage.static(f"{path}/0", surface, rr.Transform3D(scale=shape.scale))


def _path(prop: Prop) -> str:
    return f"world/scenery/{prop.name}"


def _shade(moves: bool) -> tuple[int, ...]:
    colour = np.array(SCENERY, np.uint8)
    return tuple(int(part) for part in (colour if moves else faded(colour, 0.45)))
