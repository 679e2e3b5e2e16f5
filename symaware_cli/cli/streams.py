"""Capabilities of output streams: colours, progress bars and the width of lines.

Reasons: docs/decisions/0113-fitting-the-terminal-and-the-view.md
"""

from __future__ import annotations

import os
import sys
from typing import TextIO

#: The least width that is respected [columns]; in a narrower terminal the lines are as long.
_NARROWEST = 40


def is_plain() -> bool:
    """Whether plain text is requested by `NO_COLOR` (https://no-color.org) or `TERM=dumb`."""
    return bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") == "dumb"


def is_lively(stream: TextIO) -> bool:
    """Whether a stream is a terminal that supports colours and progress bars."""
    return stream.isatty() and not is_plain()


def width_of(stream: TextIO | None = None) -> int | None:
    """The columns of a terminal: those of `COLUMNS`, or its own; None if the lines of a stream are not to be folded.

    Many programs export `COLUMNS` to others whose output they read, so it says nothing about a pipe. As for Rich,
    `TTY_COMPATIBLE=1` says that a pipe leads to a terminal.

    Args:
        stream: By default, the standard output.
    """
    stream = stream or sys.stdout
    if os.environ.get("TTY_COMPATIBLE") != "1" and not stream.isatty():
        return None
    stated = os.environ.get("COLUMNS", "")
    if stated.isdecimal() and int(stated):
        return max(int(stated), _NARROWEST)
    try:
        return max(os.get_terminal_size(stream.fileno()).columns, _NARROWEST)
    except (OSError, ValueError, AttributeError):
        return None
