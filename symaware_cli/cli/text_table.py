"""Tables of text in the terminal."""

from __future__ import annotations

from collections.abc import Sequence


def aligned(lines: Sequence[Sequence[str]], align: str, indent: str = "  ") -> list[str]:
    """Return lines of cells as text, each column as wide as its widest cell.

    Args:
        lines: The cells, those of the heading first; every line has as many.
        align: For each column, ``<`` or ``>``: where its cells stand; the last holds for further columns.
        indent: Put before each line.
    """
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    places = align.ljust(len(widths), align[-1])
    return [
        (
            indent
            + "  ".join(f"{cell:{place}{width}}" for cell, place, width in zip(line, places, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
