"""Labels of bodies and areas in Rerun, at places where they cover neither bodies nor each other in the fitted view."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.label_layout import PlacedLabels, labels_among, labels_beside
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
class _Motion:
    """Positions since labels were placed, and the last ones before; NaN if hidden or not known yet."""

    last: Array
    times: list[NDArray[np.int64]] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)

    def take(self, times: NDArray[np.int64], positions: Array) -> None:
        self.times.append(times)
        self.positions.append(positions)

    def at(self, times: NDArray[np.int64]) -> Array:
        """Return the last known positions at some instants, (k, ...), and forget those before the last instant."""
        own = np.concatenate([np.empty(0, np.int64), *self.times])
        known = np.concatenate([self.last[None], *self.positions])
        end = int(np.searchsorted(own, times[-1], side="right"))
        self.times, self.positions, self.last = [own[end:]], [known[end + 1 :]], known[end]
        return known[np.searchsorted(own, times, side="right")]


@dataclass
class _Group:
    """The bodies at one path: their last mark, and their motion."""

    mark: Bodies
    motion: _Motion
    begun: bool = False

    @property
    def path(self) -> str:
        return self.mark.path


@dataclass
class _Area:
    """An area: the places of its label relative to it, and its motion."""

    path: str
    text: str
    colour: NDArray[np.uint8]
    places: Array  # (c, 3) [m]
    motion: _Motion = field(default_factory=lambda: _Motion(np.full(3, np.nan)))
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
        if mark.path not in self._groups:
            self._groups[mark.path] = _Group(mark, _Motion(np.full((len(mark.names), 3), np.nan)))
        group = self._groups[mark.path]
        group.mark = mark
        group.motion.take(mark.times, positions)

    def take_area(self, mark: Solid) -> None:
        """Take an area; marks of a path come in order of time."""
        if mark.path not in self._areas:
            size = self._size(mark.label)
            places = np.pad(_places(mark, size), ((0, 0), (0, 1)), constant_values=mark.high)
            self._areas[mark.path] = _Area(mark.path, mark.label, np.array(mark.colour, np.uint8), places)
        is_shown = np.ones(len(mark.times), bool) if mark.phases is None else mark.phases == ACTIVE
        self._areas[mark.path].motion.take(mark.times, np.where(is_shown[:, None], mark.positions, np.nan))

    def show(self, output: ColumnReceiver, *, whole: bool = True) -> None:
        """Place the labels at the instants since the last call.

        Args:
            output: Where to.
            whole: False if more is to come: the instants after the last change of places wait for it, so that places
                do not depend on how a log is cut into chunks.
        """
        groups, areas = list(self._groups.values()), list(self._areas.values())
        motions = [*(each.motion for each in groups), *(each.motion for each in areas)]
        taken = [times for each in motions for times in each.times if len(times)]
        if not taken:
            return
        if not areas and not any(group.mark.labels for group in groups):
            self._groups = {}
            return
        times = np.unique(np.concatenate(taken))
        if not whole:
            times = times[times < times[-1] // _STEADY * _STEADY]
        if not len(times):
            return
        positions = [group.motion.at(times) for group in groups]
        seen = [self._view.viewpoint.project(each) for each in positions]
        centres = np.concatenate([np.empty((len(times), 0, 2)), *seen], axis=1)
        starts = np.cumsum([0, *(len(group.mark.names) for group in groups)])
        extents = np.array([_extent(group.mark) for group in groups for _ in group.mark.names])
        rows = [list(group.mark.labels) for group in groups]
        labelled = [int(start) + row for start, some in zip(starts, rows, strict=False) for row in some]
        sizes = self._sizes([text for group in groups for text in group.mark.labels.values()])
        wide, moved = self._sizes([area.text for area in areas]), [area.motion.at(times) for area in areas]
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


def _extent(mark: Bodies) -> float:
    return mark.extent * (_NOSED if mark.nosed else 1.0)
