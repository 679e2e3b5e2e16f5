"""Draws the panels over time: a curve for each agent, or bands of quantiles for many agents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from symaware_cli.views.palette import AGENTS, RISK, SCENERY, hexadecimal
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.mode_timeline import ModeTimeline
from symaware_cli.views.plotting.offer_timeline import OfferHistory, OfferTimeline
from symaware_cli.views.plotting.panels import Distances

Array = NDArray[np.float64]

INK = "#1f2933"
DASHES = (0, (4, 1.5))

_ALARM = hexadecimal(RISK)
_TYPICAL = hexadecimal(AGENTS[0])

#: The quantiles of the band and the line for many curves.
_BAND = (0.1, 0.5, 0.9)

#: Maximum number of curves with names at their ends; of more curves, only the least is drawn.
_NAMED = 8

#: Number of names at ends that fit at full size; and the size of small type at which they do [points].
_ENDS, _SMALL_TYPE = 7, 8.0

#: The background of text, so that curves do not cross it.
_BACK: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}

#: Height of a strip of modes where rows are 1 apart.
_STRIP = 0.5

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
    values, edges = _within_edges(curves)
    summed = curves.named and len(curves.lines) > _NAMED
    draw = _draw_dots if curves.dots else _draw_least if summed else _draw_bands if curves.many else _draw_lines
    said = draw(axes, curves, curves.times / 1e9, values)
    unit = f" [{curves.unit}]" if curves.unit not in ("", "1") else ""
    note = f", {curves.note}" if curves.note else ""
    name = (
        f"{curves.name.removeprefix('specification ')}: {curves.note}" if curves.named else f"{curves.name}{unit}{note}"
    )
    axes.set_title(name, loc="left")
    if curves.level is not None:
        axes.axhline(curves.level, color=_ALARM, linewidth=0.8, zorder=1)
    _draw_edges(axes, edges)
    if curves.named and not summed:
        _name_ends(axes, curves, values)
    if curves.name == "risk" and not curves.many and not curves.dots:
        _name_peaks(axes, curves, values)
    if curves.name in ("risk", "speed"):
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    greatest = curves.extreme() if curves.name == "risk" else None
    if greatest is not None and greatest[0] > 0:
        value, time, who = greatest
        height = edges.get(value, value)
        axes.plot(time, height, marker="o", markersize=4.5, color=_ALARM, zorder=5)
        _remark(axes, f"● {value:#.3g}, {who} at {time:.6g} s", _ALARM)
    return [], said


def _within_edges(curves: PlottedCurves) -> tuple[Array, dict[float, float]]:
    """Replace infinite values, which no axis reaches, by heights beyond all others if they count, otherwise by gaps.

    Returns:
        The values (k, n), NaN where nothing is drawn, and the heights at which infinite values are drawn.
    """
    values, finite = curves.values, np.isfinite(curves.values)
    shown = np.where(finite, values, np.nan)
    if not curves.infinities_count:
        return shown, {}
    drawn = [*values[finite].tolist(), 0.0 if curves.level is None else curves.level]
    room = 0.18 * (max(drawn) - min(drawn)) or 1.0
    beyond = {-np.inf: min(drawn) - room, np.inf: max(drawn) + room}
    edges = {value: height for value, height in beyond.items() if (values == value).any()}
    for value, height in edges.items():
        shown[values == value] = height
    return shown, edges


def _draw_edges(axes: Axes, edges: Mapping[float, float]) -> None:
    """Draw the lines that stand for infinity, with a word at the left."""
    for value, height in edges.items():
        axes.axhline(height, color=INK, linewidth=0.6, linestyle=":", zorder=1)
        style: dict[str, Any] = {"va": "center", "transform": axes.get_yaxis_transform(), "bbox": _BACK, "zorder": 6}
        axes.text(0.01, height, f"{value}", color=INK, fontsize=_small(), **style)
    if edges:
        low, high = edges.get(-np.inf, -np.inf), edges.get(np.inf, np.inf)
        axes.set_yticks([tick for tick in axes.get_yticks().tolist() if low < tick < high])


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


def _draw_least(axes: Axes, curves: PlottedCurves, times: Array, values: Array) -> list[str]:
    """Draw the least of many curves, with the name of the lowest, and the range of all."""
    known = ~np.isnan(values).all(axis=1)
    low, high = np.nanmin(values[known], axis=1), np.nanmax(values[known], axis=1)
    lowest = np.fmin.reduce(curves.values, axis=0)
    column, below = int(np.nanargmin(lowest)), int((lowest < 0.0).sum())
    alike = int((lowest == lowest[column]).sum()) - 1
    name = curves.lines[column].name + (f", and {alike} more" if alike else "")
    name += ", -inf" if lowest[column] == -np.inf else ""
    axes.fill_between(times[known], low, high, color=_TYPICAL, alpha=0.18, linewidth=0, step="post")
    axes.plot(times[known], low, color=_TYPICAL, drawstyle="steps-post", linewidth=1.6)
    bottom, top = min(0.0, axes.get_ylim()[0]), axes.get_ylim()[1]
    axes.set_ylim(bottom - 0.06 * (top - bottom), top)
    share = (low[-1] - axes.get_ylim()[0]) / np.ptp(axes.get_ylim())
    words = f"least of {len(curves.lines)}: {name}; {below or 'none'} below 0"
    # Below the least, or above the highest where there is no room.
    height = float(share - 0.03) if share > 0.3 else 0.96
    style: dict[str, Any] = {"ha": "right", "va": "top", "transform": axes.transAxes, "bbox": _BACK}
    axes.text(0.995, height, words, color=INK, fontsize=_small(), **style)
    return ["Where there are many curves: the least, and the range of all."]


def _name_ends(axes: Axes, curves: PlottedCurves, values: Array) -> None:
    """Write the names of curves at their right ends; those that end together share a line."""
    ends: dict[float, list[tuple[str, str]]] = {}
    low, high = axes.get_ylim()
    for number, line in enumerate(curves.lines):
        known = np.flatnonzero(~np.isnan(values[:, number]))
        if len(known):
            height = float(values[known[-1], number])
            near = next((each for each in ends if abs(each - height) < 0.01 * (high - low)), height)
            ends.setdefault(near, []).append((line.name, line.colour))
    size = _small() * min(1.0, _ENDS / max(_ENDS, len(ends)))
    # The approximate height of letters as a part of the panel, which is the least distance of two names.
    apart = 0.12 * (high - low) * size / _SMALL_TYPE
    heights = np.array(sorted(ends))
    places = heights + 0.1 * apart
    for number in range(1, len(places)):
        places[number] = max(places[number], places[number - 1] + apart)
    if len(places):
        axes.set_ylim(low, max(high, float(places[-1]) + apart))
        low, high = axes.get_ylim()
    for height, place in zip(heights.tolist(), places.tolist(), strict=True):
        names = [name for name, _ in ends[height]]
        colour = ends[height][0][1] if len(names) == 1 else INK
        share = (place - low) / (high - low)
        style: dict[str, Any] = {"ha": "right", "va": "bottom", "transform": axes.transAxes, "bbox": _BACK}
        axes.text(0.995, share, ", ".join(names), color=colour, fontsize=size, zorder=6, **style)


def _name_peaks(axes: Axes, curves: PlottedCurves, values: Array) -> None:
    """Write the names of the curves with the highest peaks at their peaks, where they do not cover each other."""
    times, taken = curves.times / 1e9, list[tuple[float, float]]()
    span, tall = max(float(np.ptp(times)), 1e-9), max(float(np.ptp(axes.get_ylim())), 1e-9)
    peaks = [
        (float(values[row, number]), float(times[row]), line)
        for number, line in enumerate(curves.lines)
        for row in [int(np.nanargmax(np.where(np.isnan(values[:, number]), -np.inf, values[:, number])))]
        if values[row, number] > 0.0
    ]
    for height, time, line in sorted(peaks, key=lambda peak: (-peak[0], peak[1]))[:_NAMED]:
        if all(abs(time - at) > 0.14 * span or abs(height - up) > 0.12 * tall for at, up in taken):
            taken.append((time, height))
            shift, side = (3, "left") if time < times[0] + 0.8 * span else (-3, "right")
            axes.annotate(
                line.name,
                (time, height),
                (shift, -1),
                textcoords="offset points",
                ha=side,
                va="top",
                color=line.colour,
                fontsize=_small(),
                bbox=_BACK,
            )


def _small() -> float:
    """Return the size of small type in the style in force [points]."""
    return 0.8 * float(mpl.rcParams["font.size"])


def draw_modes(axes: Axes, timeline: ModeTimeline) -> tuple[list[Line2D | Patch], list[str]]:
    """Draw a strip for each subject with modes, with the names of the modes where they fit.

    Returns:
        No entries of the legend, and the sentences of the caption.
    """
    count = len(timeline.strips)
    small = min(1.0, max(0.6, _ROWS / count)) * float(mpl.rcParams["font.size"])
    first, last = timeline.strips[0].phases[0].start, max(strip.phases[-1].end for strip in timeline.strips)
    span = max(last - first, 1) / 1e9
    for row, strip in enumerate(timeline.strips):
        for phase in strip.phases:
            start, length = phase.start / 1e9, (phase.end - phase.start) / 1e9
            violated, colour = "violated" in phase.mode, timeline.tints[phase.mode]
            look: dict[str, Any] = {"color": colour, "edgecolor": "white", "hatch": "///" if violated else None}
            axes.barh(row, length, _STRIP, start, linewidth=0, zorder=3, **look)
            if not length:  # decided at the very end
                axes.plot(start, row, marker="o", markersize=5, color=colour, zorder=4, clip_on=False)
            if length > 0.016 * span * len(phase.mode):
                ink = "white" if _is_dark(colour) else INK
                back = {"facecolor": colour, "edgecolor": "none", "pad": 1.6} if violated else None
                axes.text(
                    start + 0.008 * span,
                    row,
                    phase.mode,
                    va="center",
                    color=ink,
                    fontsize=0.8 * small,
                    zorder=5,
                    bbox=back,
                )
    for row, strip in enumerate(timeline.strips):
        # Above the strip rather than beside it, where a long name would make all panels narrow.
        axes.text(first / 1e9, row - 0.5 * _STRIP - 0.03, strip.name, va="bottom", fontsize=0.8 * small, color=INK)
    axes.set_yticks([])
    axes.set_ylim(max(count, 3) - 0.55, -0.75)
    axes.grid(visible=False, axis="y")
    axes.set_title(timeline.title, loc="left")
    ends = {phase.mode for strip in timeline.strips for phase in strip.phases if phase.start == phase.end}
    return [], [f"Dots at the end: {', '.join(sorted(ends))} with the last instant."] * bool(ends)


def _is_dark(colour: str) -> bool:
    """Return whether white letters are more legible on a colour than black ones."""
    red, green, blue = to_rgb(colour)
    return 0.299 * red + 0.587 * green + 0.114 * blue < 0.62


def _draw_dots(axes: Axes, curves: PlottedCurves, times: Array, values: Array) -> list[str]:
    for number, line in enumerate(curves.lines):
        axes.plot(times, values[:, number], color=line.colour, linestyle="none", marker=".", markersize=2.5)
    return []


def _draw_bands(axes: Axes, curves: PlottedCurves, times: Array, values: Array) -> list[str]:
    """Draw the median and the middle 80 % of the curves of each colour, one for each group."""
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
    """Draw stacked shares, which fill the panel from below."""
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
    # Half of the panel is for its title.
    narrow = min(1.0, axes.figure.bbox.width / axes.figure.dpi / 5.0)
    size = 0.9 * mpl.rcParams["font.size"] * min(1.0, _REMARK * narrow / len(text))
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
