"""Problems in scenarios, with their positions, and their display to people and tools."""

import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace

from symaware_cli.world import counted, record
from symaware_cli.world import nearest as nearest
from symaware_cli.world import quoted as quoted

# The greatest number of problems that are collected from one file.
MAX_PROBLEMS = 100
_WIDTH = 100
_TAB = "    "
_BOLD, _RED, _DIM, _RESET = "\x1b[1m", "\x1b[31m", "\x1b[2m", "\x1b[0m"


@record
class TextSpan:
    """A part of one line of a file.

    Attributes:
        file: The file's name as the user typed it, or a pseudo file such as `--set run.duration=2`.
        line: Line number, from 1.
        column: First column, from 1, counted in characters.
        end_column: The column after the last one, on the same line.
    """

    file: str
    line: int
    column: int
    end_column: int


@record
class Problem:
    """One problem.

    Attributes:
        code: A stable identifier for tools, such as `unknown-key`.
        message: One sentence without a full stop.
        span: The position, if there is one.
        path: The dotted path of the value in the document, such as `agents.robot.state`.
        expected: A description of valid values, worded to follow "expected".
        suggestion: The nearest valid name.
        source_line: The whole line of `span`.
        users: The groups that have the value from a template or another group, each with the line of its `like`.
    """

    code: str
    message: str
    span: TextSpan | None = None
    path: str = ""
    expected: str | None = None
    suggestion: str | None = None
    source_line: str | None = None
    users: tuple[str, ...] = ()


class ScenarioError(Exception):
    """A scenario cannot be used.

    Attributes:
        problems: The problems in the order of files and lines, without duplicates.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(_joined(sorted(problems, key=_position)))
        super().__init__(self.problems)

    def __str__(self) -> str:
        return render(self.problems)


def _joined(problems: Iterable[Problem]) -> Iterable[Problem]:
    """Return problems without duplicates; one that several groups have from a template is one."""
    found: dict[tuple[object, ...], Problem] = {}
    for each in problems:
        key = (each.code, each.message, each.span, each.expected, None if each.users else each.path)
        earlier = found.get(key)
        users = each.users if earlier is None else tuple(dict.fromkeys([*earlier.users, *each.users]))
        found[key] = replace(earlier or each, users=users)
    return found.values()


def _position(problem: Problem) -> tuple[str, int, int]:
    span = problem.span
    return (span.file, span.line, span.column) if span else ("", 0, 0)


def dotted(path: Iterable[str | int]) -> str:
    """Returns a path in the notation of `--set`: `agents.robot.state[0]`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def is_inside(path: str, outer: str) -> bool:
    """Return whether a path in the notation of `dotted` is equal to another one or inside it."""
    return path == outer or path.startswith((f"{outer}.", f"{outer}["))


def to_json(problems: Iterable[Problem]) -> list[dict[str, object]]:
    """Returns the problems as plain data for tools."""
    return [asdict(problem) | {"source_line": _short(problem.source_line)} for problem in problems]


def _short(line: str | None) -> str | None:
    # A megabyte of minified YAML on one line must not be repeated for each problem.
    return line if line is None or len(line) <= 1000 else None


def render(problems: Sequence[Problem], *, colour: bool = False, width: int = _WIDTH, noun: str = "problem") -> str:
    """Returns the problems as text: position, message, source line with a caret, and hints on valid values.

    Args:
        problems: The problems, in this order.
        colour: Whether to mark the message and the caret with terminal colours.
        width: Columns of the terminal; longer source lines are cut around the caret.
        noun: The word for them in the last line, which counts them: "problem" or "warning".
    """
    lines: list[str] = []
    for problem in problems:
        lines += _render_one(problem, colour, width)
    if problems:
        files = list(dict.fromkeys(problem.span.file for problem in problems if problem.span))
        count = counted(len(problems), noun)
        where = f" in {_printable(files[0])}" if len(files) == 1 else f" in {len(files)} files" if files else ""
        lines.append(count + where)
    return "\n".join(lines)


def _render_one(problem: Problem, colour: bool, width: int) -> list[str]:
    bold, red, dim, reset = (_BOLD, _RED, _DIM, _RESET) if colour else ("", "", "", "")
    message = _printable(problem.message)
    span = problem.span
    if span is None:
        where = f"{_printable(problem.path)}: " if problem.path else ""
        lines = [f"{bold}{where}{reset}{red}{message}{reset}"]
    else:
        lines = [f"{bold}{_printable(span.file)}:{span.line}:{span.column}: {reset}{red}{message}{reset}"]
        if problem.source_line is not None:
            text, before, under = _excerpt(problem.source_line, span, width - 8)
            lines.append(f"{dim}{span.line:5} |{reset} {text}".rstrip())
            lines.append(f"{dim}      |{reset} {' ' * before}{red}{'^' * under}{reset}")
    hints = []
    if problem.expected:
        hints.append(f"expected {_printable(problem.expected)}")
    if problem.suggestion:
        hints.append(f"did you mean `{_printable(problem.suggestion)}`?")
    if hints:
        lines.append("   " + "; ".join(hints))
    if problem.users:
        lines.append(f"   in {_printable(', '.join(problem.users))}")
    return lines


def _printable(text: str) -> str:
    return "".join(_cell(character) for character in text)


def _cell(character: str) -> str:
    """Returns the display of a character on a terminal; never an escape code or an invisible mark."""
    if character == "\t":
        return _TAB
    return character if character.isprintable() else character.encode("unicode_escape").decode("ascii")


def _columns(text: str) -> int:
    """Returns the number of terminal columns of printable text."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(character) else 2 if unicodedata.east_asian_width(character) in "WF" else 1
        for character in text
    )


def _excerpt(line: str, span: TextSpan, width: int) -> tuple[str, int, int]:
    """Returns the part of a line around a span, the columns before the caret, and the caret's width."""
    start = min(span.column - 1, len(line))
    # One character is at most ten columns (an escape), so this much is certain to fill the window.
    first = max(0, start - width)
    cells = [_cell(character) for character in line[first : start + width]]
    start -= first
    end = max(start + 1, min(span.end_column - 1 - first, len(cells)))
    widths = [_columns(cell) for cell in cells]
    cut_left, cut_right = first > 0, first + len(cells) < len(line)
    # Keep a third of the window for what comes before the caret, the rest for what follows.
    left, before = start, 0
    total = sum(widths)
    room = width if total <= width else width // 3
    while left > 0 and before + widths[left - 1] <= room:
        left -= 1
        before += widths[left]
    right, used = start, before
    while right < len(cells) and used + widths[right] <= width:
        used += widths[right]
        right += 1
    prefix = "..." if cut_left or left > 0 else ""
    suffix = "..." if cut_right or right < len(cells) else ""
    under = sum(widths[start : min(end, right)]) or 1
    return prefix + "".join(cells[left:right]) + suffix, before + len(prefix), under
