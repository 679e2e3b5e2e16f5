"""Viewpoints: parallel projections of the world onto the plane of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Viewpoint:
    """A parallel projection.

    Attributes:
        name: The name of the viewpoint.
        right: The direction that points to the right in the picture (3,), of length 1.
        up: The direction that points upwards (3,), of length 1.
    """

    name: str
    right: tuple[float, float, float]
    up: tuple[float, float, float]

    @property
    def towards(self) -> Array:
        """The direction towards the viewer (3,), of length 1."""
        return np.cross(self.right, self.up)

    def project(self, points: Array) -> Array:
        """Project points; (..., 3) to (..., 2) [m]."""
        return np.stack([points @ np.array(self.right), points @ np.array(self.up)], axis=-1)

    def nearness(self, points: Array) -> Array:
        """Return the nearness of points to the viewer, relative to the origin; (..., 3) to (...) [m]."""
        near: Array = points @ self.towards
        return near


def _from(towards: tuple[float, float, float]) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the directions to the right and upwards in the picture, for a direction of view that is not vertical."""
    away = np.array(towards) / np.linalg.norm(towards)
    right = np.cross((0.0, 0.0, 1.0), away)
    right /= np.linalg.norm(right)
    up = np.cross(away, right)
    return (float(right[0]), float(right[1]), float(right[2])), (float(up[0]), float(up[1]), float(up[2]))


#: The direction from the scene towards the viewer at an angle: from the south-west, from above.
ASLANT = (-0.4, -0.66, 0.63)

VIEWPOINTS = {
    viewpoint.name: viewpoint
    for viewpoint in (
        Viewpoint("above", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        Viewpoint("angle", *_from(ASLANT)),
        Viewpoint("front", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        Viewpoint("side", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    )
}
"""The viewpoints by name: from above, at an angle, from the front (south) and from the side (east)."""
