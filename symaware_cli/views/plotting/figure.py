"""Draws the figure of a plot: arrangement of panels, style, legends, and reproducible output files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symaware_cli.core import seconds
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.figure_sheet import FigureSheet, Fill, Handles
from symaware_cli.views.plotting.figure_style import FAINT
from symaware_cli.views.plotting.line_styles import LineStyle
from symaware_cli.views.plotting.mode_timeline import ModeTimeline
from symaware_cli.views.plotting.offer_timeline import OfferTimeline
from symaware_cli.views.plotting.panels import Content, Distances, Trajectories
from symaware_cli.views.plotting.paper_preset import PaperPreset
from symaware_cli.views.plotting.plane import draw_trajectories, extent
from symaware_cli.views.plotting.request import PlotRequest
from symaware_cli.views.plotting.time import DASHES, draw_curves, draw_modes, draw_offers, draw_separation
from symaware_cli.world import counted

#: Sizes in inches: maximum of the plane, and a panel over time.
_PLANE, _PANEL = (6.2, 7.0), (5.6, 2.1)

#: Sizes in inches: the space around a plane, for title and labels, and around all panels.
_AROUND, _MARGINS = 0.6, 1.2

#: Height of a panel in a column of a paper [inch].
_LOW = 1.25

#: Aspect ratio of the plane above which it is placed above the other panels.
_WIDE = 2.2


def draw(content: Content, request: PlotRequest, path: Path) -> None:
    """Draw a figure into a file.

    Args:
        content: The content of the figure.
        request: Title, size and resolution.
        path: The file; its suffix determines the format.

    Raises:
        LogError: The font does not have the characters of the title, or the panels do not fit.
        OSError: The file cannot be written.
    """
    sheet, fill = prepared(content, request.title, request.preset)
    sheet.draw(path, request.size, request.dpi, fill, request.preset)


def prepared(content: Content, title: str | None = None, preset: PaperPreset | None = None) -> tuple[FigureSheet, Fill]:
    """Arrange the panels, and return the sheet for them and the function that draws them."""
    plane = next((panel for panel in content.panels if isinstance(panel, Trajectories)), None)
    ratio, count = _ratio(plane) if plane else None, len(content.panels) - (plane is not None)
    layout = _Layout.of(ratio, count) if preset is None else _Layout.printed(ratio, count, preset)
    sheet = FigureSheet(layout.size, _title(content, title), len(content.panels))
    return sheet, partial(_fill, content, layout)


def _fill(
    content: Content, layout: _Layout, figure: Figure, place: SubplotSpec
) -> tuple[Sequence[Handles], Sequence[str]]:
    """Draw the panels; return the legends of marks and of agents, and the sentences of the caption."""
    plane = next((panel for panel in content.panels if isinstance(panel, Trajectories)), None)
    others = [panel for panel in content.panels if not isinstance(panel, Trajectories)]
    places = layout.places(place, len(others))
    handles: list[Line2D | Patch] = []
    said: list[str] = []
    if plane:
        marks, words = draw_trajectories(figure.add_subplot(places.pop(0)), plane, content.moment)
        handles, said = handles + marks, said + words
    first: Axes | None = None
    for panel, place in zip(others, places, strict=True):
        axes = figure.add_subplot(place, sharex=first)
        first = first or axes
        marks, words = _drawn(axes, panel)
        handles, said = handles + marks, said + words
        if content.moment:
            axes.axvline(seconds(content.window.at), color=FAINT, linewidth=1.0, linestyle=":")
        if content.since is not None:
            axes.axvline(seconds(content.since), color=FAINT, linewidth=1.0, linestyle="--")
        lowest = (layout.above and layout.width is None) or place.is_last_row() or panel is others[-1]
        axes.tick_params(labelbottom=lowest)
        axes.set_xlabel("simulated time [s]" if lowest else "")
    if first and content.window.start < content.window.end:
        first.set_xlim(seconds(content.window.start), seconds(content.window.end))
    return (handles, _owners(content)), said + content.notes


def _drawn(
    axes: Axes, panel: Distances | OfferTimeline | ModeTimeline | PlottedCurves
) -> tuple[list[Line2D | Patch], list[str]]:
    """Draw a panel over time; return the entries of the legend, and the sentences of the caption."""
    match panel:
        case Distances():
            return draw_separation(axes, panel)
        case OfferTimeline():
            return draw_offers(axes, panel)
        case ModeTimeline():
            return draw_modes(axes, panel)
    return draw_curves(axes, panel)


@dataclass(frozen=True)
class _Layout:
    """The arrangement of panels: the plane, if any, to the left of the panels over time or above them.

    Attributes:
        plane: Width and height of the plane [inch]; zeros without one.
        panels: Width and height of all panels over time [inch]; zeros without any.
        above: Whether the plane is above.
        columns: Number of columns of panels over time.
        rows: Number of rows of panels over time.
        width: The width of the figure, if it is given [inch].
    """

    plane: tuple[float, float]
    panels: tuple[float, float]
    above: bool
    columns: int
    rows: int
    width: float | None = None

    @classmethod
    def of(cls, ratio: float | None, count: int) -> _Layout:
        """Arrange a plane with an aspect ratio, if there is one, and a number of panels over time."""
        above = ratio is not None and ratio > _WIDE and count > 0
        columns = min(count, 3) if above else -(-count // 4)
        rows = -(-count // columns) if count else 0
        panels = (max(_PANEL[0] * columns, 2 * _PANEL[0] * above), max(_PANEL[1] * rows, 3.4)) if count else (0.0, 0.0)
        plane = (0.0, 0.0)
        if ratio is not None:
            width = panels[0] if above else max(min(_PLANE[0], _PLANE[1] * ratio), 3.0)
            plane = (width, min(width / ratio, _PLANE[1]) + _AROUND)
        return cls(plane, panels, above, columns, rows)

    @classmethod
    def printed(cls, ratio: float | None, count: int, preset: PaperPreset) -> _Layout:
        """Arrange the panels for a paper: one below the other in a column; otherwise as usual, but smaller."""
        usual, width = cls.of(ratio, count), preset.width
        if not preset.narrow:
            share = width / usual.size[0]
            (wide, high), (across, down) = usual.plane, usual.panels
            plane, panels = (share * wide, share * high), (share * across, share * down)
            return cls(plane, panels, usual.above, usual.columns, usual.rows, width)
        plane = (0.0, 0.0) if ratio is None else (width, min(0.88 * width / ratio, width) + 0.75 * _AROUND)
        return cls(
            plane, (width, _LOW * count) if count else (0.0, 0.0), ratio is not None, min(count, 1), count, width
        )

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the figure [inch]."""
        (width, height), (across, down) = self.plane, self.panels
        both = (max(width, across), height + down) if self.above else (width + across, max(height, down))
        if self.width is not None:
            return self.width, both[1] + 0.9 * _MARGINS
        return max(both[0], 1.3 * _PANEL[0]), both[1] + _MARGINS

    def places(self, whole: SubplotSpec, count: int) -> list[SubplotSpec]:
        """Divide a grid cell among the plane, if there is one, and a number of panels over time, in this order."""
        if not count:
            return [whole]
        plane: list[SubplotSpec] = []
        if self.above:
            outer = whole.subgridspec(2, 1, height_ratios=(self.plane[1], self.panels[1]))
            plane, whole = [outer[0]], outer[1]
        elif self.plane[0]:
            outer = whole.subgridspec(1, 2, width_ratios=(self.plane[0], self.panels[0]))
            plane, whole = [outer[0]], outer[1]
        if self.above:
            grid = whole.subgridspec(self.rows, self.columns)
            return plane + [grid[divmod(number, self.columns)] for number in range(count)]
        # Each column is divided independently, so that all of them end at the bottom.
        columns = whole.subgridspec(1, self.columns)
        found = list(plane)
        for number in range(self.columns):
            own = min(self.rows, count - number * self.rows)
            column = columns[number].subgridspec(own, 1)
            found += [column[row] for row in range(own)]
        return found


