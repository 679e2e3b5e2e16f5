"""Figure of a sweep: curves with bands, maps, scatters over drawn parameters, distributions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullFormatter

from symaware_cli.studies.picture.finished_runs import Array, ParameterAxis
from symaware_cli.studies.picture.metric_panel import MetricPanel, SweepPicture
from symaware_cli.studies.picture.panel_grid import columns_of, natural_size
from symaware_cli.views import INK, SMALL, FigureSheet, Handles, PaperPreset, colour_of, type_scale

#: Width and height of a panel [inch].
_PANEL = (4.3, 3.0)

#: Heights of a panel and around all panels in a figure for a paper [inch].
_LOW, _AROUND = 2.0, 0.5

#: Maps of at most this many cells show their values as text.
_WRITTEN = 150

#: The maximum length of the name of a parameter [characters].
_LABEL = 28

#: With more runs than this, the points of a scatter are rasterized in every format.
_VECTORS = 2_000

#: The minimum and maximum numbers of bars of a distribution.
_BARS = 8, 40

#: The offset between the estimates of two variants, where the values of a parameter are 1 apart.
_APART = 0.16


def draw(
    picture: SweepPicture,
    path: Path,
    title: str | None = None,
    size: tuple[float, float] | None = None,
    dpi: int = 150,
    preset: PaperPreset | None = None,
) -> None:
    """Draw a picture into a file; the same picture and versions give the same bytes.

    Args:
        picture: The content.
        path: The file; its suffix determines the format.
        title: The text above the panels; None for the default: name, number of runs and seed.
        size: Width and height [inch]; None to fit the panels.
        dpi: Dots per inch.
        preset: Width, type and colours for a paper; None for the usual ones.

    Raises:
        LogError: The title cannot be written with the font, or the panels do not fit.
        OSError: The file cannot be written.
    """
    count = picture.facets if picture.facets > 1 else len(picture.panels)
    columns = columns_of(count) if preset is None else 1 if preset.narrow else min(2, count)
    rows = -(-len(picture.panels) // columns)
    if picture.facets > 1:
        rows = len(picture.panels) // picture.facets * -(-picture.facets // columns)
    runs = picture.runs
    usual = f"{runs.name}: {len(runs.indices):,} runs, seed {runs.seed}"
    grid = (rows, columns)
    natural = natural_size(grid, _PANEL) if preset is None else (preset.width, _LOW * rows + _AROUND)
    sheet = FigureSheet(natural, usual if title is None else title, len(picture.panels))
    sheet.draw(path, size, dpi, partial(_fill, picture, grid), preset)


def _fill(
    picture: SweepPicture, grid: tuple[int, int], figure: Figure, place: SubplotSpec
) -> tuple[Sequence[Handles], Sequence[str]]:
    places = place.subgridspec(*grid)
    row, column, metric = 0, 0, picture.panels[0].metric.name
    for panel in picture.panels:
        if column == grid[1] or (picture.facets > 1 and panel.metric.name != metric):
            row, column = row + 1, 0
        metric = panel.metric.name
        axes = figure.add_subplot(places[row, column])
        column += 1
        _draw_panel(figure, axes, panel, _range(picture, metric))
    return (), picture.notes


def _draw_panel(figure: Figure, axes: Axes, panel: MetricPanel, limits: tuple[float, float]) -> None:
    axes.set_axisbelow(True)
    if panel.kind == "map":
        _draw_map(figure, axes, panel, limits)
    elif panel.kind == "curve":
        _draw_curves(axes, panel)
    elif panel.kind == "scatter":
        _draw_scatter(axes, panel)
    elif panel.metric.is_share:
        _draw_shares(axes, panel)
    else:
        _draw_distribution(axes, panel)
    if panel.infinite is not None and panel.kind != "map":
        _draw_infinite(axes, panel)
    axes.set_title(panel.metric.label, loc="left")
    if panel.caption:
        # Below the name of the metric, on a separate line.
        axes.set_title(f"{panel.metric.label}\n{panel.caption}", loc="left")
    is_named = panel.kind == "distribution" and panel.metric.is_share  # beside the axis
    if panel.kind != "map" and len(panel.series) > 1 and not is_named:
        handles = [Line2D([], [], **_line(number), label=name) for number, name in enumerate(panel.series)]
        axes.legend(handles=handles, frameon=False, loc="best", labelspacing=0.3)


def _draw_curves(axes: Axes, panel: MetricPanel) -> None:
    (axis,) = panel.axes
    positions = _across(axes, axis)
    if axis.positions is None:
        axes.set_xlim(-0.5, len(positions) - 0.5)
    for number in range(len(panel.series)):
        if len(panel.series) == 1:
            _draw_ranges(axes, axis, positions, (panel.low[number], panel.high[number]), colour_of(number), 0.10)
        _draw_estimates(axes, axis, positions, panel, number)
    if panel.metric.is_share:
        axes.set_ylim(-0.03, 1.03)


def _draw_estimates(axes: Axes, axis: ParameterAxis, positions: Array, panel: MetricPanel, number: int) -> None:
    """Draw the estimates of a variant with their intervals: a curve over numbers, points over other values."""
    style: dict[str, Any] = {**_line(number), "linewidth": 1.4}
    if axis.positions is None:
        # Side by side, because estimates of other variants may have the same values.
        positions = positions + _APART * (number - (len(panel.series) - 1) / 2)
        style = {"color": colour_of(number), "linestyle": "none"}
    interval = panel.lower[number], panel.upper[number]
    _draw_ranges(axes, axis, positions, interval, colour_of(number), 0.28)
    axes.plot(positions, panel.value[number], **style, marker="o", markersize=3.5)


def _draw_ranges(
    axes: Axes, axis: ParameterAxis, positions: Array, ranges: tuple[Array, Array], colour: str, alpha: float
) -> None:
    if axis.positions is None:
        axes.vlines(positions, *ranges, color=colour, alpha=alpha, linewidth=6)
    else:
        axes.fill_between(positions, *ranges, color=colour, alpha=alpha, linewidth=0)


def _draw_scatter(axes: Axes, panel: MetricPanel) -> None:
    """Draw the runs over the values they drew, and the estimates for parts of the range."""
    (axis,) = panel.axes
    is_choice = panel.scale == "options"
    positions = _across(axes, axis) if is_choice else np.array(axis.values, float)
    axes.set_xlabel(_named(axis))
    for number, (drawn, values) in enumerate(zip(panel.drawn, panel.samples, strict=True)):
        colour = colour_of(number)
        style: dict[str, Any] = (
            {"marker": "|", "s": 30} if panel.metric.is_share else {"marker": "o", "s": 9, "linewidths": 0}
        )
        faint = max(0.05, min(0.4, 60 / max(1, len(drawn)) ** 0.75))
        places = positions[drawn.astype(int)] if is_choice else drawn
        axes.scatter(places, values, color=colour, alpha=faint, rasterized=len(drawn) > _VECTORS, **style)
        _draw_estimates(axes, axis, positions, panel, number)
    if panel.scale == "logarithmic":
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    if panel.metric.is_share:
        axes.set_ylim(-0.06, 1.06)


def _draw_map(figure: Figure, axes: Axes, panel: MetricPanel, limits: tuple[float, float]) -> None:
    across, up = panel.axes
    values = panel.value[0].T
    mesh = axes.pcolormesh(
        np.arange(len(across.values) + 1) - 0.5,
        np.arange(len(up.values) + 1) - 0.5,
        values,
        cmap="viridis",
        vmin=limits[0],
        vmax=limits[1],
    )
    axes.grid(False)
    _marked(axes.xaxis, across)
    _marked(axes.yaxis, up)
    axes.set_xlabel(_named(across))
    axes.set_ylabel(_named(up))
    figure.colorbar(mesh, ax=axes, pad=0.02)
    if values.size > _WRITTEN:
        return
    for (row, column), value in np.ndenumerate(values):
        if math.isnan(value):
            if text := _infinities(panel, row, column).strip():
                axes.text(column, row, text, ha="center", va="center", fontsize=0.75 * SMALL * type_scale())
            continue
        red, green, blue, _ = mesh.cmap(mesh.norm(value))
        dark = 0.3 * red + 0.59 * green + 0.11 * blue < 0.5
        colour = "white" if dark else "black"
        size = 0.75 * SMALL * type_scale()
        text = f"{value:.3g}{_infinities(panel, row, column)}"
        axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=size)


def _infinities(panel: MetricPanel, row: int, column: int) -> str:
    """Return a line with the numbers of infinite values in a cell of a map; empty if there are none."""
    found = zip(panel.infinite or (), ("-inf", "inf"), strict=False)
    return "".join(f"\n{word}: {int(counts[0].T[row, column])}" for counts, word in found if counts[0].T[row, column])


def _draw_infinite(axes: Axes, panel: MetricPanel) -> None:
    """Mark infinite values, which no axis reaches: triangles beyond all others, each with its number of runs."""
    assert panel.infinite is not None
    sideways = panel.kind == "distribution"
    low, high = axes.get_xlim() if sideways else axes.get_ylim()
    small: dict[str, Any] = {"fontsize": SMALL * type_scale(), "ha": "center", "va": "center"}
    for counts, word, markers, edge in zip(panel.infinite, ("-inf", "inf"), ("<v", ">^"), (low, high), strict=True):
        if not counts.any():
            continue
        beyond = edge + (0.14 if word == "inf" else -0.14) * (high - low)
        (axes.axvline if sideways else axes.axhline)(beyond, color=INK, linewidth=0.6, linestyle=":", zorder=1)
        if sideways:
            axes.text(beyond, 0.97, word, transform=axes.get_xaxis_transform(), **{**small, "va": "top"})
        else:
            # Outside the axes, where no estimate is.
            axes.text(-0.012, beyond, word, transform=axes.get_yaxis_transform(), **{**small, "ha": "right"})
        for number, some in enumerate(counts):
            # Of a distribution, one number for each variant, one above the other.
            at = [0.06 + 0.1 * number] if sideways else _positions(panel, number)
            for place, runs in zip(at, np.atleast_1d(some).tolist(), strict=True):
                if not runs:
                    continue
                x, y = (beyond, place) if sideways else (place, beyond)
                axis = axes.get_xaxis_transform() if sideways else axes.transData
                look: dict[str, Any] = {"color": colour_of(number), "clip_on": False, "transform": axis, "zorder": 4}
                axes.plot([x], [y], marker=markers[0] if sideways else markers[1], markersize=5, **look)
                beside: dict[str, Any] = {**small, "ha": "left", "xycoords": axis, "textcoords": "offset points"}
                axes.annotate(f"{int(runs):,}", (x, y), (7, 0), **beside)
        (axes.set_xlim if sideways else axes.set_ylim)(
            *((beyond - 0.08 * (high - low), None) if word == "-inf" else (None, beyond + 0.08 * (high - low)))
        )
    ticks = axes.xaxis if sideways else axes.yaxis
    ticks.set_major_locator(FixedLocator([each for each in ticks.get_majorticklocs().tolist() if low <= each <= high]))


def _positions(panel: MetricPanel, number: int) -> list[float]:
    """Return where the estimates of a variant are on the horizontal axis."""
    (axis,) = panel.axes
    if panel.kind == "scatter" and panel.scale != "options":
        return [float(each) for each in axis.values]
    if axis.positions is not None:
        return [float(each) for each in axis.positions]
    return [place + _APART * (number - (len(panel.series) - 1) / 2) for place in range(len(axis.values))]


def _draw_shares(axes: Axes, panel: MetricPanel) -> None:
    """Draw the share of each variant with its interval."""
    places = np.arange(len(panel.series))[::-1]
    for number, place in enumerate(places.tolist()):
        colour = colour_of(number)
        axes.plot([panel.lower[number], panel.upper[number]], [place, place], color=colour, linewidth=6, alpha=0.3)
        axes.plot(panel.value[number], place, marker="o", color=colour)
    axes.set_xlim(-0.03, 1.03)
    axes.set_ylim(-0.6, len(places) - 0.4)
    axes.set_yticks(places if panel.series != ("",) else [], panel.series if panel.series != ("",) else [])
    axes.set_xlabel("share of runs")


def _draw_distribution(axes: Axes, panel: MetricPanel) -> None:
    """Draw a histogram of the runs' values, with the mean and its interval."""
    values = np.concatenate(panel.samples)
    edges = _edges(values if len(values) else np.zeros(1))
    for number, sample in enumerate(panel.samples):
        colour = colour_of(number)
        counts, _ = np.histogram(sample, edges)
        axes.stairs(counts, edges, color=colour, fill=len(panel.series) == 1, alpha=0.5, linewidth=1.4)
        if math.isfinite(panel.lower[number]) and math.isfinite(panel.upper[number]):
            axes.axvspan(panel.lower[number], panel.upper[number], color=colour, alpha=0.25, linewidth=0)
        axes.axvline(panel.value[number], **_line(number), linewidth=1.4)
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel("runs")


