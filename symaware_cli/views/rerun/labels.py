"""Labels of bodies and areas in Rerun, at places where they cover neither bodies nor each other in the fitted view."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.label_layout import Labels as PlacedLabels
from symaware_cli.views.label_layout import labels_among, labels_beside
from symaware_cli.views.palette import faded
from symaware_cli.views.rerun.columns import flat, packed
from symaware_cli.views.scene.marks import ACTIVE
from symaware_cli.views.video.viewpoint import VIEWPOINTS, Viewpoint

if TYPE_CHECKING:
    from symaware_cli.views.rerun.columns import ColumnReceiver
    from symaware_cli.views.scene.marks import Bodies, Solid

Array = NDArray[np.float64]

#: Width of a letter, and width and height of what is around the text of a label, in points of the viewer.
_LETTER, _AROUND = 7.5, np.array([10.0, 20.0])

#: The time for which a label keeps its place beside its body [ns].
_STEADY = 500_000_000

#: Share of the colour of words in that of a label, which would often be too dark, or too pale, to be read. The viewer
#: writes on dark grey, which is lighter before a light background.
_LEGIBLE = {"dark": 0.4, "light": 0.85}

#: Size of a body with a line that shows its heading, relative to the body.
_NOSED = 1.6


@dataclass(frozen=True)
class SceneView:
    """The fitted view of the scene.

    Attributes:
        viewpoint: From where it is seen.
        scale: Length of a point of the viewer at the scene [m]; 0 if it is not known.
    """

    viewpoint: Viewpoint = VIEWPOINTS["above"]
    scale: float = 0.0


@dataclass
class _Group:
    """The bodies at one path: their last mark, and the positions since labels were placed."""

    mark: Bodies
    times: list[NDArray[np.int64]] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    last: Array | None = None
    begun: bool = False

    @property
    def path(self) -> str:
        return self.mark.path


@dataclass
class _Area:
    """An area: the places of its label relative to it, and its positions since labels were placed; NaN if hidden."""

    path: str
    text: str
    colour: NDArray[np.uint8]
    places: Array  # (c, 3) [m]
    times: list[NDArray[np.int64]] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    last: Array = field(default_factory=lambda: np.full(3, np.nan))
    begun: bool = False


class Labels:
    """Collects the bodies and areas in a chunk of the log, and places their labels together."""

    def __init__(self, view: SceneView) -> None:
        self._view = view
        self._groups: dict[str, _Group] = {}
        self._areas: dict[str, _Area] = {}
        self._beside: NDArray[np.intp] | None = None
        self._within: NDArray[np.intp] | None = None

    def take(self, mark: Bodies, positions: Array) -> None:
        """Take bodies at (k, n, 3) positions [m]; marks of a path come in order of time."""
        group = self._groups.setdefault(mark.path, _Group(mark))
        group.mark = mark
        group.times.append(mark.times)
        group.positions.append(positions)

    def take_area(self, mark: Solid) -> None:
        """Take an area; marks of a path come in order of time."""
        if mark.path not in self._areas:
            size = self._size(mark.label)
            places = np.pad(_places(mark, size), ((0, 0), (0, 1)), constant_values=mark.high)
            self._areas[mark.path] = _Area(mark.path, mark.label, np.array(mark.colour, np.uint8), places)
        area = self._areas[mark.path]
        area.times.append(mark.times)
        is_shown = np.ones(len(mark.times), bool) if mark.phases is None else mark.phases == ACTIVE
        area.positions.append(np.where(is_shown[:, None], mark.positions, np.nan))

    def show(self, output: ColumnReceiver) -> None:
        """Place the labels at the instants since the last call."""
        groups, areas = list(self._groups.values()), list(self._areas.values())
        taken = [
            *(times for each in groups for times in each.times),
            *(times for each in areas for times in each.times),
        ]
        if not taken:
            return
        if not areas and not any(group.mark.labels for group in groups):
            self._groups = {}
            return
        times = np.unique(np.concatenate(taken))
        positions = [_at(group, times) for group in groups]
        seen = [self._view.viewpoint.project(each) for each in positions]
        centres = np.concatenate([np.empty((len(times), 0, 2)), *seen], axis=1)
        starts = np.cumsum([0, *(len(group.mark.names) for group in groups)])
        extents = np.array([_extent(group.mark) for group in groups for _ in group.mark.names])
        rows = [list(group.mark.labels) for group in groups]
        labelled = [int(start) + row for start, some in zip(starts, rows, strict=False) for row in some]
        sizes = self._sizes([text for group in groups for text in group.mark.labels.values()])
        wide, moved = self._sizes([area.text for area in areas]), [_moved(area, times) for area in areas]
        candidates = [
            self._view.viewpoint.project(area.places[:, None] + at) for area, at in zip(areas, moved, strict=True)
        ]
        middles = np.empty((len(times), len(labelled), 2))
        choices = np.full((len(times), len(areas)), -1, np.intp)
        for window in np.split(np.arange(len(times)), np.flatnonzero(np.diff(times // _STEADY)) + 1):
            here = [each[:, window] for each in candidates]
            before = self._within if self._within is not None and len(self._within) == len(areas) else None
            within, self._within = labels_among(here, wide, centres[window], extents, before)
            choices[window] = self._within
            others = PlacedLabels(within, wide)
            before = self._beside if self._beside is not None and len(self._beside) == len(labelled) else None
            middles[window], self._beside = labels_beside(centres[window], extents, labelled, sizes, before, others)
        below = np.array(self._view.viewpoint.up) * 0.5 * self._view.scale * _AROUND[1]
        for number, area in enumerate(areas):
            chosen = choices[:, number]
            is_shown = (chosen >= 0) & np.isfinite(moved[number]).all(axis=1)
            where = np.where(is_shown[:, None], area.places[chosen] + below, np.nan)
            self._send(output, area, times, where[:, None], [area.text], area.colour[None])
        axes = np.array([self._view.viewpoint.right, self._view.viewpoint.up])
        offsets, first = (middles - centres[:, labelled]) @ axes + below, 0
        for group, everywhere, some in zip(groups, positions, rows, strict=True):
            where = everywhere[:, some] + offsets[:, first : first + len(some)]
            first += len(some)
            if some:
                words, colours = list(group.mark.labels.values()), group.mark.label_colours[some]
                self._send(output, group, times, where, words, colours)

    def _send(
        self,
        output: ColumnReceiver,
        what: _Group | _Area,
        times: NDArray[np.int64],
        places: Array,
        words: list[str],
        colours: NDArray[np.uint8],
    ) -> None:
        """Send labels at (k, m, 3) places [m]: Rerun writes each below its point."""
        import rerun as rr

        path = f"{what.path}/label"
        if not what.begun:
            what.begun = True
            legible = packed(faded(colours, _LEGIBLE[output.theme.name], output.theme.ink))
            look: dict[str, Any] = {"labels": words, "colors": legible, "radii": rr.Radius.ui_points([0.0])}
            output.static(path, rr.Points3D.from_fields(show_labels=True, **look))
        output.send(path, times, rr.Points3D.columns(positions=flat(places)), [places.shape[1]] * len(times))

    def _size(self, text: str) -> Array:
        """Return width and height of a label (2,) [m]."""
        size: Array = self._view.scale * (np.array([_LETTER * len(text), 0.0]) + _AROUND)
        return size

    def _sizes(self, words: list[str]) -> Array:
        return np.array([self._size(text) for text in words]).reshape(-1, 2)


def _places(mark: Solid, size: Array) -> Array:
    """Return the places of a label of an area (c, 2) [m]: the preferred one, within the area, and above it."""
    corners = np.concatenate(mark.outlines)
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low) - 0.6 * size, 0.0)
    steps = [(0, 1), (0, -1), (-1, 0), (1, 0), (-1, 1), (1, 1), (-1, -1), (1, -1)]
    above = np.array([middle[0], high[1] + 0.6 * size[1]])
    return np.array([mark.label_at, *(middle + half * step for step in steps), above])


def _moved(area: _Area, times: NDArray[np.int64]) -> Array:
    """Return the positions of an area at some instants (k, 3); NaN where it is not shown."""
    own = np.concatenate([np.empty(0, np.int64), *area.times])
    known = np.concatenate([area.last[None], *area.positions])
    area.times, area.positions, area.last = [], [], known[-1]
    return known[np.searchsorted(own, times, side="right")]


def _at(group: _Group, times: NDArray[np.int64]) -> Array:
    """Return the positions of bodies (k, n, 3) at some instants: the last ones known; NaN before the first."""
    count = len(group.mark.names)
    last = np.full((count, 3), np.nan) if group.last is None else group.last
    own = np.concatenate([np.empty(0, np.int64), *group.times])
    known = np.concatenate([last[None], *group.positions])
    group.times, group.positions, group.last = [], [], known[-1]
    return known[np.searchsorted(own, times, side="right")]


def _extent(mark: Bodies) -> float:
    return mark.extent * (_NOSED if mark.nosed else 1.0)
