"""The help of the command: its options, and its verbs in their groups.

It is written without Typer and Rich, whose import takes ten times as long as all else. The help of each verb is theirs.

Reasons: docs/decisions/0116-the-start.md
"""

from __future__ import annotations

import sys
from itertools import groupby

from symaware_cli.cli.folding import wrapped
from symaware_cli.cli.streams import is_lively, width_of
from symaware_cli.cli.verbs import DESCRIPTION, Verbs

#: The options of the command without a verb, with their help, as Typer has them.
OPTIONS = (
    ("--version", "Show the version."),
    ("--install-completion", "Install completion for the current shell."),
    ("--show-completion", "Show completion for the current shell, to copy it or customize the installation."),
    ("-h, --help", "Show this message and exit."),
)

_USAGE = "symaware COMMAND [OPTIONS]..."

_EXIT_STATUS = (
    "Exit status: 0 success; 1 the run failed, or `verify` or `diff` found a difference; 2 the input is invalid; "
    "3 success, but data was lost, a specification is violated, an agent reported an error, or a claim is not "
    "established; 130 interrupted."
)

_BOLD, _NAME, _FRAME, _END = "\x1b[1m", "\x1b[1;36m", "\x1b[2m", "\x1b[0m"

#: The greatest length of a line in a terminal [columns]: longer ones are hard to read.
_WIDEST = 100

#: A title with its entries: names and texts.
_Section = tuple[str, list[tuple[str, str]]]


def help_text(verbs: Verbs | None = None) -> str:
    """Return the help, with frames and colours if the standard output is a terminal that shows them.

    Args:
        verbs: The verbs of the installation, if they have been searched already.
    """
    sections: list[_Section] = [("Options", list(OPTIONS))]
    for title, group in groupby((verbs or Verbs()).summaries(), lambda each: each.title):
        sections.append((title, [(each.name, " ".join(each.text.partition("\n\n")[0].split())) for each in group]))
    width = width_of()
    if width is not None and is_lively(sys.stdout) and (sys.stdout.encoding or "").lower().startswith("utf"):
        return _framed(sections, min(width, _WIDEST))
    return _plain(sections, width)


def _plain(sections: list[_Section], width: int | None) -> str:
    """Return text without frames; in a pipe, an entry is one line, for `grep`."""
    lines = [f"Usage: {_USAGE}", "", *_paragraph(DESCRIPTION, width)]
    for (title, entries), names in zip(sections, _columns(sections), strict=True):
        column = names + 2
        lines += ["", f"{title}:"]
        for name, text in entries:
            first, *others = _paragraph(text, width and width - column - 2)
            lines += [f"  {name:<{column}}{first}", *(" " * (column + 2) + each for each in others)]
    return "\n".join([*lines, "", *_paragraph(_EXIT_STATUS, width), ""])


def _framed(sections: list[_Section], width: int) -> str:
    lines = ["", f" {_BOLD}Usage:{_END} {_USAGE}", ""]
    lines += [f" {each}" for each in _paragraph(DESCRIPTION, width - 2)] + [""]
    for (title, entries), column in zip(sections, _columns(sections), strict=True):
        lines.append(f"{_FRAME}╭─{_END} {_BOLD}{title}{_END} {_FRAME}{'─' * (width - 5 - len(title))}╮{_END}")
        for name, text in entries:
            for number, each in enumerate(_paragraph(text, width - column - 6)):
                shown = f"{'' if number else name:<{column}}"
                space = " " * (width - column - 6 - len(each))
                lines.append(f"{_FRAME}│{_END} {_NAME}{shown}{_END}  {each}{space} {_FRAME}│{_END}")
        lines.append(f"{_FRAME}╰{'─' * (width - 2)}╯{_END}")
    return "\n".join([*lines, *(f" {each}" for each in _paragraph(_EXIT_STATUS, width - 2)), ""])


def _columns(sections: list[_Section]) -> list[int]:
    """The widths of the names: that of the options, and one for all verbs."""
    options, *verbs = ([len(name) for name, _ in entries] for _, entries in sections)
    return [max(options), *[max(map(max, verbs), default=0)] * len(verbs)]


def _paragraph(text: str, width: int | None) -> list[str]:
    """Return the lines of a text; a word that is longer than a line is broken, so that it stays in its frame."""
    if width is None:
        return [text]
    width = max(width, 10)
    return [line[at : at + width] for line in wrapped(text, width) for at in range(0, max(len(line), 1), width)]
