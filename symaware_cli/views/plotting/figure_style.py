"""The style of figures, and settings by which a figure has the same bytes whenever it is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.transforms import Bbox

from symaware_cli.log import LogError
from symaware_cli.views.palette import AGENTS, hexadecimal
from symaware_cli.views.plotting.paper_preset import GREY_SAFE, PaperPreset
from symaware_cli.views.plotting.pgf_file import save_pgf
from symaware_cli.views.plotting.time import INK

FAINT = "#65707d"

#: Sizes of type in a figure of natural size [points].
_TYPE, _TITLE, HEADING, SMALL = 10.0, 11.0, 13.0, 9.0

#: The least scale of type in smaller figures.
LEAST_TYPE = 0.7

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "text.color": INK,
    # Names are shown literally, even with a dollar sign.
    "text.parse_math": False,
    "axes.edgecolor": FAINT,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": INK,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "pdf.fonttype": 42,
    "svg.hashsalt": "symaware",
    # Text stays text, which can be searched, and edited in a drawing program.
    "svg.fonttype": "none",
}

#: Metadata of each format to omit: the date and the program.
_UNDATED = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@contextmanager
def styled(scale: float = 1.0, preset: PaperPreset | None = None) -> Iterator[None]:
    """Apply the project's style, or that of a preset, in place of the user's style within the block."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        mpl.rcParams.update({"font.size": _TYPE * scale, "axes.titlesize": _TITLE * scale})
        usual = cycler(color=[hexadecimal(colour) for colour in AGENTS])
        mpl.rcParams.update({"legend.fontsize": SMALL * scale, "axes.prop_cycle": usual})
        if preset is not None:
            size = preset.size
            mpl.rcParams.update({"font.family": preset.font, "font.size": size, "axes.titlesize": size})
            mpl.rcParams.update({"legend.fontsize": 0.9 * size, "axes.prop_cycle": cycler(color=GREY_SAFE)})
        yield


def save(figure: Figure, path: Path, dpi: int) -> None:
    """Write a figure with a fixed layout to a file, in the format of its suffix.

    Raises:
        LogError: The format cannot hold the figure.
        OSError: The file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix == ".pgf":
        save_pgf(figure, path)
        return
    figure.savefig(path, format=suffix[1:], dpi=dpi, metadata=_UNDATED[suffix])


def settle(figure: Figure) -> None:
    """Lay out a figure, and fix the layout.

    The results of the layout solver depend on addresses in memory, and so differ in the last digits.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        box = axes.get_position(original=True)
        axes.set_position(Bbox(np.round(box.get_points(), 4)))
    for text in figure.texts:
        x, y = text.get_position()
        text.set_position((round(x, 4), round(y, 4)))


def type_scale() -> float:
    """The scale of type, relative to a figure of natural size."""
    return float(mpl.rcParams["font.size"]) / _TYPE


def colour_of(number: int) -> str:
    """Return a colour of the style in force, by number; they repeat."""
    colours = mpl.rcParams["axes.prop_cycle"].by_key()["color"]
    return str(colours[number % len(colours)])


def require_writable(title: str) -> None:
    """Check that the font has the characters of a title.

    Raises:
        LogError: The title has characters that the font does not have.
    """
    known = get_font(findfont("DejaVu Sans:bold")).get_charmap()
    unknown = sorted({character for character in title if ord(character) not in known} - {"\n"})
    if unknown:
        raise LogError(f"the font cannot write {''.join(unknown)!r} in the title")
