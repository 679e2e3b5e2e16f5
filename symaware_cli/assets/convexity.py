"""Convexity of meshes: whether a surface equals its convex hull, by which engines replace it in collisions."""

from __future__ import annotations

import numpy as np

from symaware_cli.assets.mesh_file import MeshSurface
from symaware_cli.geometry import Array

#: A surface is convex if it comes as near to its hull as this part of its extent, and is as large up to this part.
_TOLERANCE = 0.01

#: The most points of a part that are compared with its hull.
_MOST_POINTS = 2_000


def is_convex(surface: MeshSurface) -> bool:
    """Return whether each part of a surface is convex, up to a hundredth of its size.

    A hollow vessel with an opening is not, even if its walls have no thickness.

    Args:
        surface: The surface of a mesh file; flat parts count as convex.
    """
    ends = np.cumsum(surface.parts)
    triangles = surface.triangles
    return all(_is_convex(triangles[end - count : end]) for end, count in zip(ends, surface.parts, strict=True))


def _is_convex(triangles: Array) -> bool:
    """Return whether triangles, shape (t, 3, 3), are the boundary of their convex hull."""
    from scipy.spatial import ConvexHull, QhullError

    vertices = np.unique(triangles.reshape(-1, 3), axis=0)
    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError):
        return True
    extent = float(np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    # Where all vertices lie on the hull, edges and faces may still lead through its inside.
    edges = 0.5 * (triangles + np.roll(triangles, 1, axis=1)).reshape(-1, 3)
    points = np.concatenate([vertices, edges, triangles.mean(axis=1)])
    points = points[:: max(1, len(points) // _MOST_POINTS)]
    planes = hull.equations
    depth = max(float(-(planes[:, :3] @ point + planes[:, 3]).max()) for point in points)
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = 0.5 * float(np.linalg.norm(sides, axis=1).sum())
    return depth <= _TOLERANCE * extent and area >= (1.0 - 2.0 * _TOLERANCE) * float(hull.area)
