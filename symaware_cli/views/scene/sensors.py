"""Sensor readings: scans of lidars as points in the world, and images of cameras."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import LogError, png
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.sensor_channels import IMAGE, SCAN, LoggedScan, scans, sensors
from symaware_cli.views.camera import line_of_sight
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Images, Lines, Rays
from symaware_cli.views.scene.signals import lighter
from symaware_cli.views.views import GroupView

Array = NDArray[np.float64]

#: Size of the points of scans, in the scene and in the tab of the agent [pixels].
_POINT, _NEAR_POINT = 2.0, 2.5
#: The kinds of images that are drawn.
_KINDS: dict[int, Literal["colour", "depth"]] = {v1.Image.COLOUR: "colour", v1.Image.DEPTH: "depth"}
#: Height of the pyramid of a camera [m].
_PYRAMID = 0.3


class Scans(Drawing):
    """Draws the ends of lidar rays: in the scene for all agents, unless there are many, and in each agent's tab."""

    order: ClassVar = 140

    def marks(self, chunk: Chunk) -> Iterator[Rays]:
        """Yield the rays of each scan, which are shown until the next."""
        for group_view, sensor, entries in _sensed(self.run_view.group_views.values(), chunk, SCAN):
            try:
                found = [scan for time, message in entries for scan in scans(time, message, sensor, group_view.agents)]
            except ValueError as error:
                raise LogError(f"the scans of {sensor} of {group_view.name} do not fit together: {error}") from error
            if self.detail.awareness:
                yield self._rays(f"world/agents/{group_view.name}/scan/{sensor}", sensor, found, group_view, _POINT)
            for agent in self.detail.focus:
                own = [scan for scan in found if scan.agent == agent]
                if own:
                    yield self._rays(f"as/{agent}/scan/{sensor}", sensor, own, group_view, _NEAR_POINT)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "fine points", "ends of lidar rays, and points found by other sensors"

    def _rays(self, path: str, sensor: str, found: Sequence[LoggedScan], group_view: GroupView, size: float) -> Rays:
        rows = [group_view.agents.index(scan.agent) for scan in found]
        return Rays(
            path=path,
            layer="scan",
            times=np.array([scan.time for scan in found], np.int64),
            names=[f"{scan.agent}/{sensor}" for scan in found],
            colours=lighter(group_view.colours[rows]),
            angles=[scan.angles for scan in found],
            distances=[scan.distances for scan in found],
            poses=np.array([scan.pose for scan in found]).reshape(-1, 4),
            size=size,
            spatial=self.run_view.is_spatial,
        )


class Cameras(Drawing):
    """Draws camera images, at ``cameras/<agent>/<sensor>``, and the fields of view of cameras."""

    order: ClassVar = 150

    def marks(self, chunk: Chunk) -> Iterator[Images | Lines]:
        """Yield each image, which is shown until the next."""
        for group_view, sensor, entries in _sensed(self.run_view.group_views.values(), chunk, IMAGE):
            for row, agent in enumerate(group_view.agents):
                for kind, word in _KINDS.items():
                    own = [(time, image) for time, image in entries if image.row == row and image.kind == kind]
                    if own:
                        yield _images(f"cameras/{agent}/{sensor}/{word}", f"{agent}/{sensor}", word, own)
                    if own and word == "colour" and self.detail.awareness:
                        path = f"world/agents/{group_view.name}/camera/{sensor}/{agent}"
                        yield self._pyramids(path, own, group_view.colours[row])

    def _pyramids(self, path: str, images: Sequence[tuple[int, Any]], colour: NDArray[np.uint8]) -> Lines:
        """Return lines from the camera to the corners of its field of view, at a short distance."""
        corners = np.array([_pyramid(image) for _, image in images])
        if not self.run_view.is_spatial:
            corners[..., 2] = 0.0  # planar worlds are shown from above
        count = len(images)
        return Lines(
            path=path,
            layer="cameras",
            times=np.array([time for time, _ in images], np.int64),
            counts=[2] * count,
            points=corners.reshape(-1, 3),
            lengths=np.tile([5, 5], count),
            colours=colour,
            width=1.0,
        )


def _images(path: str, frame: str, kind: Literal["colour", "depth"], images: Sequence[tuple[int, Any]]) -> Images:
    return Images(
        path=path,
        layer=f"camera/{frame}",
        times=np.array([time for time, _ in images], np.int64),
        kind=kind,
        files=[image.data for _, image in images],
        frame=frame,
        positions=np.array([image.position for _, image in images]),
        targets=np.array([image.target for _, image in images]),
        fields_of_view=np.array([image.field_of_view for _, image in images]),
    )


def _pyramid(image: Any) -> Array:
    """Return two lines of five points that together form the edges of the pyramid of a camera; (10, 3)."""
    position = np.array(image.position)
    aside, above, ahead = line_of_sight(position, image.target)
    width, height = png.size(image.data)
    half = np.tan(0.5 * image.field_of_view) * _PYRAMID
    wide = half * width / max(height, 1)
    rim = [
        position + _PYRAMID * ahead + across * wide * aside + up * half * above
        for across, up in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return np.array([*rim, rim[0], rim[0], position, rim[1], rim[2], position])


def _sensed(group_views: Any, chunk: Chunk, word: str) -> Iterator[tuple[GroupView, str, list[tuple[int, Any]]]]:
    """Yield the readings of one kind in a chunk, by group and sensor."""
    for group_view in group_views:
        for sensor, topic in sensors(chunk.entries, group_view.name, word).items():
            yield group_view, sensor, chunk.entries[topic]
