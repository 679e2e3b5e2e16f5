"""The sheet that every figure is drawn on: a title, panels, and below them legends and a caption."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symaware_cli.log import LogError
from symaware_cli.views.plotting.figure_style import (
    FAINT,
    HEADING,
    LEAST_TYPE,
    SMALL,
    require_writable,
    save,
    settle,
    styled,
    type_scale,
)
from symaware_cli.views.plotting.paper_preset import PaperPreset

Handles: TypeAlias = Sequence[Line2D | Patch]

#: Draws panels into a place of a figure; returns the entries of each legend, of which there are at most two, and the
#: sentences of the caption.
Fill: TypeAlias = Callable[[Figure, SubplotSpec], tuple[Sequence[Handles], Sequence[str]]]

#: Lengths in inches: the height of a line of text, the width of a character, and the height around the panels.
_LINE, _CHARACTER, _AROUND = 0.19, 0.071, 0.6

#: The maximum numbers of legends, and of entries of a legend.
_LEGENDS, _ENTRIES = 2, 32


@dataclass(frozen=True, slots=True)
class FigureSheet:
    """A figure without its content.

    Attributes:
        size: Width and height at which type has its natural size [inch].
        title: The text above the panels; "" for none.
        count: The number of panels.
    """

    size: tuple[float, float]
    title: str
    count: int

    def draw(
        self,
        path: Path,
        size: tuple[float, float] | None,
        dpi: int,
        fill: Fill,
        preset: PaperPreset | None = None,
    ) -> None:
        """Draw a figure into a file; the same content and versions give the same bytes.

        Args:
            path: The file; its suffix determines the format.
            size: Width and height [inch]; None for the natural ones.
            dpi: Dots per inch.
            fill: Draws the panels.
            preset: Type and colours for a paper; None for the usual ones.

        Raises:
            LogError: The font does not have the characters of the title, or the panels do not fit.
            OSError: The file cannot be written.
        """
        with self.drawn(size, fill, preset) as figure:
            save(figure, path, dpi)

    @contextmanager
    def drawn(
        self, size: tuple[float, float] | None, fill: Fill, preset: PaperPreset | None = None
    ) -> Iterator[Figure]:
        """Draw a figure, and return it with its style in force; see `draw`."""
        require_writable(self.title)
        width, height = size or self.size
        scale = max(LEAST_TYPE, min(1.0, width / self.size[0], height / self.size[1]))
        with styled(scale, preset), warnings.catch_warnings():
            warnings.filterwarnings("error", "constrained_layout not applied", UserWarning)
            try:
                figure = self._figure((width, height), fill)
                settle(figure)
            except UserWarning:
                panels = f"{self.count} panel{'s do' if self.count > 1 else ' does'}"
                raise LogError(f"{panels} not fit into {width:g} x {height:g} inches") from None
            yield figure

    def _figure(self, size: tuple[float, float], fill: Fill) -> Figure:
        engine = ConstrainedLayoutEngine(rect=(0.008, 0.004, 0.984, 0.988), w_pad=0.06, h_pad=0.05, hspace=0.0)
        figure = Figure(figsize=size, layout=engine)
        # The panels, legends and the caption, whose heights are only known when everything is drawn.
        whole = figure.add_gridspec(_LEGENDS + 2, 1)
        legends, said = fill(figure, whole[0])
        feet = [0.0] * (_LEGENDS + 1)
        for number, handles in enumerate(legends):
            if 0 < len(handles) <= _ENTRIES:
                feet[number] = _draw_legend(figure, whole[number + 1], handles)
        if said:
            feet[-1] = _draw_caption(figure, whole[_LEGENDS + 1], said)
        whole.set_height_ratios((max(size[1] - _AROUND - sum(feet), 1.0), *(max(foot, 0.01) for foot in feet)))
        if self.title:
            place = {"x": 0.012, "ha": "left"}
            figure.suptitle(self.title, fontsize=HEADING * type_scale(), fontweight="bold", **place)
        return figure


def _draw_legend(figure: Figure, place: SubplotSpec, handles: Handles) -> float:
    """Draw a legend in as few lines as possible, and return its height [inch]."""
    lengths = [len(str(handle.get_label())) for handle in handles]
    width = (figure.get_figwidth() - 0.3) / type_scale()
    columns = next(count for count in range(len(handles), 0, -1) if count == 1 or _width(lengths, count) <= width)
    axes = _unframed(figure, place)
    rows = -(-len(handles) // columns)
    legend = axes.legend(
        handles=handles,
        loc="upper left",
        ncols=-(-len(handles) // rows),
        borderaxespad=0.0,
        borderpad=0.0,
        columnspacing=1.6,
        labelspacing=0.35,
        frameon=False,
    )
    legend.set_in_layout(False)
    return (_LINE * rows + 0.06) * type_scale()


def _width(lengths: Sequence[int], columns: int) -> float:
    """Return the width of a legend with labels of these lengths in a number of columns, filled one by one [inch]."""
    return sum(_CHARACTER * max(column, default=0) + 0.62 for column in np.array_split(lengths, columns))


def _draw_caption(figure: Figure, place: SubplotSpec, said: Sequence[str]) -> float:
    """Draw the caption, and return its height [inch]."""
    text = textwrap.wrap(
        " ".join(dict.fromkeys(said)), max(20, int((figure.get_figwidth() - 0.3) / _CHARACTER / type_scale()))
    )
    axes = _unframed(figure, place)
    words = axes.text(
        0.0, 1.0, "\n".join(text), va="top", fontsize=SMALL * type_scale(), color=FAINT, transform=axes.transAxes
    )
    words.set_in_layout(False)
    return _LINE * len(text) * type_scale()


def _unframed(figure: Figure, place: SubplotSpec) -> Axes:
    axes = figure.add_subplot(place)
    axes.axis("off")
    return axes
