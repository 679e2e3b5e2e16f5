"""Figure of two sweeps: the value of each run in one sweep against that of the same run in the other."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from numpy.typing import NDArray

from symaware_cli.log import whole_file
from symaware_cli.studies.picture.panel_grid import columns_of, natural_size
from symaware_cli.views import AGENTS, FAINT, FigureSheet, Handles, hexadecimal

#: Width and height of a panel [inch].
_PANEL = (4.3, 3.4)

#: The maximum number of panels.
_MOST = 9

#: The greatest area of a point, in square points.
_LARGEST = 160

#: With more runs than this, points are rasterized in every format.
_VECTORS = 2_000


@dataclass(frozen=True, slots=True)
class PairedValues:
    """A column of two tables, for the runs that have a value in both.

    Attributes:
        label: The name of the column.
        caption: The text about the mean difference.
        is_share: Whether values are 0 or 1.
        first: The values in the first table; shape (n,).
        second: The values of the same runs in the second; shape (n,).
    """

    label: str
    caption: str
    is_share: bool
    first: NDArray[np.float64]
    second: NDArray[np.float64]


def draw_pairs(
    columns: Sequence[PairedValues], names: tuple[str, str], path: str | os.PathLike[str], notes: Sequence[str] = ()
) -> None:
    """Draw the columns in which two sweeps differ, at most nine of them.

    Args:
        columns: The columns.
        names: The names of the sweeps.
        path: The file; its suffix determines the format.
        notes: The lines of text below the panels.

    Raises:
        OutputError: The file cannot be written.
    """
    shown = columns[:_MOST]
    said = list(notes)
    if len(columns) > len(shown):
        said.append(f"{len(columns) - len(shown)} further columns differ.")
    width = columns_of(len(shown))
    grid = -(-len(shown) // width), width
    sheet = FigureSheet(natural_size(grid, _PANEL), f"{names[0]} and {names[1]}", len(shown))
    with whole_file(Path(path)) as unfinished:
        sheet.draw(unfinished, None, 150, partial(_fill, shown, names, grid, said))


def _fill(
    columns: Sequence[PairedValues],
    names: tuple[str, str],
    grid: tuple[int, int],
    said: Sequence[str],
    figure: Figure,
    place: SubplotSpec,
) -> tuple[Sequence[Handles], Sequence[str]]:
    places = place.subgridspec(*grid)
    for number, column in enumerate(columns):
        axes = figure.add_subplot(places[divmod(number, grid[1])])
        axes.set_axisbelow(True)
        axes.set_title(f"{column.label}\n{column.caption}", loc="left")
        if column.is_share:
            _draw_counts(axes, column, names)
        else:
            _draw_points(axes, column, names)
    return (), said


def _draw_points(axes: Axes, column: PairedValues, names: tuple[str, str]) -> None:
    """Draw a point for each run, on the diagonal if both values are equal; equal points merge into a larger one."""
    both = np.concatenate([column.first, column.second])
    low, high = float(both.min()), float(both.max())
    margin = 0.04 * (high - low) or 0.5
    ends = [low - margin, high + margin]
    axes.plot(ends, ends, color=FAINT, linewidth=0.9)
    pairs, counts = np.unique(np.stack([column.first, column.second]), axis=1, return_counts=True)
    faint = max(0.08, min(0.7, 60 / pairs.shape[1] ** 0.75))
    sizes = np.minimum(12 * counts, _LARGEST)
    colour = hexadecimal(AGENTS[0])
    axes.scatter(
        pairs[0], pairs[1], s=sizes, linewidths=0, alpha=faint, color=colour, rasterized=pairs.shape[1] > _VECTORS
    )
    axes.set_xlim(*ends)
    axes.set_ylim(*ends)
    axes.set_xlabel(names[0])
    axes.set_ylabel(names[1])


def _draw_counts(axes: Axes, column: PairedValues, names: tuple[str, str]) -> None:
    """Draw the numbers of runs for which the column is true in both sweeps, in one of them, and in none."""
    first, second = column.first > 0.5, column.second > 0.5
    counts = {
        "both": first & second,
        f"{names[0]} only": first & ~second,
        f"{names[1]} only": second & ~first,
        "neither": ~first & ~second,
    }
    places = np.arange(len(counts))[::-1]
    bars = axes.barh(places, [int(each.sum()) for each in counts.values()], color=hexadecimal(AGENTS[0]), height=0.6)
    axes.bar_label(bars, padding=3)
    axes.set_yticks(places, list(counts))
    axes.grid(False, axis="y")
    axes.margins(x=0.12)
    axes.set_xlabel("runs")
