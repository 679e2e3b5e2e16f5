"""A figure of panels side by side, with a title above and notes below."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symaware_cli.log import LogError
from symaware_cli.views import FAINT, HEADING, LEAST_TYPE, SMALL, require_writable, save, settle, styled, type_scale

#: Lengths in inches: the height of a line of text, the width of a character and of a legend entry, the height of the
#: title with the outer margins, and the least natural width of a figure.
_LINE, _CHARACTER, _ENTRY, _AROUND, _LEAST = 0.19, 0.071, 1.7, 0.55, 6.02

Handles: TypeAlias = Sequence[Line2D | Patch]

#: The maximum number of panels side by side.
_COLUMNS = 3


def columns_of(count: int) -> int:
    """Return the number of columns for a number of panels; four panels are arranged two by two."""
    return 2 if count == 4 else min(_COLUMNS, count)


@dataclass(frozen=True, slots=True)
class FigureSheet:
    """The layout of a figure.

    Attributes:
        grid: Rows and columns of panels.
        panel: Width and height of a panel [inch].
        title: The text above the panels.
        notes: The lines of text below the panels.
        count: The number of panels.
    """

    grid: tuple[int, int]
    panel: tuple[float, float]
    title: str
    notes: Sequence[str]
    count: int

    def draw(
        self, path: Path, size: tuple[float, float] | None, dpi: int, fill: Callable[[Figure, GridSpec], Handles]
    ) -> None:
        """Draw a figure into a file.

        Args:
            path: The file; its suffix determines the format.
            size: Width and height [inch]; None to fit the panels.
            dpi: Dots per inch.
            fill: Draws the panels and returns the entries of their shared legend.

        Raises:
            LogError: The title cannot be written with the font, or the panels do not fit.
            OSError: The file cannot be written.
        """
        require_writable(self.title)
        rows, columns = self.grid
        natural = (max(self.panel[0] * columns, _LEAST), self.panel[1] * rows + 2 * _AROUND)
        width, height = size or natural
        scale = max(LEAST_TYPE, min(1.0, width / natural[0], height / natural[1]))
        with styled(scale), warnings.catch_warnings():
            warnings.filterwarnings("error", "constrained_layout not applied", UserWarning)
            try:
                figure = self._figure((width, height), fill)
                settle(figure)
            except UserWarning:
                raise LogError(f"{self.count} panels do not fit into {width:g} x {height:g} inches") from None
            save(figure, path, dpi)

    def _figure(self, size: tuple[float, float], fill: Callable[[Figure, GridSpec], Handles]) -> Figure:
        scale = type_scale()
        said = textwrap.wrap(" ".join(self.notes), max(20, int((size[0] - 0.3) / _CHARACTER / scale)))
        foot = (_LINE * len(said) * scale + 0.08) / size[1]
        engine = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.06)
        figure = Figure(figsize=size, layout=engine)
        handles = fill(figure, figure.add_gridspec(*self.grid))
        if handles:
            count = max(2, int(size[0] / _ENTRY / scale))
            place: Any = {"loc": "lower left", "bbox_to_anchor": (0.004, foot), "borderaxespad": 0.0}
            figure.legend(handles=handles, ncols=count, frameon=False, **place)
            foot += (1.25 * _LINE * -(-len(handles) // count) + 0.12) * scale / size[1]
        engine.set(rect=(0.008, foot, 0.984, 0.99 - foot))
        figure.suptitle(self.title, x=0.012, ha="left", fontsize=HEADING * scale, fontweight="bold")
        if said:
            figure.text(0.012, 0.06 / size[1], "\n".join(said), va="bottom", fontsize=SMALL * scale, color=FAINT)
        return figure
