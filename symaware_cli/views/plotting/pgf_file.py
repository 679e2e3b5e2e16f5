"""Figures as PGF: LaTeX draws them within a document, and sets their words in its font.

matplotlib has a writer of PGF, which asks a TeX engine for the size of each text. Here texts have the sizes that they
have in the other formats, so that no engine is needed, and the bytes do not depend on the one that is installed. A name
is text: characters that have a meaning in LaTeX are escaped.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NoReturn, TextIO

import matplotlib as mpl
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_pgf import RendererPgf
from matplotlib.figure import Figure

from symaware_cli.log import LogError

_HEADER = """\
% A figure of SymAware. In the preamble of a LaTeX document: \\usepackage{pgf}; in its place: \\input{NAME.pgf}
\\begingroup%
\\makeatletter%
\\begin{pgfpicture}%
"""

_FOOTER = """\
\\end{pgfpicture}%
\\makeatother%
\\endgroup%
"""

#: What LaTeX would not print as it is, with any engine.
_ESCAPED = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        **{character: f"\\{character}" for character in "{}$&#_%"},
        "\N{MINUS SIGN}": r"\ensuremath{-}",
        "\N{MULTIPLICATION SIGN}": r"\ensuremath{\times}",
        "\N{PLUS-MINUS SIGN}": r"\ensuremath{\pm}",
        "\N{INFINITY}": r"\ensuremath{\infty}",
        "\N{LESS-THAN OR EQUAL TO}": r"\ensuremath{\le}",
        "\N{GREATER-THAN OR EQUAL TO}": r"\ensuremath{\ge}",
        "\N{BLACK CIRCLE}": r"\textbullet{}",
        "\N{HORIZONTAL ELLIPSIS}": r"\ldots{}",
        "\N{DEGREE SIGN}": r"\ensuremath{{}^\circ}",
        "\N{MIDDLE DOT}": r"\ensuremath{\cdot}",
        "\N{EN DASH}": "--",
    }
)


def save_pgf(figure: Figure, path: Path) -> None:
    """Write a figure that was settled as PGF.

    Raises:
        LogError: It contains a picture of pixels, which a file of its own would have to hold.
        OSError: The file cannot be written.
    """
    for artist in figure.findobj():
        artist.set_rasterized(False)
    width, height = figure.get_size_inches().tolist()
    # The font of the document, rather than one that it may not have.
    with path.open("w", encoding="utf-8", newline="\n") as file, mpl.rc_context({"pgf.rcfonts": False}):
        file.write(_HEADER)
        file.write(f"\\pgfpathrectangle{{\\pgfpointorigin}}{{\\pgfqpoint{{{width:f}in}}{{{height:f}in}}}}%\n")
        file.write("\\pgfusepath{use as bounding box, clip}%\n")
        figure.draw(_PgfRenderer(figure, file))
        file.write(_FOOTER)


class _PgfRenderer(RendererPgf):
    """Draws with the operations of PGF, with sizes of texts from the fonts of matplotlib."""

    def __init__(self, figure: Figure, file: TextIO) -> None:
        super().__init__(figure, file)  # type: ignore[no-untyped-call]  # matplotlib has types in part

    def get_text_width_height_descent(self, s: str, prop: Any, ismath: Any) -> tuple[float, float, float]:
        return RendererBase.get_text_width_height_descent(self, s, prop, ismath)

    def draw_text(
        self, gc: Any, x: float, y: float, s: str, prop: Any, angle: float, ismath: Any = False, mtext: Any = None
    ) -> None:
        escaped = s.translate(_ESCAPED)
        super().draw_text(gc, x, y, escaped, prop, angle, ismath, mtext)  # type: ignore[no-untyped-call]  # likewise

    def draw_image(self, *_: Any) -> NoReturn:
        raise LogError("this figure contains a picture of pixels, which .pgf cannot hold; write a .pdf")
