"""Shows marks in Foxglove: converts each kind of mark to foxglove messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.Log_pb2 import Log as LogLine
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from symaware_cli.geometry import about
from symaware_cli.log import png
from symaware_cli.log.sensor_channels import NOTHING
from symaware_cli.views.camera import line_of_sight
from symaware_cli.views.foxglove import primitives
from symaware_cli.views.foxglove.frames import show_bodies, show_figures, show_solid
from symaware_cli.views.foxglove.output import PlotChannel, SceneUpdates
from symaware_cli.views.foxglove.primitives import WORLD, colour, entity
from symaware_cli.views.outline import circle
from symaware_cli.views.scene import marks
from symaware_cli.views.scene.marks import Images, Rays


def show_rays(updates: SceneUpdates, mark: Rays) -> None:
    """Show scans; those with unevenly spaced rays are omitted, since Foxglove has no message for them."""
    given = zip(mark.times.tolist(), mark.names, mark.angles, mark.distances, mark.poses.tolist(), strict=True)
    for time, name, angles, distances, (x, y, z, heading) in given:
        even = np.linspace(angles[0], angles[-1], len(angles)) if len(angles) else np.ones(1)
        if even.shape != angles.shape or not np.allclose(angles, even):
            continue
        turned = about((0.0, 0.0, 1.0), np.array(heading)).tolist()
        shown = LaserScan(
            timestamp=primitives.timestamp(time),
            frame_id=WORLD,
            # Planar scans are shown from above, at height 0.
            pose=primitives.pose((x, y, z if mark.spatial else 0.0), turned),
            start_angle=angles[0],
            end_angle=angles[-1],
            ranges=distances.tolist(),
        )
        updates.add_message(time, f"/{mark.layer}/{name}", shown)


def show_images(updates: SceneUpdates, mark: Images) -> None:
    """Show images: colour images with frame and intrinsics of the camera, or depth images."""
    topic = f"/{mark.layer}"
    for number, (time, data) in enumerate(zip(mark.times.tolist(), mark.files, strict=True)):
        stamp = primitives.timestamp(time)
        if mark.kind == "depth":
            updates.add_message(time, f"{topic}/depth", _depth(stamp, data, mark.frame))
            continue
        view = float(mark.fields_of_view[number])
        updates.add_message(time, f"/tf/{mark.frame}", _frame(stamp, mark, number))
        updates.add_message(time, f"{topic}/calibration", _calibration(stamp, png.size(data), view, mark.frame))
        seen = CompressedImage(timestamp=stamp, frame_id=mark.frame, data=data, format="png")
        updates.add_message(time, f"{topic}/colour", seen)


def _frame(stamp: Timestamp, mark: Images, number: int) -> FrameTransform:
    """Return the frame of a camera, with x to the right of the image, y downwards and z ahead."""
    from scipy.spatial.transform import Rotation

    position = mark.positions[number]
    aside, above, ahead = line_of_sight(position, mark.targets[number])
    rotation = Rotation.from_matrix(np.stack([aside, -above, ahead], axis=1))
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=mark.frame,
        translation=primitives.vector(position.tolist()),
        rotation=primitives.quaternion(rotation.as_quat().tolist()),
    )


def _calibration(stamp: Timestamp, size: tuple[int, int], field_of_view: float, frame: str) -> CameraCalibration:
    """Return the intrinsics of a pinhole camera with square pixels."""
    width, height = size
    focal = 0.5 * height / np.tan(0.5 * field_of_view)
    lens = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
    return CameraCalibration(
        timestamp=stamp,
        frame_id=frame,
        width=width,
        height=height,
        K=lens.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.column_stack([lens, np.zeros(3)]).ravel().tolist(),
    )


def _depth(stamp: Timestamp, data: bytes, frame: str) -> RawImage:
    """Return depths in mm, 0 without an object, as in ROS (REP 118)."""
    depths = png.decode(data)
    height, width = depths.shape
    millimetres = np.where(depths == NOTHING, 0, depths).astype("<u2")
    return RawImage(
        timestamp=stamp,
        frame_id=frame,
        width=width,
        height=height,
        encoding="16UC1",
        step=2 * width,
        data=millimetres.tobytes(),
    )


Array = NDArray[np.float64]

#: Half the size of a dot [m], and its orientation.
_DOT, _UPRIGHT = np.full(3, 0.06), np.array([0.0, 0.0, 0.0, 1.0])
#: Opacity of dots, and of the surfaces of ellipsoids, through which other items must be visible.
_DOT_LEFT, _SURFACE_LEFT = 0.8, 0.35
#: Opacity of a fading line at its beginning and at its end.
_FADING = (0.95, 0.2)
#: Interval at which lasting lines are updated [ns].
_LASTING_STEP = 200_000_000
_STROKES = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]])
_RING = np.pad(circle(), ((0, 0), (0, 1)))

_LEVELS = {"DEBUG": LogLine.DEBUG, "INFO": LogLine.INFO, "WARNING": LogLine.WARNING, "ERROR": LogLine.ERROR}

Items = marks.Lines | marks.Points | marks.Crosses | marks.Rings | marks.Ellipsoids


def show(updates: SceneUpdates, mark: marks.Mark) -> None:
    """Show a mark, if Foxglove supports its kind."""
    shown = _SHOWN.get(type(mark))
    if shown is not None and len(mark.times):
        shown(updates, mark)


class _ItemEntities:
    """The items of a mark as entities, one for each name at each instant."""

    def __init__(self, mark: Items, count: int) -> None:
        self._mark = mark
        self._colours = [tuple(each) for each in np.broadcast_to(mark.colours, (count, 3)).tolist()]
        self._alphas = np.broadcast_to(1.0 - np.asarray(mark.transparency, float), count).round(3).tolist()
        self._made: dict[str, SceneEntity] = {}
        self._time = 0

    def instants(self) -> Iterator[tuple[int, range]]:
        """Yield the time of each instant [ns], and its items."""
        ends = np.cumsum(np.asarray(self._mark.counts, np.int64)).tolist()
        for time, first, end in zip(self._mark.times.tolist(), [0, *ends[:-1]], ends, strict=True):
            self._time, self._made = time, {}
            yield time, range(first, end)

    def entity(self, item: int) -> SceneEntity:
        """Return the entity of this instant that an item belongs to."""
        id = self._mark.path if self._mark.who is None else self._mark.names[self._mark.who[item]]
        if id not in self._made:
            self._made[id] = entity(id, self._time)
        return self._made[id]

    def shade(self, item: int, share: float = 1.0) -> Color:
        """Return the colour of an item, with reduced opacity."""
        return colour(self._colours[item], share * self._alphas[item])

    def fading(self, item: int, count: int) -> Sequence[Color]:
        """Return colours for the points of an item, each fainter than the one before."""
        return _fading(self._colours[item], self._alphas[item], count)

    def show_for(self, updates: SceneUpdates, lifetime: float) -> None:
        """Show the entities of this instant for some time [s], together with those that are shown already."""
        for made in self._made.values():
            made.lifetime.FromNanoseconds(int(1e9 * lifetime))
        if self._made:
            updates.add_message(
                self._time, f"/{self._mark.layer or self._mark.path}", SceneUpdate(entities=self._made.values())
            )

    def set_entities(self, updates: SceneUpdates) -> None:
        """Show the entities of this instant."""
        updates.set_entities(
            self._time, f"/{self._mark.layer or self._mark.path}", self._mark.path, self._made.values()
        )


def _show_lines(updates: SceneUpdates, mark: marks.Lines) -> None:
    lines = _split(mark)
    if mark.begins is not None:
        _show_once(updates, mark, lines, mark.begins)
        return
    if mark.lasting:
        _show_lasting(updates, mark, lines)
        return
    known = [bool(np.isfinite(line).all()) for line in lines]
    items = _ItemEntities(mark, len(lines))
    for _, some in items.instants():
        for item in (item for item in some if known[item]):
            shade = items.fading(item, len(lines[item])) if mark.fades else items.shade(item)
            line = primitives.line(lines[item], shade, mark.width, thickness=mark.thickness)
            items.entity(item).lines.append(line)
        items.set_entities(updates)


def _show_once(updates: SceneUpdates, mark: marks.Lines, lines: Sequence[Array], begins: NDArray[np.bool_]) -> None:
    """Show new lines, each for the time that it lasts, without moving it."""
    items = _ItemEntities(mark, len(lines))
    for _, some in items.instants():
        for item in some:
            if begins[item] and np.isfinite(lines[item]).all():
                items.entity(item).lines.append(primitives.line(lines[item], items.shade(item), mark.width))
        items.show_for(updates, mark.lasting)


def _show_lasting(updates: SceneUpdates, mark: marks.Lines, lines: Sequence[Array]) -> None:
    """Show lines that last for some time: those of one name are joined, since each continues the previous one."""
    who = np.arange(len(lines)) if mark.who is None else mark.who
    lately: deque[tuple[int, dict[int, Array]]] = updates.kept.setdefault(mark.path, deque())
    due = updates.kept.get((mark.path, "due"), 0)
    items = _ItemEntities(mark, len(lines))
    for time, some in items.instants():
        lately.append((time, {int(who[item]): lines[item] for item in some}))
        while lately[0][0] < time - 1e9 * mark.lasting:
            lately.popleft()
        if time < due:
            continue
        due = time + _LASTING_STEP
        for item in some:
            pieces = [pieces[who[item]] for _, pieces in lately if who[item] in pieces]
            points = np.concatenate([pieces[0][:1], *(piece[1:] for piece in pieces)])
            known = points[np.isfinite(points).all(axis=1)]
            items.entity(item).lines.append(primitives.line(known, items.shade(item), mark.width))
        items.set_entities(updates)
    updates.kept[mark.path, "due"] = due


@lru_cache(maxsize=1024)
def _fading(tint: tuple[int, int, int], alpha: float, count: int) -> Sequence[Color]:
    return [colour(tint, share * alpha) for share in np.linspace(*_FADING, count).tolist()]


def _split(mark: marks.Lines) -> Sequence[Array]:
    """Return the points of each line."""
    ends = np.cumsum(np.asarray(mark.lengths, np.int64)).tolist()
    return [mark.points[first:end] for first, end in zip([0, *ends[:-1]], ends, strict=False)]


def _show_points(updates: SceneUpdates, mark: marks.Points) -> None:
    _show_balls(updates, mark, mark.positions, np.broadcast_to(_DOT, mark.positions.shape), _DOT_LEFT)


def _show_ellipsoids(updates: SceneUpdates, mark: marks.Ellipsoids) -> None:
    sizes = np.where(mark.half_sizes[:, :1] > 0.0, mark.half_sizes, np.nan)
    _show_balls(updates, mark, mark.centres, sizes, _SURFACE_LEFT, mark.orientations)


def _show_balls(
    updates: SceneUpdates, mark: Items, centres: Array, sizes: Array, share: float, orientations: Array | None = None
) -> None:
    known = np.isfinite(np.concatenate([centres, sizes], axis=1)).all(axis=1).tolist()
    items = _ItemEntities(mark, len(centres))
    for _, some in items.instants():
        for item in (item for item in some if known[item]):
            turned = _UPRIGHT if orientations is None else orientations[item]
            ball = primitives.ellipsoid(centres[item], sizes[item], turned, items.shade(item, share))
            items.entity(item).spheres.append(ball)
        items.set_entities(updates)


def _show_crosses(updates: SceneUpdates, mark: marks.Crosses) -> None:
    items = _ItemEntities(mark, len(mark.positions))
    for _, some in items.instants():
        for item in some:
            ends = mark.positions[item] + mark.size * _STROKES
            items.entity(item).lines.append(primitives.strokes(ends, items.shade(item), mark.width))
        items.set_entities(updates)


def _show_rings(updates: SceneUpdates, mark: marks.Rings) -> None:
    items = _ItemEntities(mark, len(mark.centres))
    for _, some in items.instants():
        for item in (item for item in some if np.isfinite(mark.centres[item]).all()):
            ring = mark.centres[item] + mark.radii[item] * _RING
            items.entity(item).lines.append(primitives.line(ring, items.shade(item), mark.width))
        items.set_entities(updates)


def _show_curves(updates: SceneUpdates, mark: marks.Curves) -> None:
    columns, values = [(name, "") for name in mark.names], mark.values
    if mark.level is not None:
        columns.append((mark.level[0], ""))
        values = np.column_stack([values, np.full(len(values), mark.level[1])])
    given: dict[str, Any] = {"path": mark.path, "times": mark.times, "names": [mark.path], "columns": columns}
    _show_numbers(updates, marks.Numbers(values=values[:, None], **given))


def _show_numbers(updates: SceneUpdates, mark: marks.Numbers) -> None:
    if mark.path not in updates.kept:
        updates.kept[mark.path] = PlotChannel(mark.path, mark.columns, mark.names)
    columns: PlotChannel = updates.kept[mark.path]
    for time, values in zip(mark.times.tolist(), mark.values, strict=True):
        updates.add_message(time, f"/{mark.path}", columns.message(values), columns.metadata)


def _show_journal(updates: SceneUpdates, mark: marks.Journal) -> None:
    lines = zip(mark.times.tolist(), mark.kinds, mark.sources, mark.texts, mark.levels, strict=True)
    for time, kind, source, text, level in lines:
        line = LogLine(
            timestamp=primitives.timestamp(time),
            level=_LEVELS.get(level, LogLine.UNKNOWN),
            message=f"{kind} {text}".rstrip(),
            name=source,
        )
        updates.add_message(time, f"/{mark.layer or mark.path}", line)


_SHOWN: Mapping[type, Callable[[SceneUpdates, Any], None]] = {
    marks.Lines: _show_lines,
    marks.Points: _show_points,
    marks.Crosses: _show_crosses,
    marks.Rings: _show_rings,
    marks.Ellipsoids: _show_ellipsoids,
    marks.Bodies: show_bodies,
    marks.Solid: show_solid,
    marks.Figures: show_figures,
    marks.Rays: show_rays,
    marks.Images: show_images,
    marks.Curves: _show_curves,
    marks.Numbers: _show_numbers,
    marks.Journal: _show_journal,
}
