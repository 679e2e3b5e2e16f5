"""Constructors of foxglove messages: poses, colours and the primitives of scene entities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from symaware_cli.views.outline import prism_surface
from symaware_cli.world import SECOND

Array = NDArray[np.float64]

WORLD = "world"
"""The fixed frame of the world."""

_UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@lru_cache(maxsize=16)
def timestamp(time: int) -> Timestamp:
    """Return a simulated time [ns] as a shared message, which must not be changed."""
    return Timestamp(seconds=time // SECOND, nanos=time % SECOND)


def entity(id: str, time: int, frame: str = WORLD) -> SceneEntity:
    """Return an empty entity.

    Args:
        id: Its id on the channel.
        time: The time from which on it is shown [ns].
        frame: The frame it is attached to.
    """
    return SceneEntity(id=id, timestamp=timestamp(time), frame_id=frame, frame_locked=frame != WORLD)


def colour(parts: Iterable[int], alpha: float = 1.0) -> Color:
    """Return a colour of red, green and blue from 0 to 255 as a shared message, which must not be changed."""
    red, green, blue = map(int, parts)
    return _colour(red, green, blue, alpha)


@lru_cache(maxsize=4096)
def _colour(red: int, green: int, blue: int, alpha: float) -> Color:
    return Color(r=red / 255.0, g=green / 255.0, b=blue / 255.0, a=alpha)


def vector(parts: Iterable[float]) -> Vector3:
    """Return a vector."""
    x, y, z = parts
    return Vector3(x=x, y=y, z=z)


def quaternion(parts: Iterable[float]) -> Quaternion:
    """Return a quaternion, x, y, z, w."""
    x, y, z, w = parts
    return Quaternion(x=x, y=y, z=z, w=w)


def pose(position: Iterable[float], turned: Iterable[float] = _UPRIGHT) -> Pose:
    """Return a pose of a position and a quaternion, x, y, z, w."""
    return Pose(position=vector(position), orientation=quaternion(turned))


def line(points: Array, shade: Color | Sequence[Color], width: float = 0.0, *, thickness: float = 0.0) -> LinePrimitive:
    """Return a line through points (m, 3) [m], with a width [pixels] or thickness [m]; one colour, or one per point."""
    made = LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=ORIGIN,
        thickness=thickness or width,
        scale_invariant=not thickness,
        points=point_list(points),
    )
    if isinstance(shade, Color):
        made.color.CopyFrom(shade)
    else:
        made.colors.extend(shade)
    return made


def strokes(ends: Array, shade: Color, width: float) -> LinePrimitive:
    """Return a straight line for each pair of points (2 m, 3) [m], with a width [pixels]."""
    made = line(ends, shade, width)
    made.type = LinePrimitive.LINE_LIST
    return made


def ellipsoid(centre: Array, half_sizes: Array, turned: Array, shade: Color) -> SpherePrimitive:
    """Return an ellipsoid with half sizes (3,) [m]."""
    # A flat ellipsoid would have no surface to be lit.
    size = np.maximum(2.0 * half_sizes, 0.01)
    return SpherePrimitive(pose=pose(centre.tolist(), turned.tolist()), size=vector(size.tolist()), color=shade)


def prisms(outlines: Sequence[Array], low: float, high: float, shade: Color) -> Sequence[TriangleListPrimitive]:
    """Return upright prisms over convex outlines (m, 2) [m]."""
    meshes = [prism_surface(outline, low, high) for outline in outlines]
    return [
        TriangleListPrimitive(pose=ORIGIN, points=point_list(vertices), indices=triangles.ravel().tolist(), color=shade)
        for vertices, triangles in meshes
    ]


ORIGIN = pose((0.0, 0.0, 0.0))
"""The pose of a frame's origin."""


def point_list(points: Array) -> list[Point3]:
    """Return points (m, 3) as messages."""
    return [Point3(x=x, y=y, z=z) for x, y, z in points.tolist()]