def _ratio(plane: Trajectories) -> float:
    """Return the aspect ratio of the plane."""
    low, high = extent(plane)
    wide, tall = high - low
    return float(wide / tall)


def _title(content: Content, title: str | None) -> str:
    if title is not None:
        return title
    count, total = len(content.chosen.lines), content.agent_count
    agents = counted(count, "agent") + (f" of {total:,}" if count < total else "")
    return f"{content.name}: {agents}, seed {content.seed}"


def _owners(content: Content) -> list[Line2D | Patch]:
    """Return the legend of line colours: agents if they can be told apart, otherwise groups."""
    lines: dict[LineStyle, None] = {}
    for panel in content.panels:
        if isinstance(panel, Distances | ModeTimeline) or (isinstance(panel, PlottedCurves) and panel.stacked):
            continue
        each = panel.chosen if isinstance(panel, Trajectories) else panel
        groups = content.chosen.groups if len(content.chosen.groups) > 1 else ()
        shown = groups if each.many else each.lines
        if isinstance(panel, PlottedCurves) and panel.named:
            shown = tuple(line for line in shown if line in content.chosen.lines)
        lines.update(dict.fromkeys(shown))
    return [
        Line2D([], [], color=line.colour, linestyle=DASHES if line.dashed else "solid", label=line.name)
        for line in lines
    ]
