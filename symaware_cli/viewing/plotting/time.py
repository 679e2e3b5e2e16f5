"""Draws the panels over time: a curve for each agent, or bands of quantiles for many agents."""

from __future__ import annotations

from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from symaware_cli.viewing.palette import AGENTS, RISK, SCENERY, hexadecimal
from symaware_cli.viewing.plotting.curves import PlottedCurves
from symaware_cli.viewing.plotting.panels import Distances

Array = NDArray[np.float64]

INK = "#1f2933"
DASHES = (0, (4, 1.5))

_ALARM = hexadecimal(RISK)
_TYPICAL = hexadecimal(AGENTS[0])

#: The quantiles of the band and the line for many curves.
_BAND = (0.1, 0.5, 0.9)

#: Number of characters of the remark above a panel that fit at full size.
_REMARK = 46


def draw_curves(axes: Axes, curves: PlottedCurves) -> tuple[list[Line2D | Patch], list[str]]:
    """Draw a quantity over time.

    Returns:
        The entries of the legend, and the sentences of the caption.
    """
    if curves.stacked:
        _draw_shares(axes, curves)
        return [], []
    values = np.where(np.isfinite(curves.values), curves.values, np.nan)
    draw = _draw_dots if curves.dots else _draw_bands if curves.many else _draw_lines
    said = draw(axes, curves, curves.times / 1e9, values)
    unit = f" [{curves.unit}]" if curves.unit not in ("", "1") else ""
    note = f", {curves.note}" if curves.note else ""
    axes.set_title(f"{curves.name}{unit}{note}", loc="left")
    if curves.level is not None:
        axes.axhline(curves.level, color=_ALARM, linewidth=0.8, zorder=1)
    if curves.name in ("risk", "speed"):
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    greatest = curves.extreme() if curves.name == "risk" else None
    if greatest is not None and greatest[0] > 0:
        value, time, who = greatest
        axes.plot(time, value, marker="o", markersize=4.5, color=_ALARM, zorder=5)
        _remark(axes, f"● {value:#.3g}, {who} at {time:.6g} s", _ALARM)
    return [], said


def _draw_lines(axes: Axes, curves: PlottedCurves, times: Array, values: Array) -> list[str]:
    for number, line in enumerate(curves.lines):
        known = ~np.isnan(values[:, number])
        axes.plot(
            times[known],
            values[known, number],
            color=line.colour,
            linestyle=DASHES if line.dashed else "solid",
            drawstyle="steps-post" if curves.stepwise else "default",
            linewidth=1.0 if len(curves.lines) > 5 else 1.4,
            marker="." if known.sum() == 1 else None,
        )
    return []


def _draw_dots(axes: Axes, curves: PlottedCurves, times: Array, values: Array) -> list[str]:
    for number, line in enumerate(curves.lines):
        axes.plot(times, values[:, number], color=line.colour, linestyle="none", marker=".", markersize=2.5)
    return []


def _draw_bands(axes: Axes, curves: PlottedCurves, times: Array, values: Array) -> list[str]:
    """Draw the median and the middle 80 % of the curves of each colour, which is that of a group."""
    colours = np.array([line.colour for line in curves.lines])
    kinds = list(dict.fromkeys(colours.tolist()))
    step: Literal["post"] | None = "post" if curves.stepwise else None
    for colour in kinds:
        some = values[:, colours == colour]
        known = ~np.isnan(some).all(axis=1)
        low, middle, high = np.nanquantile(some[known], _BAND, axis=1)
        bands = [(low, high, 0.3)]
        if len(kinds) == 1:
            bands.append((np.nanmin(some[known], axis=1), np.nanmax(some[known], axis=1), 0.15))
        for bottom, top, alpha in bands:
            axes.fill_between(times[known], bottom, top, color=colour, alpha=alpha, linewidth=0, step=step)
        style = "steps-post" if curves.stepwise else "default"
        axes.plot(times[known], middle, color=colour, drawstyle=style, linewidth=1.6)
    if len(kinds) == 1:
        return [f"Line: median of {len(curves.lines):,} agents; bands: the middle 80 % of them, and all."]
    return [f"Lines: medians of the groups, {len(curves.lines):,} agents; bands: the middle 80 % of each."]


def _draw_shares(axes: Axes, shares: PlottedCurves) -> None:
    """Fill the panel from below, with the shares stacked."""
    values = shares.values.copy()
    values[np.isnan(values).any(axis=1)] = 0.0
    tops = np.cumsum(values, axis=1)
    for line, top, own in zip(shares.lines, tops.T, values.T, strict=True):
        style: dict[str, Any] = {"color": line.colour, "alpha": 0.75, "linewidth": 0, "step": "post"}
        axes.fill_between(shares.times / 1e9, top - own, top, label=line.name, **style)
    axes.set_ylim(0.0, max(1.0, float(tops[:, -1].max())))
    axes.set_title(shares.name, loc="left")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, reverse=True, handlelength=1.0)


def draw_separation(axes: Axes, distances: Distances) -> tuple[list[Line2D | Patch], list[str]]:
    """Draw the separation of bodies, down to negative values where they overlap.

    Returns:
        The entries of the legend, and the sentences of the caption.
    """
    agents, obstacles = distances.agents, distances.obstacles
    handles: list[Line2D | Patch] = []
    if agents is not None:
        times = agents.times / 1e9
        handles += axes.plot(times, agents.least, color=INK, linewidth=1.5, label="closest two agents", zorder=3)
        if len(distances.names[0]) > 2:
            label = "nearest to each agent (median)"
            axes.fill_between(times, agents.least, agents.typical, color=_TYPICAL, alpha=0.18, linewidth=0)
            handles += axes.plot(times, agents.typical, color=_TYPICAL, linewidth=0.9, label=label)
    if obstacles is not None:
        style: dict[str, Any] = {"color": hexadecimal(SCENERY), "linewidth": 1.3, "linestyle": DASHES}
        handles += axes.plot(obstacles.times / 1e9, obstacles.least, label="closest agent and obstacle", **style)
    low, high = axes.get_ylim()
    low = min(low, -0.06 * (high - low))
    axes.axhspan(low, 0.0, color=_ALARM, alpha=0.10, linewidth=0)
    axes.axhline(0.0, color=_ALARM, linewidth=0.8)
    axes.set_ylim(low, high)
    for each in (agents, obstacles):
        if each is not None:
            below = np.where(each.least < 0.0, each.least, np.nan)
            axes.plot(each.times / 1e9, below, color=_ALARM, linewidth=2.2, zorder=4)
    closest = distances.closest
    time, least = closest.times[closest.lowest] / 1e9, float(closest.least[closest.lowest])
    colour = _ALARM if least < 0 else INK
    axes.plot(time, least, marker="o", markersize=4.5, color=colour, zorder=5)
    _remark(axes, f"● {least:#.3g} m, {' and '.join(distances.who(closest))} at {time:.6g} s", colour)
    axes.set_title("least separation [m]", loc="left")
    return handles, ["Separation is from outline to outline: bodies touch at 0 and overlap below."]


def _remark(axes: Axes, text: str, colour: str) -> None:
    """Write a remark about the marked point above a panel, on the right."""
    size = 0.9 * mpl.rcParams["font.size"] * min(1.0, _REMARK / len(text))
    axes.set_title(text, loc="right", fontsize=size, color=colour)
