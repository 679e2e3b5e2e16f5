"""Draws the marks of a replay at successive instants, as pictures in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from symaware_cli.geometry import rotated
from symaware_cli.log.sensor_channels import hits
from symaware_cli.views.label_layout import labels_beside
from symaware_cli.views.outline import circle, dashes, outlines
from symaware_cli.views.palette import Colour, ReplayTheme, hexadecimal
from symaware_cli.views.plotting.figure_style import styled
from symaware_cli.views.plotting.region_labels import LabelledRegion, label_places
from symaware_cli.views.scale_bar import round_interval
from symaware_cli.views.scene import marks
from symaware_cli.views.scene.marks import ACTIVE, PAST
from symaware_cli.views.video.viewpoint import Viewpoint

Array = NDArray[np.float64]

#: Dots per inch of a frame, and the size of its text [points].
_DPI, _WORDS = 100, 9.0

#: Size of a letter, relative to the size of the text.
_LETTER = np.array([0.62, 1.35])

#: Number of points of a circle, and the margin of the picture around its content, as a part of the picture.
_CIRCLE = circle(corners=32)[:-1]
_MARGIN = 0.06

#: Height of the strip below the picture with the elapsed time, and of the text at the top [pixels].
_FOOT, _HEAD = 6, 26

#: Radius of a body without a size [pixels].
_POINT = 4.0

#: The position of trails in the order of drawing.
_TRAIL = 3.0

#: Number of specifications whose verdicts are shown.
_VERDICTS = 6

Drawer = Callable[["FramePainter", Any, int], None]


class FramePainter:
    """Draws frames of one run, at instants in ascending order."""

    def __init__(
        self,
        corners: tuple[Array, Array],
        viewpoint: Viewpoint,
        theme: ReplayTheme,
        size: tuple[int, int],
        title: str,
        trail: float,
        span: tuple[int, int],
    ) -> None:
        """Prepare.

        Args:
            corners: The corners of the bounding box of the content, (3,) each [m].
            viewpoint: The viewpoint of the frames.
            theme: The colours around the agents.
            size: Width and height of a frame [pixels].
            title: The text at the top.
            trail: The time for which past positions are shown [s].
            span: The first and the last instant of the video [ns].
        """
        self._viewpoint, self._theme, self._size, self._title = viewpoint, theme, size, title
        self._trail, self._span = round(1e9 * trail), span
        low, high = corners
        box = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        seen = viewpoint.project(box)
        least, greatest = seen.min(axis=0), seen.max(axis=0)
        room = np.array([size[0], size[1] - _HEAD - _FOOT]) * (1.0 - 2.0 * _MARGIN)
        #: Metres per pixel.
        self._scale = float(max((np.maximum(greatest - least, 1e-3) / room).max(), 1e-6))
        half = 0.5 * self._scale * np.array(size)
        middle = 0.5 * (least + greatest) + np.array([0.0, 0.5 * self._scale * (_HEAD - _FOOT)])
        self._low, self._high = middle - half, middle + half
        #: The marks that may still be shown, in order, by path.
        self._taken: dict[str, list[marks.Mark]] = {}
        self._trails: dict[str, list[marks.Lines]] = {}
        #: The last places of the labels of bodies, and the places of the labels of regions as long as the regions stay.
        self._places: NDArray[np.intp] | None = None
        self._region_places: dict[tuple[Any, ...], list[Array | None]] = {}
        with styled():
            figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI)
            self._canvas = FigureCanvasAgg(figure)
            figure.set_facecolor(hexadecimal(theme.background))
            self._axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
            self._axes.set_axis_off()
            self._axes.set(xlim=(self._low[0], self._high[0]), ylim=(self._low[1], self._high[1]))

    def take(self, mark: marks.Mark) -> None:
        """Add a mark, which replaces the earlier one at its path from its first instant on."""
        if not len(mark.times) or not isinstance(mark, _Drawn):
            return
        if mark.path.startswith("as/"):
            return
        if isinstance(mark, marks.Lines) and mark.path.endswith("/trail"):
            self._trails.setdefault(mark.path, []).append(mark)
        else:
            self._taken.setdefault(mark.path, []).append(mark)

    def _shown(self, time: int) -> Iterator[tuple[Any, int]]:
        """Yield the marks that are shown at an instant [ns], each with the index of its instant."""
        for waiting in self._taken.values():
            while len(waiting) > 1 and waiting[1].times[0] <= time:
                del waiting[0]
            mark = waiting[0]
            if mark.times[0] <= time:
                yield mark, int(np.searchsorted(mark.times, time, side="right")) - 1

    def frame(self, time: int) -> NDArray[np.uint8]:
        """Draw an instant [ns]; (height, width, 3)."""
        with styled():
            for artist in (*self._axes.collections, *self._axes.lines, *self._axes.texts):
                artist.remove()
            self._faces: list[tuple[float, Array, Any]] = []
            for mark, index in self._shown(time):
                _DRAWERS[type(mark)](self, mark, index)
            self._draw_faces()
            self._draw_trails(time)
            self._draw_region_labels(time)
            self._draw_labels(time)
            self._draw_words(time)
            self._canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib has types in part
            pixels = self._canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # matplotlib has types in part
            return np.array(pixels, np.uint8)[..., :3].copy()

    # ---- surfaces

    def _draw_faces(self) -> None:
        """Draw all surfaces, the farthest first."""
        faces = sorted(self._faces, key=lambda face: face[0])
        if faces:
            colours = [colour for _, _, colour in faces]
            edge = _rgba(self._theme.background, 0.6)
            shapes = PolyCollection(
                [corners for _, corners, _ in faces], facecolors=colours, edgecolors=[edge], linewidths=0.6, zorder=4
            )
            self._axes.add_collection(shapes, autolim=False)

    def _surface(self, corners: Array, colour: Any) -> None:
        """Add a convex body with corners (m, 3) [m] to those to draw."""
        seen = self._viewpoint.project(corners)
        if np.isfinite(seen).all():
            self._faces.append((float(self._viewpoint.nearness(corners).mean()), _hull(seen), colour))

    def _draw_solid(self, mark: marks.Solid, index: int) -> None:
        position, orientation = mark.positions[index], mark.orientations[index]
        phase = ACTIVE if mark.phases is None else int(mark.phases[index])
        for outline in mark.outlines:
            heights = (mark.low,) if mark.low == mark.high else (mark.low, mark.high)
            levels = [np.pad(outline, ((0, 0), (0, 1)), constant_values=height) for height in heights]
            corners = position + rotated(orientation, np.concatenate(levels))
            if mark.layer != "regions":
                self._surface(corners, _rgba(self._mixed(mark.colour, mark.faded), 1.0 - mark.transparency))
            elif phase == ACTIVE:
                self._surface(corners, _rgba(mark.colour, 0.3))
            else:
                lines = [corners] if phase == PAST else [position + line for line in dashes(outline, mark.low)]
                self._lines(lines, [_rgba(mark.colour, 0.25 if phase == PAST else 0.8)], 1.0, 1.0)

    def _draw_bodies(self, mark: marks.Bodies, index: int) -> None:
        shape, colours = mark.shape, mark.colours[index]
        for row, position in enumerate(mark.positions[index]):
            if not np.isfinite(position).all():
                continue
            colour, orientation = _rgba(colours[row]), mark.orientations[index, row]
            if mark.ring is not None:
                centre, radius = mark.ring
                middle = position + rotated(orientation, centre)
                middle[2] = max(middle[2], mark.floor)
                self._lines([middle + radius * np.pad(_CIRCLE, ((0, 0), (0, 1)))], [colour], 1.5, 6.0, closed=True)
                continue
            for corners in self._body(mark, position, orientation):
                self._surface(corners, colour)
            if mark.nosed and shape is not None:
                facing = rotated(orientation, np.array([1.0, 0.0, 0.0]))
                ends = position + np.outer([0.25 * shape.radius, 1.35 * shape.radius], facing)
                self._lines([ends], [_rgba(self._theme.ink)], 1.8, 6.0)

    def _body(self, mark: marks.Bodies, position: Array, orientation: Array) -> Iterator[Array]:
        """Yield the corners (m, 3) of the convex pieces of a body."""
        shape = mark.shape
        across = np.array([self._viewpoint.right, self._viewpoint.up])
        if shape is None:
            yield position + _POINT * self._scale * _CIRCLE @ across
            return
        if mark.spatial and not (shape.box or shape.cylinder):
            yield position + shape.radius * _CIRCLE @ across  # balls look the same from all sides
            return
        height = shape.box.upright if shape.box else shape.cylinder.height if shape.cylinder else 0.0
        levels = (-0.5 * height, 0.5 * height) if mark.spatial else (0.0,)
        for outline in outlines(shape.pieces):
            corners = [np.pad(outline, ((0, 0), (0, 1)), constant_values=level) for level in levels]
            yield position + rotated(orientation, np.concatenate(corners))

    def _draw_figures(self, mark: marks.Figures, index: int) -> None:
        """Draw links as the boxes around their visuals."""
        one = slice(index, index + 1)
        placed = mark.figure.places(mark.positions[one], mark.orientations[one], mark.joints[one])
        for corners in mark.figure.boxes(placed):
            for body in corners[0]:
                self._surface(body, _rgba(mark.colour))

    # ---- items

    def _draw_lines(self, mark: marks.Lines, index: int) -> None:
        first, last = _items(mark, index)
        ends = np.cumsum(np.asarray(mark.lengths, np.int64))
        lengths = np.asarray(mark.lengths)
        lines = [mark.points[ends[item] - lengths[item] : ends[item]] for item in range(first, last)]
        colours = self._colours(mark, first, last)
        above = 7.0 if mark.layer in ("contacts", "messages") or mark.path.startswith("world/messages") else 3.0
        width = mark.thickness / self._scale * 72.0 / _DPI if mark.thickness else mark.width * 0.9
        if mark.thickness:
            above = 0.5  # areas on the ground
        if not mark.fades:
            self._lines(lines, colours, width, above)
            return
        for line, colour in zip(lines, colours, strict=True):
            pieces = [line[number : number + 2] for number in range(len(line) - 1)]
            shares = np.linspace(0.9, 0.15, max(len(pieces), 1))
            self._lines(pieces, [(*colour[:3], colour[3] * share) for share in shares.tolist()], width, above)

    def _draw_points(self, mark: marks.Points, index: int) -> None:
        first, last = _items(mark, index)
        self._dots(mark.positions[first:last], self._colours(mark, first, last), mark.size)

    def _draw_crosses(self, mark: marks.Crosses, index: int) -> None:
        first, last = _items(mark, index)
        strokes = mark.size * np.array([[(-1, -1, 0), (1, 1, 0)], [(-1, 1, 0), (1, -1, 0)]])
        lines = [position + stroke for position in mark.positions[first:last] for stroke in strokes]
        self._lines(lines, [each for each in self._colours(mark, first, last) for _ in range(2)], mark.width, 2.5)

    def _draw_rings(self, mark: marks.Rings, index: int) -> None:
        first, last = _items(mark, index)
        rounds = [
            centre + radius * np.pad(_CIRCLE, ((0, 0), (0, 1)))
            for centre, radius in zip(mark.centres[first:last], mark.radii[first:last], strict=True)
        ]
        self._lines(rounds, self._colours(mark, first, last), mark.width, 7.0, closed=True)

    def _draw_ellipsoids(self, mark: marks.Ellipsoids, index: int) -> None:
        first, last = _items(mark, index)
        loops, colours = list[Array](), list[Any]()
        for item, colour in zip(range(first, last), self._colours(mark, first, last), strict=True):
            axes = rotated(mark.orientations[item], np.diag(mark.half_sizes[item]))
            # The outline of the ellipsoid in the picture is an ellipse; these are its axes.
            seen = self._viewpoint.project(axes)
            if np.isfinite(seen).all():
                values, directions = np.linalg.eigh(seen.T @ seen)
                loops.append(
                    self._viewpoint.project(mark.centres[item])
                    + (_CIRCLE * np.sqrt(np.maximum(values, 0.0))) @ directions.T
                )
                colours.append(colour)
        self._flat_lines(loops, colours, max(mark.width, 0.8), 3.4, closed=True)

    def _draw_rays(self, mark: marks.Rays, index: int) -> None:
        (same,) = np.nonzero(mark.times == mark.times[index])
        flatten = np.array([1.0, 1.0, float(mark.spatial)])
        for number in same.tolist():
            found = flatten * hits(mark.angles[number], mark.distances[number], mark.poses[number])
            self._dots(found, [_rgba(mark.colours[number], 0.7)] * len(found), mark.size)

    def _draw_trails(self, time: int) -> None:
        """Draw past positions, fainter with age."""
        lines, colours = list[Array](), list[Array]()
        for path, parts in self._trails.items():
            self._trails[path] = kept = [part for part in parts if part.times[-1] > time - self._trail]
            for mark in kept:
                counts = np.cumsum(np.asarray(mark.counts, np.int64))
                first, last = np.searchsorted(mark.times, [time - self._trail, time], side="right")
                begin, end = (int(counts[each - 1]) if each else 0 for each in (first, last))
                if end <= begin:
                    continue
                ages = (time - np.repeat(mark.times, np.asarray(mark.counts, np.int64))[begin:end]) / self._trail
                alphas = 0.85 - 0.75 * np.clip(ages, 0.0, 1.0)
                tints = np.broadcast_to(np.asarray(mark.colours), (int(counts[-1]), 3))[begin:end]
                colours.append(np.column_stack([tints / 255.0, alphas]))
                lines.append(mark.points.reshape(-1, 2, 3)[begin:end])
        if lines:
            self._lines(np.concatenate(lines), np.concatenate(colours), 1.8, _TRAIL)

    # ---- text

    def _draw_region_labels(self, time: int) -> None:
        """Write the names of regions at places where they cover no other region."""
        regions, words = list[LabelledRegion](), list[tuple[str, Any]]()
        for mark, index in self._shown(time):
            if not isinstance(mark, marks.Solid) or mark.layer != "regions" or not mark.label:
                continue
            if mark.phases is not None and mark.phases[index] == PAST:
                continue
            place = mark.positions[index], mark.orientations[index]
            levels = [np.pad(each, ((0, 0), (0, 1)), constant_values=mark.low) for each in mark.outlines]
            around = [self._viewpoint.project(place[0] + rotated(place[1], each)) for each in levels]
            preferred = self._viewpoint.project(
                place[0] + rotated(place[1], np.array([*mark.label_at, mark.low], float))
            )
            regions.append(LabelledRegion(around, self._extent(mark.label), preferred))
            words.append((mark.label, _rgba(_towards(mark.colour, self._theme.ink, 0.35))))
        where = tuple((text, *each.preferred.tolist()) for (text, _), each in zip(words, regions, strict=True))
        if where not in self._region_places:
            head = np.array([0.0, _HEAD * self._scale])
            self._region_places = {where: label_places(regions, self._low, self._high - head)}
        for (text, colour), middle in zip(words, self._region_places[where], strict=True):
            if middle is not None:
                self._write(text, middle, colour, 4.5)

    def _draw_labels(self, time: int) -> None:
        """Write the names of bodies beside them, at places where they cover nothing."""
        centres, extents, names, colours, labelled = list[Array](), list[float](), list[str](), list[Any](), list[int]()
        for mark, index in self._shown(time):
            if not isinstance(mark, marks.Bodies) or mark.path.startswith("other/"):
                continue
            for row, position in enumerate(self._viewpoint.project(mark.positions[index])):
                if row in mark.labels:
                    labelled.append(len(centres))
                    names.append(mark.labels[row])
                    colours.append(_rgba(_towards(mark.label_colours[row], self._theme.ink, 0.3)))
                centres.append(position)
                extents.append(max(mark.extent, _POINT * self._scale))
        if not labelled:
            return
        sizes = np.array([self._extent(name) for name in names])
        before = self._places if self._places is not None and len(self._places) == len(labelled) else None
        places, self._places = labels_beside(np.array(centres)[None], np.array(extents), labelled, sizes, before)
        for name, colour, place in zip(names, colours, places[0], strict=True):
            if np.isfinite(place).all():
                self._write(name, place, colour, 8.0)

    def _draw_words(self, time: int) -> None:
        """Write the title, the time and the verdicts, and draw the scale and the progress of the run."""
        ink, faint = _rgba(self._theme.ink), _rgba(self._theme.faint)
        top = self._high[1] - 0.5 * _HEAD * self._scale
        edge = 10.0 * self._scale
        style: dict[str, Any] = {"va": "center", "zorder": 10, "fontsize": _WORDS + 1.0, "color": ink}
        self._axes.text(self._low[0] + edge, top, self._title, ha="left", fontweight="bold", **style)
        self._axes.text(self._high[0] - edge, top, f"{time / 1e9:.1f} s", ha="right", **style)
        verdicts = [(mark, index) for mark, index in self._shown(time) if mark.path.startswith("verdicts/")]
        for row, (mark, index) in enumerate(verdicts[:_VERDICTS]):
            mode = mark.modes[index]
            look = {**style, "color": _rgba(mark.tints.get(mode, self._theme.faint)), "fontsize": _WORDS}
            y = top - (row + 1) * 17.0 * self._scale
            words = f"{mark.path.removeprefix('verdicts/')}: {mode}"
            self._axes.text(self._high[0] - edge, y, words, ha="right", **look)
        length = round_interval(0.8 * self._size[0] * self._scale, 4)
        left, low = self._low[0] + edge, self._low[1] + (_FOOT + 12.0) * self._scale
        tick = 3.0 * self._scale
        ends = [left, left, left + length, left + length]
        self._axes.plot(ends, [low + tick, low, low, low + tick], color=faint, linewidth=1.2, zorder=10)
        where: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": _WORDS, "color": faint, "zorder": 10}
        self._axes.text(left + 0.5 * length, low + tick, f"{length:g} m", **where)
        first, last = self._span
        share = (time - first) / max(last - first, 1)
        foot = self._low[1] + 0.5 * _FOOT * self._scale
        wide: dict[str, Any] = {"linewidth": 0.6 * _FOOT, "solid_capstyle": "butt", "zorder": 10}
        across = self._high[0] - self._low[0]
        self._axes.plot([self._low[0], self._low[0] + share * across], [foot, foot], color=faint, **wide)

    def _extent(self, text: str) -> Array:
        """Return width and height of a label (2,) [m]."""
        letters = _LETTER * np.array([len(text), 1.0]) + np.array([0.4, 0.2])
        extent: Array = letters * _WORDS * _DPI / 72.0 * self._scale
        return extent

    def _write(self, text: str, middle: Array, colour: Any, above: float) -> None:
        style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": _WORDS, "zorder": above}
        self._axes.text(float(middle[0]), float(middle[1]), text, color=colour, **style)

    # ---- lines and dots

    def _lines(
        self,
        lines: Sequence[Array] | Array,
        colours: Sequence[Any] | Array,
        width: float,
        above: float,
        *,
        closed: bool = False,
    ) -> None:
        """Draw lines (m, 3) each [m]."""
        # Together if they have equally many points, as the thousands of pieces of trails have.
        alike = len(set(map(len, lines))) == 1
        seen: Sequence[Array] | Array = (
            self._viewpoint.project(np.asarray(lines)) if alike else list(map(self._viewpoint.project, lines))
        )
        self._flat_lines(seen, colours, width, above, closed=closed)

    def _flat_lines(
        self,
        lines: Sequence[Array] | Array,
        colours: Sequence[Any] | Array,
        width: float,
        above: float,
        *,
        closed: bool = False,
    ) -> None:
        """Draw lines (m, 2) each [m]."""
        shown = [np.concatenate([line, line[:1]]) if closed else line for line in lines]
        if shown:
            # Round ends of transparent pieces would overlap visibly.
            ends = "butt" if above == _TRAIL else "round"
            drawn = LineCollection(shown, colors=list(colours), linewidths=width, capstyle=ends, zorder=above)
            self._axes.add_collection(drawn, autolim=False)

    def _dots(self, positions: Array, colours: Sequence[Any], size: float) -> None:
        seen = self._viewpoint.project(positions)
        known = np.isfinite(seen).all(axis=-1)
        if known.any():
            x, y = seen[known].T
            shades = [colours[number] for number in np.flatnonzero(known).tolist()]
            self._axes.scatter(x, y, s=size**2, c=shades, linewidths=0.0, zorder=3.6)

    def _colours(self, mark: Any, first: int, last: int) -> list[tuple[float, float, float, float]]:
        """Return the colours of some items of a mark."""
        count = int(np.asarray(mark.counts).sum())
        tints = np.broadcast_to(np.asarray(mark.colours), (count, 3))[first:last]
        alphas = 1.0 - np.broadcast_to(np.asarray(mark.transparency, float), (count,))[first:last]
        return [_rgba(tint, alpha) for tint, alpha in zip(tints, alphas.tolist(), strict=True)]

    def _mixed(self, colour: Sequence[int], share: float) -> Colour:
        return _towards(colour, self._theme.background, share)


_DRAWERS: Mapping[type, Drawer] = {
    marks.Solid: FramePainter._draw_solid,
    marks.Bodies: FramePainter._draw_bodies,
    marks.Figures: FramePainter._draw_figures,
    marks.Lines: FramePainter._draw_lines,
    marks.Points: FramePainter._draw_points,
    marks.Crosses: FramePainter._draw_crosses,
    marks.Rings: FramePainter._draw_rings,
    marks.Ellipsoids: FramePainter._draw_ellipsoids,
    marks.Rays: FramePainter._draw_rays,
    marks.Modes: lambda painter, mark, index: None,  # drawn with the text
}
_Drawn = tuple(_DRAWERS)


def _items(mark: Any, index: int) -> tuple[int, int]:
    """Return the range of the items of an instant: the first, and the one after the last."""
    counts = np.asarray(mark.counts, np.int64)
    first = int(counts[:index].sum())
    return first, first + int(counts[index])


def _rgba(colour: Any, alpha: float = 1.0) -> tuple[float, float, float, float]:
    red, green, blue = (float(part) / 255.0 for part in np.asarray(colour)[:3])
    return red, green, blue, float(alpha)


def _towards(colour: Any, other: Colour, share: float) -> Colour:
    """Mix a colour with another one, with the given share of the latter."""
    red, green, blue = np.round(np.asarray(colour, float)[:3] * (1.0 - share) + share * np.array(other)).astype(int)
    return int(red), int(green), int(blue)


def _hull(points: Array) -> Array:
    """Return the corners of the convex hull of points (m, 2), or the points themselves if they are collinear."""
    if len(points) < 4:
        return points
    from scipy.spatial import ConvexHull, QhullError

    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return points
