"""Draws the world of a simulation from above, at its present instant, as a picture in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.geometry import Region
from symaware_cli.specification import Anchors, PlacedRegion, RegionError
from symaware_cli.views.outline import outlines, placed
from symaware_cli.views.palette import AGENTS, GOAL, SCENERY, hexadecimal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

#: The size of a picture, in pixels, and its resolution.
_SIZE, _DPI = 480, 100

#: Number of points along each side of the grid on which regions are evaluated.
_GRID = 160

#: Margin around the bodies, relative to their extent, and at least [m].
_MARGIN, _LEAST = 0.1, 1.0


class WorldFrames:
    """Draws frames of one simulation; the shown part of the plane only grows, so that frames do not jump."""

    def __init__(self, environment: Environment, groups: Sequence[AgentGroup], regions: Mapping[str, Region]) -> None:
        """Prepare.

        Args:
            environment: The world, initialised.
            groups: The agents.
            regions: The regions of the scenario, by name.
        """
        self._environment = environment
        self._groups = tuple(groups)
        anchors = Anchors(environment, groups)
        self._regions = {name: PlacedRegion(name, regions, anchors) for name in regions}
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    def draw(self) -> NDArray[np.uint8]:
        """Draw the present instant.

        Returns:
            Red, green and blue; shape (480, 480, 3).

        Raises:
            LogError: matplotlib is not installed.
        """
        from symaware_cli.views.plotting.plot import matplotlib_required

        with matplotlib_required():
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure

        figure = Figure(figsize=(_SIZE / _DPI, _SIZE / _DPI), dpi=_DPI)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        bodies = list(self._bodies())
        self._grow([corners for corners, _ in bodies])
        middle, half = (self._low + self._high) / 2, max(self._high - self._low) / 2
        low, high = middle - half, middle + half
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        self._draw_regions(axes, low, high)
        for corners, colour in bodies:
            axes.fill(corners[:, 0], corners[:, 1], facecolor=colour, edgecolor="none")
        for start, end in self._directions():
            axes.plot([start[0], end[0]], [start[1], end[1]], color="white", linewidth=1.5, solid_capstyle="round")
        canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib has types in part
        return np.array(canvas.buffer_rgba(), np.uint8)[..., :3].copy()  # type: ignore[no-untyped-call]  # likewise

    def _bodies(self) -> Iterator[tuple[Array, str]]:
        """Yield the outline of each body, (m, 2) [m], and its colour."""
        environment = self._environment
        for name, obstacle in environment.obstacles.items():
            pose = environment.pose(name)
            for outline in outlines(obstacle.shape.pieces):
                yield _placed(outline, np.array(pose.position), pose.heading), hexadecimal(SCENERY)
        for number, (group, states) in enumerate(self._states()):
            shape = group.entity.shape
            pieces = [([(0.0, 0.0)], 0.1)] if shape is None else shape.pieces
            for row, position in enumerate(group.model.positions(states)):
                heading = 0.0 if group.model.heading is None else float(states[row, group.model.heading])
                for outline in outlines(pieces):
                    yield _placed(outline, position, heading), hexadecimal(AGENTS[number % len(AGENTS)])

    def _states(self) -> Iterator[tuple[AgentGroup, Array]]:
        """Yield each group with the states of those of its agents that are in the world."""
        for group in self._groups:
            states = self._environment.state(group)
            yield group, states if group.present is None else states[group.present]

    def _directions(self) -> Iterator[tuple[Array, Array]]:
        """Yield a line from the centre of each body that has a heading, along it."""
        for group, states in self._states():
            if group.model.heading is not None:
                shape = group.entity.shape
                length = 0.1 if shape is None else max(np.abs(each).max() for each in outlines(shape.pieces))
                headings = states[:, group.model.heading]
                starts = group.model.positions(states)[:, :2]
                ends = starts + length * np.stack([np.cos(headings), np.sin(headings)], axis=1)
                yield from zip(starts, ends, strict=True)

    def _grow(self, outlines_: Sequence[Array]) -> None:
        """Let the shown part of the plane contain all bodies."""
        for corners in outlines_:
            low, high = corners.min(axis=0), corners.max(axis=0)
            if (low < self._low).any() or (high > self._high).any():
                margin = max(_LEAST, _MARGIN * float((high - low).max()))
                self._low, self._high = np.minimum(self._low, low - margin), np.maximum(self._high, high + margin)
        if not np.isfinite(self._low).all():
            self._low, self._high = np.full(2, -_LEAST), np.full(2, _LEAST)

    def _draw_regions(self, axes: Axes, low: Array, high: Array) -> None:
        """Draw the areas of the regions, which may be of any kind, as those where a point is inside."""
        x, y = (np.linspace(low[axis], high[axis], _GRID) for axis in range(2))
        points = np.stack([each.ravel() for each in np.meshgrid(x, y)], axis=1)
        for region in self._regions.values():
            try:
                inside = region.robustness(points).reshape(_GRID, _GRID) > 0.0
            except (RegionError, ValueError):
                continue  # around an agent that is absent, or in space
            if inside.any() and not inside.all():
                colour = hexadecimal(GOAL)
                axes.contourf(x, y, inside.astype(float), levels=[0.5, 1.5], colors=[colour], alpha=0.25)


def _placed(outline: Array, position: Array, heading: float) -> Array:
    """Place an outline at a pose, seen from above; (m, 2) [m]."""
    there = np.zeros(3)
    there[: len(position)] = position
    return placed(outline, there, heading)[:, :2]
