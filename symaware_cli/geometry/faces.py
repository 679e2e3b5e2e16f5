"""The faces of convex regions: half spaces whose intersection is the region, and polytopes within and around a ball."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.region import RegionShape

Array = NDArray[np.float64]

#: The numbers of sides of the polygons within and around a disc.
_INNER, _OUTER = 16, 8


class Faces(NamedTuple):
    """Half spaces ``normals @ point + offsets >= 0``; the left sides are the distances to the planes.

    Attributes:
        normals: Unit normals that point inwards; shape (k, d).
        offsets: Shape (k,) [m].
    """

    normals: Array
    offsets: Array


def region_faces(shape: RegionShape) -> Faces:
    """Return the faces of a box or a convex polygon.

    Args:
        shape: A primitive that is not a circle.
    """
    if shape.box is not None:
        bounds = np.array(shape.box).reshape(-1, 2)
        axes = np.eye(len(bounds))
        return Faces(np.concatenate([axes, -axes]), np.concatenate([-bounds[:, 0], bounds[:, 1]]))
    assert shape.polygon is not None
    corners = np.array(shape.polygon)
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.sqrt((along * along).sum(axis=1))
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1) / lengths[:, None]
    return Faces(normals, -(normals * corners).sum(axis=1))


def ball_faces(dimensions: int, radius: float, around: bool = False) -> Faces:
    """Return the faces of a polytope with the origin as its centre.

    Args:
        dimensions: One, two or three.
        radius: The radius of the ball [m].
        around: Whether the polytope contains the ball, and does not lie within it.
    """
    if dimensions == 2:
        count = _OUTER if around else _INNER
        angles = 2.0 * np.pi * np.arange(count) / count
        outward, within = np.stack([np.cos(angles), np.sin(angles)], axis=1), float(np.cos(np.pi / count))
    else:
        # The corners of a cube are at a distance of at most 1 if its faces are at one over the root of 3.
        outward = np.concatenate([np.eye(dimensions), -np.eye(dimensions)])
        within = 1.0 / np.sqrt(dimensions)
    return Faces(-outward, np.full(len(outward), radius if around else radius * within))
