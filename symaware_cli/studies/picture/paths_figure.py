"""Figure of the trajectories of many runs on the map; runs that violate a specification are red."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from symaware_cli.studies.picture.panel_grid import columns_of, natural_size
from symaware_cli.studies.picture.paths_picture import PathsPanel, PathsPicture
from symaware_cli.views import (
    AGENTS,
    INK,
    RISK,
    SMALL,
    Chosen,
    FigureSheet,
    Fill,
    Handles,
    LineStyle,
    Trajectories,
    draw_goals,
    draw_surroundings,
    extent,
    hexadecimal,
    type_scale,
)

Array = NDArray[np.float64]

#: The greatest side of a panel [inch], alone and among others, and the margins of the map in it.
_ALONE, _AMONG, _AROUND = 7.0, 4.3, (0.9, 0.85)

#: The width of a character and the height of a line of the text above a panel [inch].
_CHARACTER, _LINE = 0.085, 0.18

#: The maximum numbers of obstacles with written names and of marked start positions.
_NAMED, _STARTS = 24, 60

#: Paths with more points than this are rasterized in vector formats, too, whose files would be too large otherwise.
_PIXELS = 20_000


def draw(
    picture: PathsPicture, path: Path, title: str | None = None, size: tuple[float, float] | None = None, dpi: int = 150
) -> None:
    """Draw a picture into a file; the same picture and versions give the same bytes.

    Args:
        picture: The content.
        path: The file; its suffix determines the format.
        title: The text above the panels; None for the default: name, number of runs and seed.
        size: Width and height [inch]; None to fit the panels.
        dpi: Dots per inch.

    Raises:
        LogError: The title cannot be written with the font, or the panels do not fit.
        OSError: The file cannot be written.
    """
    sheet, fill = prepared(picture, title)
    sheet.draw(path, size, dpi, fill)


def prepared(picture: PathsPicture, title: str | None = None) -> tuple[FigureSheet, Fill]:
    """Arrange the panels, and return the sheet for them and the function that draws them."""
    low, high = _extent(picture)
    columns = columns_of(len(picture.panels))
    grid = (-(-len(picture.panels) // columns), columns)
    wide, tall = (high - low).tolist()
    scale = (_ALONE if len(picture.panels) == 1 else _AMONG) / max(wide, tall)
    width = max(2.6, wide * scale)
    # Text that is wider than its panel would make the layout shrink all panels.
    captions = [textwrap.wrap(each.caption, int(width / _CHARACTER), break_on_hyphens=False) for each in picture.panels]
    lines = max(map(len, captions))
    panel = (width + _AROUND[0], max(1.2, tall * scale) + _AROUND[1] + _LINE * max(0, lines - 1))
    usual = f"{picture.name}: trajectories of {picture.runs:,} runs, seed {picture.seed}"
    sheet = FigureSheet(natural_size(grid, panel), usual if title is None else title, len(picture.panels))
    return sheet, partial(_fill, picture, captions, grid, (low, high))


def _extent(picture: PathsPicture) -> tuple[Array, Array]:
    """Return the corners of the area that all panels show [m]."""
    corners = [
        extent(panel.surroundings, np.concatenate([path.reshape(-1, 2) for path in panel.paths]))
        for panel in picture.panels
    ]
    lows, highs = zip(*corners, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _fill(
    picture: PathsPicture,
    captions: Sequence[Sequence[str]],
    grid: tuple[int, int],
    area: tuple[Array, Array],
    figure: Figure,
    place: SubplotSpec,
) -> tuple[Sequence[Handles], Sequence[str]]:
    places = place.subgridspec(*grid)
    handles: dict[str, Line2D | Patch] = {}
    for number, (panel, caption) in enumerate(zip(picture.panels, captions, strict=True)):
        axes = figure.add_subplot(places[divmod(number, grid[1])])
        for handle in _draw_panel(axes, panel, *area):
            handles.setdefault(str(handle.get_label()), handle)
        violated = sum(panel.violated)
        said = [f"{violated:,} of {len(panel.paths):,} runs violate"] if picture.specifications else []
        axes.set_title("\n".join([*caption, *said]), loc="left")
    return [list(handles.values())], picture.notes


def _draw_panel(axes: Axes, panel: PathsPanel, low: Array, high: Array) -> list[Line2D | Patch]:
    content = _coloured_by_group(panel.surroundings)
    handles = draw_surroundings(axes, content, low, high)
    _name_obstacles(axes, content)
    colours = [line.colour for line in content.chosen.lines]
    sound = [path for path, violated in zip(panel.paths, panel.violated, strict=True) if not violated]
    violating = [path for path, violated in zip(panel.paths, panel.violated, strict=True) if violated]
    red = hexadecimal(RISK)
    _draw_paths(axes, sound, colours)
    _draw_paths(axes, violating, [red] * len(colours))
    _draw_starts(axes, panel.paths)
    members = content.chosen.members
    for group, lines in members.items():
        label = "trajectory" if len(members) == 1 else group
        handles.append(Line2D([], [], color=lines[0].colour, label=label))
    if violating:
        handles.append(Line2D([], [], color=red, label="of a run that violates"))
    if not panel.goals_differ:
        inked = {group: tuple(replace(line, colour=INK) for line in lines) for group, lines in members.items()}
        handles += draw_goals(axes, replace(content, chosen=Chosen(inked)), above=True)
    handles.append(Line2D([], [], label="start", **_mark(INK)))
    return handles


def _coloured_by_group(content: Trajectories) -> Trajectories:
    """Give all agents of a group its colour, because the agents of a thousand runs cannot be distinguished."""
    members = {
        group: tuple(LineStyle(line.name, hexadecimal(AGENTS[number % len(AGENTS)])) for line in lines)
        for number, (group, lines) in enumerate(content.chosen.members.items())
    }
    return replace(content, chosen=Chosen(members))


def _draw_paths(axes: Axes, paths: Sequence[Array], colours: Sequence[str]) -> None:
    """Draw paths, fainter for more runs, and a dot at the end of each."""
    lines: list[Array] = []
    shades: list[str] = []
    for path in paths:
        for agent, colour in enumerate(colours):
            known = path[~np.isnan(path[:, agent, 0]), agent]
            if len(known):
                lines.append(known)
                shades.append(colour)
    if not lines:
        return
    alpha = min(max(5.0 / len(paths) ** 0.85, 0.02), 0.7)
    is_large = sum(map(len, lines)) > _PIXELS
    width = 1.0 if len(paths) < 100 else 0.7
    axes.add_collection(
        LineCollection(lines, colors=shades, linewidths=width, alpha=alpha, zorder=3, rasterized=is_large),
        autolim=False,
    )
    ends = np.array([line[-1] for line in lines])
    axes.scatter(
        ends[:, 0], ends[:, 1], s=6, c=shades, alpha=min(0.9, 2.5 * alpha), linewidths=0, zorder=4, rasterized=is_large
    )


def _draw_starts(axes: Axes, paths: Iterable[Array]) -> None:
    """Mark the start positions of agents, as faint dots if there are many."""
    starts = [path[~np.isnan(path[:, agent, 0]), agent][:1] for path in paths for agent in range(path.shape[1])]
    places = np.unique(np.concatenate(starts).round(6), axis=0)
    if len(places) <= _STARTS:
        axes.plot(*places.T, zorder=4.5, **_mark(INK))
    else:
        axes.scatter(places[:, 0], places[:, 1], s=3, color=INK, alpha=0.3, linewidths=0, zorder=2.5, rasterized=True)


def _name_obstacles(axes: Axes, content: Trajectories) -> None:
    obstacles = content.obstacles
    if len(obstacles.names) > _NAMED:
        return
    for number, name in enumerate(obstacles.names):
        x, y = obstacles.positions[content.at, number, :2].tolist()
        size = 0.8 * SMALL * type_scale()
        axes.text(x, y, name, color=INK, fontsize=size, ha="center", va="center", clip_on=True, zorder=6)


def _mark(colour: str) -> dict[str, Any]:
    return {
        "marker": "o",
        "color": colour,
        "linestyle": "none",
        "markersize": 4.5,
        "markerfacecolor": "white",
        "markeredgewidth": 1.0,
    }
