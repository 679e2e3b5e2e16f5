"""Footprints: the outlines of tilted bodies as seen from above."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.rotation import attitude, rotated
from symaware_cli.geometry.shape import Polygon, Shape

Array = NDArray[np.float64]

#: The number of corners of a round face; they lie outside of it, by less than 1 % of its radius.
_CORNERS = 24

#: [m] Corners nearer to each other, or to the line between two others, are dropped.
_FINE = 1e-6


def footprint(shape: Shape, roll: float, pitch: float) -> Shape:
    """Return the outline of a body turned by a roll about its x axis, and then by a pitch about the y axis [rad].

    Returns:
        An outline in the coordinates of the body, before its heading turns it. That of a ball does not change, nor do
        those of meshes and URDF files, which count as balls.
    """
    if not (roll or pitch) or not (shape.box or shape.cylinder):
        return shape
    if shape.box:
        sides = np.array([shape.box.length, shape.box.width, shape.box.upright])
        corners = 0.5 * sides * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    else:
        assert shape.cylinder
        angles = np.arange(_CORNERS) * 2 * np.pi / _CORNERS
        edge = shape.cylinder.radius / math.cos(np.pi / _CORNERS) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        half = 0.5 * shape.cylinder.height
        corners = np.array([[x, y, z] for x, y in edge.tolist() for z in (-half, half)])
    below = rotated(attitude(roll, pitch, 0.0), corners)[:, :2]
    return Shape(polygon=Polygon(vertices=tuple((x, y) for x, y in _hull(below.tolist()))))


def _hull(points: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """Return the corners of the convex hull, counter-clockwise: A. M. Andrew's monotone chain (1979)."""
    ordered = sorted({(round(x / _FINE) * _FINE, round(y / _FINE) * _FINE) for x, y in points})

    def chain(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        found: list[tuple[float, float]] = []
        for x, y in ordered:
            while len(found) > 1:
                (from_x, from_y), (by_x, by_y) = found[-2:]
                turn = (by_x - from_x) * (y - from_y) - (by_y - from_y) * (x - from_x)
                if turn > _FINE * math.dist((x, y), (from_x, from_y)):
                    break
                found.pop()
            found.append((x, y))
        return found

    return chain(ordered)[:-1] + chain(ordered[::-1])[:-1]
