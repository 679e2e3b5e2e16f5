"""Text that fits the terminal: lines are folded between words, and a number stays with its unit.

Only text in a terminal is folded: the lines of files and pipes stay whole, for `grep`.

Reasons: docs/decisions/0113-fitting-the-terminal-and-the-view.md
"""

from __future__ import annotations

import re
from itertools import pairwise

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")

#: The end of a label, or of a cell: spaces before what is in the next column.
_GAP = re.compile(r"(?<=\S) {2,}(?=\S)")
_INDENT = re.compile(r"^ *")

#: A line of a source file with its number, or the mark below it: its columns have a meaning.
_EXCERPT = re.compile(r"^ *\d* \| ?")

_NUMBER = re.compile(r"^[\[({<>=~-]*[\d.,:/e+-]*\d[\d.,:/e+-]*$")


def folded(text: str, width: int | None) -> str:
    """Return a text with its lines folded; a word that is longer than a line is not broken.

    Args:
        text: The text. A line that begins with a label, with two spaces or more behind it, goes on below its text.
        width: The greatest length of a line; None to return the text as it is.
    """
    if width is None:
        return text
    return "\n".join(part for line in text.split("\n") for part in _folded_line(line, width))


def parts_of(text: str) -> list[str]:
    """Split a text where it may be folded: a number stays with the word behind it, and a name with its unit ``[m]``."""
    words = text.split(" ")
    parts = words[:1]
    for before, word in pairwise(words):
        is_counted = _NUMBER.match(before) and word and not _NUMBER.match(word)
        if is_counted or (word.startswith("[") and word.endswith("]")):
            parts[-1] += f" {word}"
        else:
            parts.append(word)
    return parts


def wrapped(text: str, width: int) -> list[str]:
    """Return the lines of a text, each at most as long as its longest part or as the width."""
    lines: list[str] = []
    for part in parts_of(text):
        if lines and length(lines[-1]) + 1 + length(part) <= width:
            lines[-1] += f" {part}"
        else:
            lines.append(part)
    return [line.strip(" ") for line in lines]


def length(text: str) -> int:
    """The columns of a text, without the codes of its colours."""
    return len(_COLOUR.sub("", text))


def _folded_line(line: str, width: int) -> list[str]:
    plain = _COLOUR.sub("", line)
    if len(plain) <= width or _EXCERPT.match(plain):
        return [line]
    indent = _INDENT.match(plain)
    assert indent is not None
    # The last column that begins in the left half: what is in it goes on below itself.
    start = max((gap.end() for gap in _GAP.finditer(plain) if gap.end() <= 0.5 * width), default=indent.end())
    first, *others = wrapped(line[start:], width - start) if plain == line else wrapped(line, width)
    return [line[:start] * (plain == line) + first, *(" " * start + other for other in others if other)]
