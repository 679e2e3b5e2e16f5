"""Shows marks in a Rerun recording, whole columns at a time.

Logging a single row takes Rerun about 100 us, in a column less than half a microsecond (benchmarks/RESULTS.md), so no
function here is called for single rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.log.sensor_channels import hits
from symaware_cli.views.outline import circle
from symaware_cli.views.palette import CONTACT, DARK, ReplayTheme
from symaware_cli.views.rerun.bodies import show_bodies, show_figures, show_ground, show_solid
from symaware_cli.views.rerun.columns import TIMELINE, flat, packed, shades, turns
from symaware_cli.views.rerun.labels import Labels, SceneView
from symaware_cli.views.rerun.lines import show_crosses, show_lines
from symaware_cli.views.scene import marks

if TYPE_CHECKING:
    import rerun as rr

#: The colour of level lines.
_LEVEL = CONTACT
_LEVELS = {"DEBUG": "DEBUG", "INFO": "INFO", "WARNING": "WARN", "ERROR": "ERROR"}


Array = NDArray[np.float64]


class RerunOutput:
    """Shows marks in a Rerun recording; below, k is a number of instants.

    Attributes:
        theme: The colours of the surroundings of agents.
    """

    def __init__(self, recording: rr.RecordingStream, theme: ReplayTheme = DARK, view: SceneView | None = None) -> None:
        """Begin with an empty recording.

        Args:
            recording: The recording.
            theme: The colours of the surroundings of agents.
            view: The view in which labels are placed; None if it is not known how large the scene is.
        """
        self._recording, self.theme = recording, theme
        self._labels = Labels(view or SceneView())
        # Simulated time is the only timeline.
        recording.set_log_time_enabled(False)
        recording.set_log_tick_enabled(False)
        self._begun: set[str] = set()

    def show(self, mark: marks.Mark) -> None:
        """Show a mark, if Rerun supports its kind."""
        shown = _SHOWN.get(type(mark))
        if shown is not None:
            shown(self, mark)

    def document(self, path: str, text: str) -> None:
        """Log a Markdown text that is valid at all times."""
        import rerun as rr

        self.static(path, rr.TextDocument(text, media_type="text/markdown"))

    def label(self, mark: marks.Bodies, positions: Array) -> None:
        """Take bodies at (k, n, 3) positions [m]; their labels are placed when the data leave this process."""
        self._labels.take(mark, positions)

    def label_area(self, mark: marks.Solid) -> None:
        """Take an area; its label is placed when the data leave this process."""
        self._labels.take_area(mark)

    def flush(self, *, whole: bool = True) -> None:
        """Place the labels, and wait until all data have left this process.

        Args:
            whole: False if more is to come, for which the last labels wait.

        Raises:
            RuntimeError: They could not be written or sent.
        """
        self._labels.show(self, whole=whole)
        self._recording.flush()

    def scale_bar(self, path: str, ends: Array, text: str) -> None:
        """Show a bar (2, 3) [m] at all times, with its length below it."""
        import rerun as rr

        bar = rr.LineStrips3D([ends], colors=[self.theme.faint], radii=rr.Radius.ui_points([1.5]))
        unseen = rr.Radius.ui_points([0.0])
        middle = [ends.mean(axis=0)]
        label = rr.Points3D(middle, labels=[text], show_labels=True, colors=[self.theme.ink], radii=unseen)
        self.static(path, bar)
        self.static(f"{path}/label", label)

    def static(self, path: str, *archetypes: rr.AsComponents) -> None:
        """Log archetypes that are valid at all times."""
        for archetype in archetypes:
            self._recording.log(path, archetype, static=True, strict=True)

    def is_new(self, path: str) -> bool:
        """Whether this is the first call for a path, so that its static components must be logged."""
        new = path not in self._begun
        self._begun.add(path)
        return new

    def send(self, path: str, times: marks.Times, columns: Any, counts: ArrayLike | None = None) -> None:
        """Send values at (k,) times [ns]; see `ColumnReceiver`."""
        import rerun as rr

        if not len(times):
            return
        index = rr.TimeColumn(TIMELINE, duration=times.astype("timedelta64[ns]"))
        parts = columns if counts is None else columns.partition(counts)
        self._recording.send_columns(path, [index], parts, strict=True)


def _show_points(output: RerunOutput, mark: marks.Points) -> None:
    import rerun as rr

    if output.is_new(mark.path):
        output.static(mark.path, rr.Points3D.from_fields(radii=rr.Radius.ui_points([mark.size])))
    colours = packed(shades(mark.colours, mark.transparency, len(mark.positions), output.theme))
    output.send(mark.path, mark.times, rr.Points3D.columns(positions=flat(mark.positions), colors=colours), mark.counts)


def _show_rings(output: RerunOutput, mark: marks.Rings) -> None:
    import rerun as rr

    if output.is_new(mark.path):
        thick = rr.Radius.ui_points([mark.width])
        look = rr.Cylinders3D.from_fields(lengths=[0.0], line_radii=thick, fill_mode="majorwireframe")
        output.static(mark.path, look)
    colours = packed(shades(mark.colours, mark.transparency, len(mark.centres), output.theme))
    rings = rr.Cylinders3D.columns(centers=flat(mark.centres), radii=mark.radii.astype(np.float32), colors=colours)
    output.send(mark.path, mark.times, rings, mark.counts)


def _show_ellipsoids(output: RerunOutput, mark: marks.Ellipsoids) -> None:
    import rerun as rr

    if output.is_new(mark.path):
        thin = rr.Radius.ui_points([mark.width])
        output.static(mark.path, rr.Ellipsoids3D.from_fields(line_radii=thin, fill_mode="majorwireframe"))
    shown = rr.Ellipsoids3D.columns(
        centers=flat(mark.centres),
        half_sizes=flat(mark.half_sizes),
        quaternions=turns(mark.orientations),
        colors=packed(shades(mark.colours, mark.transparency, len(mark.centres), output.theme)),
    )
    output.send(mark.path, mark.times, shown, mark.counts)


def _show_place(output: RerunOutput, mark: marks.FocusPoint) -> None:
    """Move an invisible point, since the camera can only follow an entity that is drawn."""
    import rerun as rr

    if output.is_new(mark.path):
        output.static(mark.path, rr.Points3D([[0.0, 0.0, 0.0]], radii=rr.Radius.ui_points([0.0])))
        if mark.reach:
            ring = np.pad(circle(mark.reach, corners=96), ((0, 0), (0, 1)))
            shown = rr.LineStrips3D([ring], colors=[output.theme.faint], radii=rr.Radius.ui_points([1.0]))
            output.static(f"{mark.path}/range", shown)
    output.send(mark.path, mark.times, rr.Transform3D.columns(translation=flat(mark.positions)))


def _show_rays(output: RerunOutput, mark: marks.Rays) -> None:
    """Show the ends of rays."""
    flatten = np.array([1.0, 1.0, float(mark.spatial)])
    found = [flatten * hits(*each) for each in zip(mark.angles, mark.distances, mark.poses, strict=True)]
    lengths = [len(points) for points in found]
    times, which = np.unique(mark.times, return_inverse=True)
    dots = marks.Points(
        path=mark.path,
        times=times,
        counts=np.bincount(which, weights=lengths, minlength=len(times)).astype(np.int64),
        positions=np.concatenate([np.empty((0, 3)), *found]),
        colours=np.repeat(mark.colours, lengths, axis=0),
        size=mark.size,
    )
    _show_points(output, dots)


def _show_images(output: RerunOutput, mark: marks.Images) -> None:
    import rerun as rr

    kind = rr.EncodedDepthImage if mark.kind == "depth" else rr.EncodedImage
    images = kind.columns(blob=list(mark.files), media_type=["image/png"] * len(mark.files))
    output.send(mark.path, mark.times, images)


def _show_curves(output: RerunOutput, mark: marks.Curves) -> None:
    import rerun as rr

    if output.is_new(mark.path):
        policy = rr.components.AggregationPolicy
        kept = {"greatest": policy.Max, "least": policy.Min, "both": policy.MinMax}[mark.keep]
        widths = [mark.width] * len(mark.names)
        course = rr.components.InterpolationMode
        lines = rr.SeriesLines(
            names=list(mark.names),
            colors=mark.colours,
            widths=widths,
            aggregation_policy=kept,
            interpolation_mode=course.StepAfter if mark.stepwise else course.Linear,
        )
        output.static(mark.path, lines)
    if mark.level is not None:
        name, height = mark.level
        given: dict[str, Any] = {"path": f"{mark.path}/level", "times": mark.times, "names": [name]}
        values = np.full((len(mark.times), 1), height)
        _show_curves(output, marks.Curves(values=values, colours=[_LEVEL], width=1.0, **given))
        _show_bottomless(output, mark, height)
    # Infinite values leave a gap, since no axis extends that far.
    shown = np.where(np.isfinite(mark.values), mark.values, np.nan)
    counts = [mark.values.shape[1]] * len(mark.values)
    output.send(mark.path, mark.times, rr.Scalars.columns(scalars=shown.ravel()), counts)


def _show_bottomless(output: RerunOutput, mark: marks.Curves, height: float) -> None:
    """Show values of -inf as triangles that point down from a level: they are below it, and no axis reaches them."""
    import rerun as rr

    colours = None if mark.colours is None else np.broadcast_to(np.asarray(mark.colours), (len(mark.names), 3))
    for number, column in enumerate(mark.values.T):
        times = mark.times[column == -np.inf]
        path = f"{mark.path}/bottomless/{number}"
        if len(times) and output.is_new(path):
            look: dict[str, Any] = {"names": [f"{mark.names[number]}: -inf"], "markers": "down", "marker_sizes": [4.0]}
            output.static(path, rr.SeriesPoints(colors=None if colours is None else [colours[number]], **look))
        output.send(path, times, rr.Scalars.columns(scalars=np.full(len(times), height)))


def _show_journal(output: RerunOutput, mark: marks.Journal) -> None:
    import rerun as rr

    lines = zip(mark.times.tolist(), mark.kinds, mark.sources, mark.texts, strict=True)
    texts = [f"{time / 1e9:8.2f} s  {kind}  {source}  {text}".rstrip() for time, kind, source, text in lines]
    levels = [_LEVELS.get(level, "INFO") for level in mark.levels]
    output.send(mark.path, mark.times, rr.TextLog.columns(text=texts, level=levels))


def _show_modes(output: RerunOutput, mark: marks.Modes) -> None:
    import rerun as rr

    if mark.tints and output.is_new(mark.path):
        values, tints = list(mark.tints), [tuple(tint) for tint in mark.tints.values()]
        output.static(mark.path, rr.StateConfiguration(values=values, labels=values, colors=tints))
    output.send(mark.path, mark.times, rr.StateChange.columns(state=list(mark.modes)))


def _show_documents(output: RerunOutput, mark: marks.Documents) -> None:
    import rerun as rr

    kinds = ["text/markdown"] * len(mark.texts)
    output.send(mark.path, mark.times, rr.TextDocument.columns(text=list(mark.texts), media_type=kinds))


_SHOWN: Mapping[type, Callable[[RerunOutput, Any], None]] = {
    marks.Lines: show_lines,
    marks.Points: _show_points,
    marks.Crosses: show_crosses,
    marks.Rings: _show_rings,
    marks.Ellipsoids: _show_ellipsoids,
    marks.Bodies: show_bodies,
    marks.Solid: show_solid,
    marks.Figures: show_figures,
    marks.Ground: show_ground,
    marks.FocusPoint: _show_place,
    marks.Rays: _show_rays,
    marks.Images: _show_images,
    marks.Curves: _show_curves,
    marks.Journal: _show_journal,
    marks.Modes: _show_modes,
    marks.Documents: _show_documents,
}
