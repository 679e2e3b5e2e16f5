"""Random convex pieces, and an independent computation of distances, for tests of geometry and contacts."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from symaware_cli import Box, Circle, Polygon, Shape

Array = NDArray[np.float64]
Piece = tuple[Array, float]
"""A core (k, 2) and the radius by which it is rounded."""


def random_core(random: np.random.Generator, corners: int, size: float = 1.0) -> Array:
    """A point, a line, or a convex polygon: corners on an ellipse, in order."""
    angles = np.sort(random.uniform(0, 2 * np.pi, corners))
    axes = random.uniform(0.2, 1.0, 2) * size
    around: Array = np.c_[axes[0] * np.cos(angles), axes[1] * np.sin(angles)]
    turn = random.uniform(0, 2 * np.pi)
    return np.asarray(around @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]))


def random_shape(random: np.random.Generator) -> Shape:
    """A circle, a box, or a polygon that no corner of lies on another."""
    kind = random.integers(3)
    if kind == 0:
        return Shape(circle=Circle(radius=random.uniform(0.1, 1.0)))
    if kind == 1:
        return Shape(box=Box(length=random.uniform(0.1, 2.0), width=random.uniform(0.1, 2.0)))
    angles = np.linspace(0, 2 * np.pi, random.integers(3, 7), endpoint=False) + random.uniform(0, 0.5)
    corners = random.uniform(0.3, 1.0) * np.c_[np.cos(angles), random.uniform(0.4, 1.0) * np.sin(angles)]
    return Shape(polygon=Polygon(vertices=[tuple(corner) for corner in corners]))


def placed(shape: Shape, position: Sequence[float] | Array, heading: float) -> list[Piece]:
    """The pieces of a shape in the world."""
    turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    return [(np.array(core) @ turn + position, rounding) for core, rounding in shape.pieces]


def distance(one: Piece, other: Piece) -> float:
    """The signed distance of two pieces: of the origin from the outline of all differences of their points.

    Two bodies overlap where their Minkowski difference holds the origin (Ericson, Real-Time Collision Detection, 3.10).
    """
    differences = (one[0][:, None] - other[0][None]).reshape(-1, 2)
    hull, origin = shapely.MultiPoint(differences).convex_hull, shapely.Point(0, 0)
    core = hull.distance(origin)
    if hull.geom_type == "Polygon" and hull.contains(origin):
        core = -hull.exterior.distance(origin)
    return float(core - one[1] - other[1])


def outline(piece: Piece) -> Array:
    """Points all around the surface of a piece, near to each other; shape (many, 2)."""
    core, rounding = piece
    body = shapely.MultiPoint(core).convex_hull
    if rounding:
        body = body.buffer(rounding, quad_segs=64)
    return np.array(body.exterior.segmentize(0.01).coords)
