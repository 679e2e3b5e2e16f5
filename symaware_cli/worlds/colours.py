"""Colours in camera images for bodies without a colour of their own."""

from __future__ import annotations

from colorsys import hsv_to_rgb

#: Hues that differ by the golden section are spread evenly, however many there are.
_GOLDEN = 0.6180339887
_GREY = (0.6, 0.6, 0.63)


def body_colour(index: int, agents: int) -> tuple[float, float, float]:
    """Return red, green and blue, from 0 to 1: agents have distinct bright hues, and all else is grey.

    Args:
        index: The index of the agent, entity or ground that a body belongs to.
        agents: The number of agents; they have the first indices.
    """
    return _GREY if index >= agents else hsv_to_rgb(index * _GOLDEN % 1.0, 0.7, 0.8)
