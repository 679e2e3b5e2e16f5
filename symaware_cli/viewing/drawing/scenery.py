"""The entities of the environment."""

from __future__ import annotations

import numpy as np

from symaware_cli.viewing.cast import Prop
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.outline import mesh, outlines
from symaware_cli.viewing.palette import SCENERY, faded

#: How high obstacles without a height are drawn in space [m].
_HEIGHT = 2.0


class Scenery(Drawing):
    """Walls, boxes and the like as solid bodies, flat in a plane and upright in space."""

    def begin(self) -> None:
        """Put all of them up where they are at the beginning."""
        import rerun as rr

        for prop in self.cast.props.values():
            path = _path(prop)
            low, high = self._extent(prop)
            for number, outline in enumerate(outlines(prop.shape)):
                vertices, triangles = mesh(outline, low, high)
                solid = rr.Mesh3D(
                    vertex_positions=vertices, triangle_indices=triangles, albedo_factor=_shade(prop.moves)
                )
                self.stage.static(f"{path}/{number}", solid)
            if not prop.moves:
                turn = rr.RotationAxisAngle(axis=(0, 0, 1), radians=prop.heading)
                self.stage.static(path, rr.Transform3D(translation=prop.position, rotation=turn))

    def draw(self, excerpt: Excerpt) -> None:
        """Move those that move."""
        for prop in self.cast.props.values():
            frames = excerpt.frames.get(f"/world/{prop.name}/state")
            if frames is not None:
                values = frames.values[:, 0]
                position = np.zeros((len(values), 3))
                position[:, : values.shape[1] - 1] = values[:, :-1]
                self.stage.poses(_path(prop), frames.times, position, values[:, -1])

    def _extent(self, prop: Prop) -> tuple[float, float]:
        """Where it begins and ends, upwards [m]; a plane's scenery lies just below the agents."""
        if not self.cast.is_spatial:
            return -0.05, -0.05
        height = prop.shape.box.height if prop.shape.box and prop.shape.box.height else _HEIGHT
        return -0.5 * height, 0.5 * height


def _path(prop: Prop) -> str:
    return f"world/scenery/{prop.name}"


def _shade(moves: bool) -> tuple[int, ...]:
    colour = np.array(SCENERY, np.uint8)
    return tuple(int(part) for part in (colour if moves else faded(colour, 0.45)))
