"""Draws the panels over time: a curve for each agent, or bands of quantiles for many agents."""

from __future__ import annotations

from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from symaware_cli.views.palette import AGENTS, RISK, SCENERY, hexadecimal
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.offer_timeline import OfferHistory, OfferTimeline
from symaware_cli.views.plotting.panels import Distances

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


_OPEN, _UNKNOWN = "#c9ced6", "#7b8794"
#: The height of a bar where rows are 1 apart, and the distance of bids from it.
_BAR, _BID = 0.5, 0.14
#: Up to this number of rows their names have the usual size.
_ROWS = 8
_OUTCOMES: dict[str, dict[str, Any]] = {
    "satisfied": {"marker": "o", "color": "white", "markeredgecolor": INK, "markeredgewidth": 1.4},
    "violated": {"marker": "X", "color": hexadecimal(RISK), "markeredgecolor": "white", "markeredgewidth": 0.7},
    "rejected": {"marker": "s", "color": _UNKNOWN, "markeredgecolor": "white", "markeredgewidth": 0.7},
}


def draw_offers(axes: Axes, timeline: OfferTimeline) -> tuple[list[Line2D | Patch], list[str]]:
    """Draw a row for each specification that was offered.

    Returns:
        The entries of the legend, and the sentences of the caption.
    """
    colours = {line.name: line.colour for line in timeline.lines}
    for row, offer in enumerate(timeline.offers):
        _draw_row(axes, row, offer, colours)
    count = len(timeline.offers)
    size = mpl.rcParams["ytick.labelsize"]
    small = min(1.0, max(0.6, _ROWS / count)) * (size if isinstance(size, float | int) else mpl.rcParams["font.size"])
    axes.set_yticks(range(count), [offer.name for offer in timeline.offers], fontsize=small)
    axes.set_ylim(count - 0.4, -0.8)
    axes.grid(visible=False, axis="y")
    axes.set_title("offers: by whom they are held", loc="left")
    ends = {offer.outcome for offer in timeline.offers}
    handles: list[Line2D | Patch] = [Patch(color=_OPEN, label="open")]
    if any(offer.bids for offer in timeline.offers):
        handles.append(Line2D([], [], color=INK, linestyle="none", marker=".", markersize=5, label="bid"))
    handles += [
        Line2D([], [], linestyle="none", markersize=6, label=end, **style)
        for end, style in _OUTCOMES.items()
        if end in ends
    ]
    handles.append(Line2D([], [], color=INK, linewidth=0.8, marker="|", markersize=6, label="instants that count"))
    return handles, []


def _draw_row(axes: Axes, row: int, offer: OfferHistory, colours: dict[str, str]) -> None:
    start, end = (each / 1e9 for each in offer.counts)
    axes.plot([start, end], [row, row], color=INK, linewidth=0.8, marker="|", markersize=6, zorder=2)
    for phase in offer.phases:
        colour = colours.get(phase.agent, _UNKNOWN) if phase.agent else _OPEN
        axes.barh(row, (phase.end - phase.start) / 1e9, _BAR, phase.start / 1e9, color=colour, linewidth=0, zorder=3)
    agents = list(colours)
    for time, agent in offer.bids:
        # Agents that bid at one instant are side by side.
        shift = _BID * (agents.index(agent) / max(1, len(agents) - 1) - 0.5)
        style: dict[str, Any] = {"color": colours[agent], "marker": ".", "markersize": 5.0, "linestyle": "none"}
        axes.plot(time / 1e9, row - 0.5 * _BAR - 0.12 + shift, zorder=4, clip_on=False, **style)
    if offer.outcome:
        axes.plot(offer.time / 1e9, row, markersize=7, zorder=5, clip_on=False, **_OUTCOMES[offer.outcome])
