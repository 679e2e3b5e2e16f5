"""Colours of agents, risks and events, shared by replays, plots and exports."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

#: Distinguishable with common colour vision deficiencies: P. Tol's "bright" scheme, a little darker where it is pale,
#: and four more colours. Red is reserved for risk.
AGENTS: tuple[Colour, ...] = (
    (68, 119, 170),
    (34, 136, 51),
    (204, 150, 40),
    (102, 204, 238),
    (170, 51, 119),
    (0, 153, 136),
    (136, 130, 205),
    (153, 153, 51),
    (221, 130, 100),
    (100, 110, 120),
)

BACKGROUND: Colour = (16, 18, 24)


@dataclass(frozen=True)
class ReplayTheme:
    """The colours of the surroundings of agents in a replay.

    Attributes:
        name: Its name.
        background: Behind everything.
        ground: The ground plane of spatial worlds.
        ink: Words, and lines on bodies such as headings.
        faint: Lines of grids, rings of perception, and words of less weight.
    """

    name: str
    background: Colour
    ground: Colour
    ink: Colour
    faint: Colour


DARK = ReplayTheme("dark", BACKGROUND, (30, 33, 41), (240, 240, 240), (110, 115, 130))
LIGHT = ReplayTheme("light", (250, 250, 252), (232, 235, 240), (31, 41, 51), (140, 146, 158))
THEMES = {theme.name: theme for theme in (DARK, LIGHT)}

RISK: Colour = (230, 40, 50)
SCENERY: Colour = (128, 128, 136)
GOAL: Colour = (120, 170, 90)
#: Bodies that are moved by others, such as crates that are pushed, as opposed to what stays.
MOVABLE: Colour = (196, 160, 112)
CONTACT: Colour = (255, 60, 60)
#: Verdicts of specifications: satisfied, undecided, and violated.
SATISFIED: Colour = (64, 150, 92)
UNDECIDED: Colour = (150, 156, 168)
VIOLATED: Colour = (214, 58, 62)
MESSAGE: Colour = (250, 220, 120)
LOSS: Colour = (255, 80, 70)
#: Of regions without a colour of their own; unlike those of agents they are dull, and none is red.
REGIONS: tuple[Colour, ...] = (
    (90, 120, 160),
    (90, 150, 90),
    (170, 130, 60),
    (140, 100, 150),
    (70, 150, 150),
    (165, 105, 90),
    (120, 125, 60),
    (110, 110, 130),
)

#: Maximum number of agents with individual colours; with more, agents share the colour of their group.
DISTINCT = 2 * len(AGENTS)


def agent_colours(sizes: Sequence[int]) -> list[NDArray[np.uint8]]:
    """Choose a colour for every agent: individual colours for few agents, the colour of the group for many.

    Args:
        sizes: Number of agents in each group.

    Returns:
        For each group an array (n, 3).
    """
    own = sum(sizes) <= DISTINCT
    colours, first = [], 0
    for number, size in enumerate(sizes):
        chosen = range(first, first + size) if own else [number] * size
        colours.append(np.array([AGENTS[index % len(AGENTS)] for index in chosen], np.uint8).reshape(-1, 3))
        first += size
    return colours


def body_colours(names: Sequence[str], first: Colour) -> dict[str, Colour]:
    """Choose a colour for each moving entity; names that differ only in a number have the same colour.

    Args:
        names: The names of the entities.
        first: The colour of the first kind; others have colours that are paler than those of agents.
    """
    kinds = list(dict.fromkeys(_kind(name) for name in names))
    tints = [first, *(_paler(AGENTS[number % len(AGENTS)]) for number in range(2, len(kinds) + 1))]
    return {name: tints[kinds.index(_kind(name))] for name in names}


def _paler(colour: Colour) -> Colour:
    red, green, blue = ((2 * part + 255) // 3 for part in colour)
    return red, green, blue


def _kind(name: str) -> str:
    return name.rstrip("0123456789").rstrip("_-.") or name


def tinted(colours: NDArray[np.uint8], risk: ArrayLike) -> NDArray[np.uint8]:
    """Mix colours with the colour of risk.

    Args:
        colours: Shape (..., 3).
        risk: Shape (...), from 0, which leaves the colour unchanged, to 1; values above 1 or infinite count as 1,
            unknown values (NaN) as 0.

    Returns:
        Shape (..., 3).
    """
    share = np.clip(np.nan_to_num(np.asarray(risk, float), nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)[..., None]
    mixed: NDArray[np.uint8] = np.round(colours + share * (np.array(RISK, float) - colours)).astype(np.uint8)
    return mixed


def faded(colours: NDArray[np.uint8], share: ArrayLike, background: Colour = BACKGROUND) -> NDArray[np.uint8]:
    """Mix colours with the background of replays, whose lines cannot be transparent.

    Args:
        colours: Shape (..., 3).
        share: Share of the background, from 0 to 1; shape (...).
        background: The colour of the background.

    Returns:
        Shape (..., 3).
    """
    mixed = colours + np.asarray(share, float)[..., None] * (np.array(background, float) - colours)
    return np.round(mixed).astype(np.uint8)


def hexadecimal(colour: ArrayLike) -> str:
    """Format a colour as ``#rrggbb``."""
    return "#" + "".join(f"{int(part):02x}" for part in np.asarray(colour)[:3])
