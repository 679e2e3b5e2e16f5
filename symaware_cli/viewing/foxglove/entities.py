"""What is drawn, as entities of foxglove.SceneUpdate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from symaware_cli.core import Shape
from symaware_cli.viewing.foxglove.output import Output
from symaware_cli.viewing.outline import circle, mesh, outlines
from symaware_cli.viewing.views import GroupView, ObstacleView
from symaware_cli.world.time import SECOND

Array = NDArray[np.float64]

WORLD = "world"
"""The frame that everything stands in."""

_UPRIGHT = (0.0, 0.0, 0.0, 1.0)
#: How big an agent without a shape is drawn [m].
_POINT = 0.2
#: How high obstacles without a height are drawn [m]; those of a plane lie below the agents.
_HEIGHT = 2.0
_FLOOR = 0.05


class Layer:
    """A channel of entities that are up until they are replaced or taken down.

    Every message holds all that is up then, so that whoever jumps into the middle sees everything.
    """

    def __init__(self, output: Output, topic: str) -> None:
        """Begin with nothing up."""
        self._output = output
        self._topic = topic
        self._up: set[str] = set()

    def show(self, time: int, entities: Iterable[SceneEntity]) -> None:
        """Put entities up at an instant [ns], and take down those that are not among them."""
        update = SceneUpdate(entities=entities)
        up = {entity.id for entity in update.entities}
        for id in sorted(self._up - up):
            update.deletions.add(type=SceneEntityDeletion.MATCHING_ID, id=id, timestamp=timestamp(time))
        if up or self._up:
            self._output.write(self._topic, time, update)
        self._up = up


@lru_cache(maxsize=16)
def timestamp(time: int) -> Timestamp:
    """A simulated time [ns]; shared, so not to be changed."""
    return Timestamp(seconds=time // SECOND, nanos=time % SECOND)


def entity(id: str, time: int, frame: str = WORLD, lifetime: int = 0) -> SceneEntity:
    """An entity without content.

    Args:
        id: What it is called on its channel.
        time: From when on it is up [ns].
        frame: What it moves with.
        lifetime: How long it is up [ns]; 0 for until it is taken down.
    """
    return SceneEntity(
        id=id,
        timestamp=timestamp(time),
        frame_id=frame,
        frame_locked=frame != WORLD,
        lifetime=Duration(seconds=lifetime // SECOND, nanos=lifetime % SECOND),
    )


def colour(parts: Iterable[int], alpha: float = 1.0) -> Color:
    """A colour, of red, green and blue from 0 to 255; shared, so not to be changed."""
    red, green, blue = map(int, parts)
    return _colour(red, green, blue, alpha)


@lru_cache(maxsize=4096)
def _colour(red: int, green: int, blue: int, alpha: float) -> Color:
    return Color(r=red / 255.0, g=green / 255.0, b=blue / 255.0, a=alpha)


def vector(parts: Iterable[float]) -> Vector3:
    """A vector."""
    x, y, z = parts
    return Vector3(x=x, y=y, z=z)


def quaternion(parts: Iterable[float]) -> Quaternion:
    """A quaternion, x, y, z, w."""
    x, y, z, w = parts
    return Quaternion(x=x, y=y, z=z, w=w)


def pose(position: Iterable[float], turned: Iterable[float] = _UPRIGHT) -> Pose:
    """A position and a quaternion, x, y, z, w."""
    return Pose(position=vector(position), orientation=quaternion(turned))


def line(points: Array, shade: Color, thickness: float, *, pairs: bool = False) -> LinePrimitive:
    """A line through points (m, 3) [m], or one for each pair of them, so many pixels thick."""
    return LinePrimitive(
        type=LinePrimitive.LINE_LIST if pairs else LinePrimitive.LINE_STRIP,
        pose=_ORIGIN,
        thickness=thickness,
        scale_invariant=True,
        points=point_list(points),
        color=shade,
    )


def ellipsoid(centre: Array, half_sizes: Array, turned: Array, shade: Color) -> SpherePrimitive:
    """An ellipsoid, of half sizes (3,) [m]."""
    # What is flat would have no surface to be lit.
    size = np.maximum(2.0 * half_sizes, 0.01)
    return SpherePrimitive(pose=pose(centre.tolist(), turned.tolist()), size=vector(size.tolist()), color=shade)


def body(group_view: GroupView, row: int, tint: NDArray[np.uint8], time: int) -> SceneEntity:
    """The body of an agent, which moves with its frame, and an arrow where it heads."""
    made = entity(group_view.agents[row], time, group_view.agents[row])
    shade, shape, in_space = colour(tint), group_view.shape, len(group_view.position) == 3
    radius = group_view.radius or 0.5 * _POINT
    height = radius
    if group_view.figure:
        ring = group_view.figure.middle + np.pad(circle(group_view.extent), ((0, 0), (0, 1)))
        made.lines.append(line(ring, shade, 2.0))
        return made
    if shape is None or (shape.circle and in_space):
        made.spheres.append(SpherePrimitive(pose=_ORIGIN, size=vector([2.0 * radius] * 3), color=shade))
    elif shape.circle:
        size = vector([2.0 * radius, 2.0 * radius, height])
        made.cylinders.append(CylinderPrimitive(pose=_ORIGIN, size=size, bottom_scale=1.0, top_scale=1.0, color=shade))
    elif shape.box:
        height = shape.box.height or 0.5 * min(shape.box.length, shape.box.width)
        size = vector([shape.box.length, shape.box.width, height])
        made.cubes.append(CubePrimitive(pose=_ORIGIN, size=size, color=shade))
    else:
        made.triangles.extend(_prisms(shape, -0.5 * height, 0.5 * height, shade))
    if group_view.heading is not None:
        arrow = ArrowPrimitive(
            pose=pose((0.0, 0.0, 0.5 * height)),
            shaft_length=radius,
            shaft_diameter=0.16 * radius,
            head_length=0.5 * radius,
            head_diameter=0.4 * radius,
            color=colour((240, 240, 240)),
        )
        made.arrows.append(arrow)
    return made


def label(group_view: GroupView, row: int, time: int) -> SceneEntity:
    """The name of an agent, beside it."""
    made = entity(group_view.agents[row], time, group_view.agents[row])
    radius = group_view.extent or 0.5 * _POINT
    made.texts.append(
        TextPrimitive(
            pose=pose((0.0, 0.0, 2.0 * radius)),
            billboard=True,
            font_size=12.0,
            scale_invariant=True,
            color=colour(group_view.colours[row]),
            text=group_view.agents[row],
        )
    )
    return made


def scenery(obstacle_view: ObstacleView, time: int, *, spatial: bool) -> SceneEntity:
    """An entity of the environment; one that moves does so with its frame."""
    made = entity(obstacle_view.name, time, obstacle_view.name)
    high = obstacle_view.shape.box.height if obstacle_view.shape.box and obstacle_view.shape.box.height else _HEIGHT
    low, high = (-0.5 * high, 0.5 * high) if spatial else (-2.0 * _FLOOR, -_FLOOR)
    made.triangles.extend(_prisms(obstacle_view.shape, low, high, colour(obstacle_view.colour)))
    return made


def _prisms(shape: Shape, low: float, high: float, shade: Color) -> Sequence[TriangleListPrimitive]:
    meshes = [mesh(outline, low, high) for outline in outlines(shape)]
    return [
        TriangleListPrimitive(
            pose=_ORIGIN, points=point_list(vertices), indices=triangles.ravel().tolist(), color=shade
        )
        for vertices, triangles in meshes
    ]


_ORIGIN = pose((0.0, 0.0, 0.0))


def point_list(points: Array) -> list[Point3]:
    """Points (m, 3)."""
    return [Point3(x=x, y=y, z=z) for x, y, z in points.tolist()]
