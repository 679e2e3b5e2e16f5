"""Bodies of links and joints for Foxglove, each link in a frame ``<body>/<link>`` of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from numpy.typing import NDArray

from symaware_cli.geometry.articulation import Visual
from symaware_cli.recording import wire
from symaware_cli.recording.surface import triangles
from symaware_cli.viewing.figure import Figure
from symaware_cli.viewing.foxglove import entities
from symaware_cli.viewing.foxglove.entities import entity
from symaware_cli.viewing.foxglove.output import Output
from symaware_cli.viewing.palette import SCENERY
from symaware_cli.viewing.tessellation import tessellated

Array = NDArray[np.float64]


class Models:
    """The bodies of a group, or an entity.

    Attributes:
        made: All that is to be put up of them, for good.
    """

    def __init__(
        self,
        name: str,
        bodies: Sequence[str],
        figure: Figure,
        surfaces: Mapping[str, bytes],
        output: Output,
        start: int,
    ) -> None:
        """Make them, and put the links in place.

        Args:
            name: The group or the entity.
            bodies: The frames that its bodies move with.
            figure: What they look like.
            surfaces: The files of meshes, by name.
            output: Where to draw.
            start: The first instant [ns].
        """
        self._name, self._bodies, self._figure, self._output = name, bodies, figure, output
        self._joints = np.zeros((len(bodies), len(figure.articulation.joints)))
        parts = {place: SceneEntity() for place in sorted({place for _, place in figure.visuals})}
        for visual, place in figure.visuals:
            _add(parts[place], visual, surfaces)
        self.made: list[SceneEntity] = []
        for body in bodies:
            for place, part in parts.items():
                # The base has the frame of the body.
                name = f"{body}/{self._link(place)}" if place else body
                self.made.append(entity(name, start, name))
                self.made[-1].MergeFrom(part)
        #: The links that have a frame of their own.
        self._links = [place for place in parts if place]
        if self._links:
            self._move(start)

    def take(self, time: int, message: wire.Rows) -> None:
        """Turn the links as the joints stand."""
        if message.values.shape[1] != self._joints.shape[1]:
            raise ValueError(f"{message.values.shape[1]} joints, not {self._joints.shape[1]}")
        self._joints[slice(len(message.values)) if message.rows is None else message.rows] = message.values
        if self._links:
            self._move(time)

    def _move(self, time: int) -> None:
        positions, orientations = self._figure.articulation.frames(self._joints)
        transforms = [
            FrameTransform(
                timestamp=entities.timestamp(time),
                parent_frame_id=body,
                child_frame_id=f"{body}/{self._link(place)}",
                translation=entities.vector(positions[row, place].tolist()),
                rotation=entities.quaternion(orientations[row, place].tolist()),
            )
            for row, body in enumerate(self._bodies)
            for place in self._links
        ]
        self._output.write(f"/tf/{self._name}/links", time, FrameTransforms(transforms=transforms))

    def _link(self, place: int) -> str:
        return self._figure.articulation.links[place].name


def _add(made: SceneEntity, visual: Visual, surfaces: Mapping[str, bytes]) -> None:
    """Add what a link looks like to what moves with it."""
    pose, size = entities.pose(visual.position, visual.orientation), visual.size
    shade = entities.colour(SCENERY)
    if visual.colour:
        *parts, opacity = visual.colour
        shade = entities.colour([round(255 * part) for part in parts], opacity)
    match visual.kind:
        case "box":
            made.cubes.append(CubePrimitive(pose=pose, size=entities.vector(size), color=shade))
        case "sphere":
            made.spheres.append(SpherePrimitive(pose=pose, size=entities.vector([2.0 * size[0]] * 3), color=shade))
        case "cylinder":
            extents = entities.vector((2.0 * size[0], 2.0 * size[0], size[1]))
            upright = CylinderPrimitive(pose=pose, size=extents, bottom_scale=1.0, top_scale=1.0, color=shade)
            made.cylinders.append(upright)
        case "mesh":
            # As triangles: of a file Foxglove would ask the user which of its axes points up.
            found = triangles(surfaces[visual.mesh], PurePosixPath(visual.mesh).suffix)
            if found:
                made.triangles.append(_surface(found[0] * size, found[1], visual, shade))
        case _:
            solid = tessellated(visual)
            made.triangles.append(_surface(solid.vertices, solid.corners, visual, shade))


def _surface(vertices: Array, corners: NDArray[np.integer], visual: Visual, shade: Color) -> TriangleListPrimitive:
    return TriangleListPrimitive(
        pose=entities.pose(visual.position, visual.orientation),
        points=entities.point_list(vertices),
        indices=corners.ravel().tolist(),
        color=shade,
    )
