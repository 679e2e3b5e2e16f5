"""The style of figures, and how they come to be the same bytes whenever they are drawn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.transforms import Bbox

from symaware_cli.log import LogError
from symaware_cli.views.plotting.time import INK

FAINT = "#65707d"

#: Sizes of type in points, of a figure of its natural size.
_TYPE, _TITLE, HEADING, SMALL = 10.0, 11.0, 13.0, 9.0

#: In a smaller figure type shrinks with it, down to this part.
LEAST_TYPE = 0.7

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "text.color": INK,
    # Names are shown as they are, be there a dollar sign in them.
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
}

#: What a file of each format would say of when and by what it was made.
_UNDATED = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@contextmanager
def styled(scale: float = 1.0) -> Iterator[None]:
    """Take our own style, whatever the user's is, for as long as it is needed."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        mpl.rcParams.update({"font.size": _TYPE * scale, "axes.titlesize": _TITLE * scale})
        mpl.rcParams.update({"legend.fontsize": SMALL * scale})
        yield


def save(figure: Figure, path: Path, dpi: int) -> None:
    """Write a figure that was settled to a file whose suffix says the format.

    Raises:
        OSError: The file cannot be written.
    """
    suffix = path.suffix.lower()
    figure.savefig(path, format=suffix[1:], dpi=dpi, metadata=_UNDATED[suffix])


def settle(figure: Figure) -> None:
    """Lay out a figure once and for all.

    The solver behind the layout goes by addresses in memory, so its results differ in the last digits.
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
    """How large type is, relative to that of a figure of its natural size."""
    return float(mpl.rcParams["font.size"]) / _TYPE


def require_writable(title: str) -> None:
    """Insist on a title that the font can write.

    Raises:
        LogError: It has other characters.
    """
    known = get_font(findfont("DejaVu Sans:bold")).get_charmap()
    unknown = sorted({character for character in title if ord(character) not in known} - {"\n"})
    if unknown:
        raise LogError(f"the font cannot write {''.join(unknown)!r} in the title")
