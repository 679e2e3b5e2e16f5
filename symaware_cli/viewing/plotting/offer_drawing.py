"""Draws what was offered during a run: a row for each specification."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symaware_cli.viewing.palette import RISK, hexadecimal
from symaware_cli.viewing.plotting.offer_timeline import OfferHistory, OfferTimeline
from symaware_cli.viewing.plotting.time import INK

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
