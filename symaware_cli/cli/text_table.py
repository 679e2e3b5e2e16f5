"""Tables of text in the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest

from symaware_cli.cli.folding import parts_of, wrapped
from symaware_cli.cli.streams import width_of

#: What is between two columns.
_BETWEEN = "  "


def aligned(lines: Sequence[Sequence[str]], align: str, indent: str = "  ") -> list[str]:
    """Return lines of cells as text, each column as wide as its widest cell.

    If the terminal is narrower, texts are folded within their columns; if that is not enough, the columns are shown in
    several blocks, one below the other, each with the first column.

    Args:
        lines: The cells, those of the heading first; every line has as many.
        align: For each column, ``<`` or ``>``: where its cells stand; the last holds for further columns.
        indent: Put before each line.
    """
    columns = list(zip(*lines, strict=True))
    places = align.ljust(len(columns), align[-1])
    least = list(map(_least, columns))
    width = width_of()
    found: list[str] = []
    for block in _blocks(least, None if width is None else width - len(indent)):
        found += [""] * bool(found)
        found += _block([columns[number] for number in block], [places[number] for number in block], indent, width)
    return found


def _least(column: Sequence[str]) -> int:
    """The least width of a column: that of the longest part of a cell that is not folded."""
    return max((len(part) for cell in column for part in parts_of(cell)), default=0)


def _blocks(least: Sequence[int], width: int | None) -> Iterator[list[int]]:
    """Yield the numbers of the columns of each block; the first column is in every block."""
    block: list[int] = []
    for number in range(len(least)):
        used = sum(least[each] for each in block) + len(_BETWEEN) * len(block)
        if width is not None and len(block) > 1 and used + least[number] > width:
            yield block
            block = [0]
        block.append(number)
    yield block


def _block(columns: Sequence[Sequence[str]], places: Sequence[str], indent: str, width: int | None) -> Iterator[str]:
    """Yield the lines of columns that stand beside each other."""
    widths = [max(map(len, column), default=0) for column in columns]
    if width is not None:
        excess = len(indent) + sum(widths) + len(_BETWEEN) * (len(widths) - 1) - width
        # The widest text is folded first.
        while excess > 0:
            spare = [
                (widths[number] - _least(column), widths[number], number)
                for number, column in enumerate(columns)
                if widths[number] > _least(column)
            ]
            if not spare:
                break
            most, _, number = max(spare, key=lambda each: each[1])
            less = min(most, excess)
            widths[number], excess = widths[number] - less, excess - less
    for line in zip(*columns, strict=True):
        cells = [wrapped(cell, size) for cell, size in zip(line, widths, strict=True)]
        for parts in zip_longest(*cells, fillvalue=""):
            shown = (f"{part:{place}{size}}" for part, place, size in zip(parts, places, widths, strict=True))
            yield (indent + _BETWEEN.join(shown)).rstrip()
