"""Explains TOML syntax errors: translates those of tomllib, and finds excessive nesting before parsing."""

import re
import tomllib
from collections.abc import Iterator

from symaware_cli.language.source import MAX_DEPTH, Source

_MARK = re.compile(r"\"\"\"|'''|[\"'#\[\]{}.=,\n]")
# The rest of a text, up to its closing mark. Possessive quantifiers, so that no text causes backtracking.
_CLOSED = {
    '"': re.compile(r'(?:[^"\\\n]++|\\.)*+"'),
    "'": re.compile(r"[^'\n]*+'"),
    '"""': re.compile(r'(?:[^"\\]++|\\.|"(?!""))*+"{3,5}', re.DOTALL),
    "'''": re.compile(r"(?:[^']++|'(?!''))*+'{3,5}"),
}

_UNCLOSED_TEXT = "the text that starts here is never closed with a quote"
# (pattern over tomllib's message, code, message); the first that matches is used.
_WORDS: tuple[tuple[str, str, str], ...] = (
    (r"Illegal character '\\n'|Unterminated string|Expected \"'+\"", "unclosed", _UNCLOSED_TEXT),
    (r"Illegal character '\\r'", "syntax", "a carriage return without a line feed is not a line break"),
    (r"Unclosed array", "unclosed", "`,` or `]` is missing before this"),
    (r"Unclosed inline table", "unclosed", "`,` or `}` is missing before this; an inline table is all on one line"),
    (r"Expected '=' after a key", "syntax", "a `=` is missing after this key"),
    (r"Expected '\]", "syntax", "the table's name is not closed with a bracket"),
    (r"Invalid initial character for a key part", "syntax", "a key is expected here, on the same line"),
    (r"Invalid value", "syntax", "this is not a value; a text must be in quotes"),
    (r"Invalid statement", "syntax", "a line starts with a key, a `[table]` or a `#`"),
    (r"Expected newline", "syntax", "this cannot follow the value before it"),
    (
        r"Unescaped|hex value|scalar value",
        "bad-escape",
        "this escape is not a valid character; write `\\\\` for a backslash",
    ),
    (r"date", "date-not-allowed", "this is not a valid date, and a scenario has no dates"),
    (
        r"overwrite|twice|[Dd]uplicate|immutable|redefine",
        "duplicate-key",
        "this key or table is already given before, or inside a value that is complete",
    ),
)


def text_end(text: str, index: int) -> int | None:
    """Returns the index behind the quoted text that begins at an index; None if none does, or if it is never closed."""
    mark = text[index : index + 3]
    mark = mark if mark in _CLOSED else mark[:1]
    closed = _CLOSED[mark].match(text, index + len(mark)) if mark in _CLOSED else None
    return closed.end() if closed else None


def _marks(text: str) -> Iterator[tuple[str, int]]:
    """Yields the marks outside texts and comments with their indices; finally, a quote that is never closed."""
    position = 0
    while found := _MARK.search(text, position):
        position, mark = found.end(), found.group()
        if mark in _CLOSED:
            closed = _CLOSED[mark].match(text, position)
            if closed is None:
                yield mark, found.start()
                return
            position = closed.end()
        elif mark == "#":
            position = text.find("\n", position)
            if position < 0:
                return
        else:
            yield mark, found.start()


def excessive_nesting(text: str) -> int | None:
    """Returns the index at which brackets or dots nest too deep, if any.

    tomllib recurses for each bracket and takes quadratic time for the dots of a key, so this only counts the brackets
    and dots of the text outside quotes and comments.
    """
    depth = dots = 0
    for mark, index in _marks(text):
        if mark == ".":
            dots += 1
        else:
            dots = 0
            depth += (mark in "[{") - (mark in "]}")
        # One more than the limit, because the second bracket of a `[[table]]` does not nest.
        if depth > MAX_DEPTH + 1 or dots > MAX_DEPTH:
            return index
    return None


def report_syntax_error(source: Source, error: tomllib.TOMLDecodeError) -> None:
    """Adds a problem for a syntax error."""
    reason = re.sub(r" \(at [^()]*\)$", "", str(error))
    place = re.search(r"\(at line (\d+), column (\d+)\)$", str(error))
    if place:
        line, column = int(place[1]), int(place[2])
    else:
        # At the end of the document: the last line that is not blank.
        line = max((number for number, text in enumerate(source.lines, 1) if text.strip()), default=1)
        column = len(source.lines[line - 1].rstrip()) + 1
    text = source.line_text(line) or ""
    # The parser may have stopped after the line break.
    column = min(column, len(text) + 1)
    word = re.compile(r"[\w+.-]*").match(text, column - 1)
    span = source.text_span(line, column, line, word.end() + 1 if word else column + 1)
    code, message = next(
        ((code, message) for pattern, code, message in _WORDS if re.search(pattern, reason)),
        ("syntax", f"this is not valid TOML: {reason}"),
    )
    if message is _UNCLOSED_TEXT:
        opened = next((index for mark, index in _marks(source.text) if mark in _CLOSED), None)
        span = span if opened is None else source.at(opened)
    elif code == "duplicate-key":
        # The parser reports this only after the value.
        start = len(text) - len(text.lstrip())
        span = source.text_span(line, start + 1, line, column)
    elif not place:
        message = message.replace("before this", "at the end of the file")
    elif code == "syntax" and not text[column - 1 : column].isascii():
        message = "outside quotes only the letters a to z, digits, `_` and `-` make a key or a value"
    source.report(code, message, span)
