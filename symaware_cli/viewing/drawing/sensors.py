"""What sensors measured: the scans of lidars as points in the world, and the images of cameras."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.recording import png
from symaware_cli.recording import symaware_v1_pb2 as v1
from symaware_cli.recording.error import LogError
from symaware_cli.recording.sensor_channels import IMAGE, SCAN, LoggedScan, hits, scans, sensors
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.drawing.points import draw_dots
from symaware_cli.viewing.rerun_output import TIMELINE, RerunOutput
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]
Times = NDArray[np.int64]

#: How large the points of scans are, in the scene and in the tab of the agent [pixels].
_POINT, _NEAR_POINT = 2.0, 2.5
#: How far the pyramid of a camera reaches [m].
_PYRAMID = 0.3


class Scans(Drawing):
    """Where the rays of lidars end: in the scene those of all agents, unless they are a crowd, in tabs one's own."""

    def draw(self, chunk: Chunk) -> None:
        """Draw the points of each scan from when it became known until the next."""
        for group_view, sensor, entries in _sensed(self.run_view.group_views.values(), chunk, SCAN):
            try:
                found = [scan for time, message in entries for scan in scans(time, message, sensor, group_view.agents)]
            except ValueError as error:
                raise LogError(f"the scans of {sensor} of {group_view.name} do not fit together: {error}") from error
            if self.detail.minds:
                self._draw(f"world/agents/{group_view.name}/scan/{sensor}", found, group_view, _POINT)
            for agent in self.detail.focus:
                if agent in group_view.agents:
                    own = [scan for scan in found if scan.agent == agent]
                    self._draw(f"as/{agent}/scan/{sensor}", own, group_view, _NEAR_POINT)

    def _draw(self, path: str, found: Sequence[LoggedScan], group_view: GroupView, size: float) -> None:
        dots = [
            (scan.time, group_view.agents.index(scan.agent), hits(scan.angles, scan.distances, scan.pose))
            for scan in found
        ]
        draw_dots(self, path, dots, group_view, size)


class Images(Drawing):
    """What cameras saw, and where they look: ``cameras/<agent>/<sensor>``, a 2-D view each."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        #: The paths of pyramids, whose lines are thin.
        self._thin: set[str] = set()

    def draw(self, chunk: Chunk) -> None:
        """Show each image from when it became known until the next."""
        for group_view, sensor, entries in _sensed(self.run_view.group_views.values(), chunk, IMAGE):
            for row, agent in enumerate(group_view.agents):
                for kind, word in ((v1.Image.COLOUR, "colour"), (v1.Image.DEPTH, "depth")):
                    own = [(time, image) for time, image in entries if image.row == row and image.kind == kind]
                    if own:
                        self._show(f"cameras/{agent}/{sensor}/{word}", own, depth=kind == v1.Image.DEPTH)
                own = [(time, image) for time, image in entries if image.row == row and image.kind == v1.Image.COLOUR]
                if own and self.detail.minds:
                    self._point(f"world/agents/{group_view.name}/camera/{sensor}/{agent}", own, group_view, row)

    def _show(self, path: str, images: Sequence[tuple[int, Any]], *, depth: bool) -> None:
        import rerun as rr

        times = np.array([time for time, _ in images], np.int64)
        blobs = [image.data for _, image in images]
        if depth:
            columns = rr.EncodedDepthImage.columns(blob=blobs, media_type=["image/png"] * len(blobs))
        else:
            columns = rr.EncodedImage.columns(blob=blobs, media_type=["image/png"] * len(blobs))
        self.output.recording.send_columns(path, [_index(times)], columns, strict=True)

    def _point(self, path: str, images: Sequence[tuple[int, Any]], group_view: GroupView, row: int) -> None:
        """Draw lines from the camera to the corners of what it sees, a little before it."""
        import rerun as rr

        if path not in self._thin:
            self._thin.add(path)
            self.output.static(path, rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([1.0])))
        times = np.array([time for time, _ in images], np.int64)
        corners = np.array([_pyramid(image) for _, image in images])
        if not self.run_view.is_spatial:
            corners[..., 2] = 0.0  # the plane is seen from above
        count = len(images)
        colours = np.broadcast_to(group_view.colours[row], (2 * count, 3))
        self.output.strips(path, times, corners.reshape(-1, 3), np.tile([5, 5], count), [2] * count, colours)


def line_of_sight(position: ArrayLike, target: ArrayLike) -> Array:
    """How a level camera stands in the world, that looks from one point to another.

    Args:
        position: (3,) [m].
        target: (3,) [m].

    Returns:
        Its directions to the right, upwards and ahead, of length 1; (3, 3).
    """
    ahead = np.asarray(target, float) - np.asarray(position, float)
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    # Who looks straight up or down has no horizon.
    upwards = np.array([1.0, 0.0, 0.0]) if abs(ahead[2]) > 1 - 1e-9 else np.array([0.0, 0.0, 1.0])
    aside = np.cross(ahead, upwards)
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(aside, ahead), ahead])


def _pyramid(image: Any) -> Array:
    """Two lines of five points, which together are the edges that leave a camera and the rim of its image; (10, 3)."""
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
    """The readings of one kind in a chunk, by group and sensor."""
    for group_view in group_views:
        for sensor, topic in sensors(chunk.entries, group_view.name, word).items():
            yield group_view, sensor, chunk.entries[topic]


def _index(times: Times) -> Any:
    import rerun as rr

    return rr.TimeColumn(TIMELINE, duration=times.astype("timedelta64[ns]"))
