"""Draws a transition system whose states have no places: on a circle, with arrows for the transitions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch

from symaware_cli.abstraction.transition_system import TransitionSystem


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
        labels = sorted(system.observation(state) - {name})
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