def _edges(values: Array) -> Array:
    """Return the edges of the bars of a distribution, centred on the values if these are few integers."""
    low, high = float(values.min()), float(values.max())
    if (values == np.round(values)).all() and high - low < _BARS[1]:
        return np.arange(low - 0.5, high + 1.0)
    count = len(np.histogram_bin_edges(values, "auto")) - 1
    edges: Array = np.linspace(low, high, min(max(count, _BARS[0]), _BARS[1]) + 1)
    return edges


def _across(axes: Axes, axis: ParameterAxis) -> Array:
    """Set up the horizontal axis, and return the positions of the values on it."""
    axes.set_xlabel(_named(axis))
    positions = axis.positions
    if positions is None:
        _marked(axes.xaxis, axis)
        return np.arange(float(len(axis.values)))
    if len(positions) <= 8:
        axes.set_xticks(positions, axis.labels)
    if positions[0] > 0 and len(positions) > 2 and positions[-1] / positions[0] >= 100:
        axes.set_xscale("log")
        axes.set_xticks(positions, axis.labels)
        axes.xaxis.set_minor_locator(FixedLocator([]))
    return positions


def _marked(ticks: Any, axis: ParameterAxis) -> None:
    """Label the ticks with the values, only some of them if there are many."""
    step = -(-len(axis.values) // 12)
    ticks.set_ticks(np.arange(0, len(axis.values), step), axis.labels[::step])


def _range(picture: SweepPicture, metric: str) -> tuple[float, float]:
    """Return the least and the greatest value of a metric, which all its maps share."""
    panels = [panel for panel in picture.panels if panel.metric.name == metric]
    if panels[0].metric.is_share:
        return 0.0, 1.0
    values = np.concatenate([panel.value.ravel() for panel in panels])
    values = values[~np.isnan(values)]
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)


def _line(number: int) -> dict[str, Any]:
    """Return the style of a variant's line, which remains distinguishable where lines coincide."""
    return {"color": colour_of(number), "linestyle": "dashed" if number % 2 else "solid"}


def _named(axis: ParameterAxis) -> str:
    """Return the end of a parameter's path, as much of it as fits beside a panel."""
    parts = axis.name.split(".")
    while len(parts) > 1 and len(".".join(parts)) > _LABEL:
        parts = parts[1:]
    name = ".".join(parts)
    return name if name == axis.name else f"… {name}"
