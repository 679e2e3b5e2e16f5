"""Draws knowledge models: cells or states with their names and labels, and arrows for the transitions between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.patches import FancyArrowPatch, Rectangle
from numpy.typing import NDArray

from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.views import FigureSheet, Handles

Array = NDArray[np.float64]

#: The greatest side of a model in the figure [inch].
_SIDE = 7.0
#: The number of cells above which they are drawn without words.
_WORDS = 150


def draw_models(models: Mapping[str, KnowledgeModel], path: Path, dpi: int = 150) -> None:
    """Draw knowledge models side by side into a file; of products, which draw nothing new, the names of the parts.

    Args:
        models: The models by name, one or more.
        path: The file; its suffix determines the format.
        dpi: Dots per inch.

    Raises:
        OSError: The file cannot be written.
    """
    drawn = {name: model for name, model in models.items() if not model.parts()}
    extents = [_extent(model) for model in drawn.values()]
    said = [
        f"{name} = {' x '.join(model.parts().values())}: {_size(model, 'states')}"
        for name, model in models.items()
        if model.parts()
    ]
    width = sum(extent[0] for extent in extents) + 0.8 * len(extents)
    height = max(extent[1] for extent in extents) + 1.0 + 0.3 * len(said)

    def fill(figure: Figure, place: SubplotSpec) -> tuple[Sequence[Handles], Sequence[str]]:
        grid = place.subgridspec(1, len(drawn), width_ratios=[extent[0] for extent in extents])
        for number, (name, model) in enumerate(drawn.items()):
            axes = figure.add_subplot(grid[0, number], anchor="N")
            axes.set_title(f"{name}: {_size(model, 'cells' if len(model.bounds) else 'states')}", loc="left")
            if len(model.bounds):
                _draw(axes, model, _SIDE / float(np.ptp(model.bounds, axis=(0, 2)).max()))
            else:
                draw_states(axes, model.system)
        return (), said

    FigureSheet((width, height), "", len(drawn)).draw(path, None, dpi, fill)


def _size(model: KnowledgeModel, noun: str) -> str:
    return f"{len(model.system.states)} {noun}, {sum(map(len, model.system.successors))} transitions"


def _extent(model: KnowledgeModel) -> Array:
    """Return the width and height of a model in the figure [inch]; shape (2,)."""
    if not len(model.bounds):
        return np.full(2, _SIDE / 2)
    low, high = model.bounds[:, :, 0].min(axis=0), model.bounds[:, :, 1].max(axis=0)
    return np.asarray((high - low) * _SIDE / (high - low).max())


def _draw(axes: Axes, model: KnowledgeModel, scale: float) -> None:
    system = model.system
    for state, ((left, right), (bottom, top)) in enumerate(model.bounds):
        labels = sorted(system.labels_in(state) - {system.states[state]})
        special = bool([each for each in labels if len(system.labels[each]) < len(system.states)])
        face = "#dceafa" if special else "#f6f6f4"
        axes.add_patch(Rectangle((left, bottom), right - left, top - bottom, facecolor=face, edgecolor="#b5b5b0"))
        if len(system.states) <= _WORDS:
            said = [each for each in labels if len(system.labels[each]) < len(system.states)]
            # In the corners, where there are no arrows.
            longest = max(map(len, [system.states[state], *said]))
            size = max(4.0, min(9.0, 60.0 * scale * (right - left) / max(longest, 8)))
            edge = 0.05 / scale
            axes.text(left + edge, top - edge, system.states[state], ha="left", va="top", fontsize=size)
            low = bottom + edge
            axes.text(left + edge, low, "\n".join(said), ha="left", va="bottom", fontsize=size, color="#1f5fa8")
    both = {(one, other) for one, after in enumerate(system.successors) for other in after}
    for one, other in sorted(both):
        if one == other or ((other, one) in both and other < one):
            continue
        start, gate, end = model.centre(one), model.gate(one, other), model.centre(other)
        axes.add_patch(
            FancyArrowPatch(
                tuple(gate + 0.2 * (start - gate)),
                tuple(gate + 0.2 * (end - gate)),
                arrowstyle="<|-|>" if (other, one) in both else "-|>",
                mutation_scale=max(3.0, min(9.0, 9.0 * scale / 1.2)),
                color="#555550",
                linewidth=0.8,
                shrinkA=0,
                shrinkB=0,
            )
        )
    for state, after in enumerate(system.successors):
        if state not in after:  # a cell that must be left at once
            axes.plot(*model.centre(state), marker="x", color="#b23a2e", markersize=5)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.autoscale_view()
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def draw_states(axes: Axes, system: TransitionSystem) -> None:
    """Draw a transition system; thick outlines are initial states, and a cross marks one that cannot be stayed in.

    Args:
        axes: The axes to draw in, whose scales and ticks are removed.
        system: The transition system.
    """
    count = len(system.states)
    angles = np.pi - 2.0 * np.pi * np.arange(count) / count  # the first state at the left, then clockwise
    places = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    size = max(5.0, min(10.0, 60.0 / max(count, *map(len, system.states))))
    for state, after in enumerate(system.successors):
        for following in after:
            if following != state:
                axes.add_patch(
                    FancyArrowPatch(
                        tuple(places[state]),
                        tuple(places[following]),
                        connectionstyle="arc3,rad=-0.2",
                        arrowstyle="-|>",
                        mutation_scale=10.0,
                        color="#555550",
                        linewidth=0.8,
                        shrinkA=25,
                        shrinkB=25,
                    )
                )
    for state, name in enumerate(system.states):
        labels = sorted(system.labels_in(state) - {name})
        mark = "" if state in system.successors[state] else " \N{MULTIPLICATION SIGN}"
        said = "\n".join([name + mark, *labels])
        box = {
            "boxstyle": "round,pad=0.5",
            "facecolor": "#dceafa" if labels else "#f6f6f4",
            "edgecolor": "#555550" if state in system.initial else "#b5b5b0",
            "linewidth": 2.0 if state in system.initial else 0.8,
        }
        axes.text(places[state, 0], places[state, 1], said, ha="center", va="center", fontsize=size, bbox=box)
    axes.set_xlim(-1.5, 1.5)
    axes.set_ylim(-1.5, 1.5)
    axes.set_aspect("equal")
    axes.set_axis_off()
