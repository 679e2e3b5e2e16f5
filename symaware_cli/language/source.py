"""A file of the scenario language: plain data plus the position of every key and value.

YAML and TOML are both parsed to a tree of `SourceNode`, so that later stages do not depend on the format. This module
limits the size of the file, its nesting and the number of values in it.
"""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

from symaware_cli.language.problem import Problem, TextSpan, dotted
from symaware_cli.world import record

Path: TypeAlias = tuple[str | int, ...]
Scalar: TypeAlias = str | int | float | bool | None

MAX_BYTES = 1024 * 1024
MAX_DEPTH = 32
MAX_NODES = 100_000
# A text counts as one further value per this many characters, so that the bound also limits
# long texts that are repeated by aliases or parameters.
_CHARACTERS_PER_NODE = 64

LINE_BREAK = re.compile(r"\r\n|\n|\r")
# The characters that YAML forbids, and separators that only some editors treat as line breaks.
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")


@record
class MappingEntry:
    """A key's position and its value."""

    key: TextSpan
    node: "SourceNode"


class SourceNode:
    """A value and its position. Nodes are immutable, so that aliases may share them.

    Attributes:
        value: A scalar, a list of nodes, or a dictionary of entries.
        span: The position of the value.
        size: The number of values in it and itself, counting shared ones each time; a long text counts as several.
        height: The levels of nesting; 0 for a scalar.
    """

    __slots__ = ("height", "size", "span", "value")

    def __init__(self, value: "Scalar | list[SourceNode] | dict[str, MappingEntry]", span: TextSpan) -> None:
        self.value = value
        self.span = span
        self.size = 1
        self.height = 1 if isinstance(value, dict | list) else 0
        if isinstance(value, str):
            self.size += len(value) // _CHARACTERS_PER_NODE
        elif isinstance(value, dict):
            self.size += sum(len(key) // _CHARACTERS_PER_NODE for key in value)
        for child in self.children():
            self.size += child.size
            self.height = max(self.height, child.height + 1)

    @classmethod
    def of(cls, value: Any, span: TextSpan) -> "SourceNode":
        """Returns the tree of a plain value; all of its nodes get the same position."""
        if isinstance(value, dict):
            return cls({key: MappingEntry(span, cls.of(each, span)) for key, each in value.items()}, span)
        return cls([cls.of(each, span) for each in value] if isinstance(value, list) else value, span)

    def children(self) -> "Iterator[SourceNode]":
        """Yields the values directly inside."""
        if isinstance(self.value, dict):
            yield from (entry.node for entry in self.value.values())
        elif isinstance(self.value, list):
            yield from self.value

    def plain(self) -> Any:
        """Returns the value as new dictionaries, lists and scalars."""
        if isinstance(self.value, dict):
            return {key: entry.node.plain() for key, entry in self.value.items()}
        if isinstance(self.value, list):
            return [child.plain() for child in self.value]
        return self.value

    def nearest_span(self, path: Path, *, key: bool = False) -> TextSpan:
        """Returns the position of the value (or the key) at a path, or of its nearest existing ancestor."""
        *_, (node, key_span) = self._along(path)
        return key_span if key else node.span

    def descendant(self, path: Path) -> "SourceNode | None":
        """Returns the value at a path, or `None` if there is none."""
        nodes = [node for node, _ in self._along(path)]
        return nodes[-1] if len(nodes) > len(path) else None

    def _along(self, path: Path) -> "Iterator[tuple[SourceNode, TextSpan]]":
        """Yield this node and those along a path, as far as they exist, each with the position of its key."""
        node, key_span = self, self.span
        yield node, key_span
        for part in path:
            if isinstance(node.value, dict) and isinstance(part, str) and part in node.value:
                entry = node.value[part]
                node, key_span = entry.node, entry.key
            elif isinstance(node.value, list) and isinstance(part, int) and 0 <= part < len(node.value):
                node = node.value[part]
                key_span = node.span
            else:
                return
            yield node, key_span


class Source:
    """One file: its text, its problems, and its tree of nodes.

    Attributes:
        name: The file's name as the user typed it.
        raw: The bytes as written.
        text: The text without a byte order mark.
        problems: The problems found so far.
        root: The tree, as far as it could be parsed; `None` if it could not.
    """

    def __init__(self, name: str, raw: bytes, text: str = "") -> None:
        self.name = name
        self.raw = raw
        self.text = text
        self.lines = LINE_BREAK.split(text)
        self.problems: list[Problem] = []
        self.root: SourceNode | None = None

    def copy(self) -> "Source":
        """Returns a copy with the same text and problems, to which others may be added."""
        copied = Source(self.name, self.raw, self.text)
        copied.problems += self.problems
        return copied

    @property
    def data(self) -> dict[str, Any]:
        """The document as plain data; empty if the file could not be parsed."""
        return {} if self.root is None else dict(self.root.plain())

    def span(self, path: Path, key: bool = False) -> TextSpan | None:
        """Returns the position of the value (or the key) at a path, or `None` if there is none."""
        if self.root is None or self.root.descendant(path) is None:
            return None
        return self.root.nearest_span(path, key=key)

    def line_text(self, line: int) -> str | None:
        """Returns a line by its number, from 1."""
        return self.lines[line - 1] if 1 <= line <= len(self.lines) else None

    def text_span(self, line: int, column: int, end_line: int, end_column: int) -> TextSpan:
        """Returns a span of text, cut at the end of its first line and at least one column wide."""
        if end_line != line:
            end_column = len(self.line_text(line) or "") + 1
        return TextSpan(self.name, line, column, max(end_column, column + 1))

    def at(self, index: int) -> TextSpan:
        """Returns the span of the character at an index of the text."""
        before = LINE_BREAK.split(self.text[:index])
        column = len(before[-1]) + 1
        return TextSpan(self.name, len(before), column, column + 1)

    def report(
        self,
        code: str,
        message: str,
        span: TextSpan | None,
        path: Sequence[str | int] = (),
        *,
        expected: str | None = None,
        suggestion: str | None = None,
    ) -> None:
        """Adds a problem."""
        line = self.line_text(span.line) if span else None
        self.problems.append(Problem(code, message, span, dotted(path), expected, suggestion, line))


def decode(name: str, raw: bytes) -> Source:
    """Decodes bytes into a source; reports characters that could confuse a parser or a terminal."""
    try:
        # utf-8-sig would hide a byte order mark from the offsets of a decoding error.
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        source = Source(name, raw, raw.decode("utf-8", errors="replace").removeprefix("\ufeff"))
        # Everything before the offset is valid, so its lines and columns are those that an editor shows.
        before = LINE_BREAK.split(raw[: error.start].decode("utf-8").removeprefix("\ufeff"))
        line, column = len(before), len(before[-1]) + 1
        source.report(
            "not-utf-8",
            f"byte 0x{raw[error.start]:02x} at offset {error.start} is not UTF-8",
            TextSpan(name, line, column, column + 1),
            expected="a file saved as UTF-8",
        )
        return source
    source = Source(name, raw, text.removeprefix("\ufeff"))
    for number, line_text in enumerate(source.lines, 1):
        found = _FORBIDDEN.search(line_text)
        if found:
            column = found.start() + 1
            message = f"the character {_code_point(found.group())} is not allowed in a scenario file"
            source.report("bad-character", message, TextSpan(name, number, column, column + 1))
    return source


def _code_point(character: str) -> str:
    return f"U+{ord(character):04X}"


class ValueProblem(NamedTuple):
    """A problem with a value whose position is not known yet."""

    code: str
    message: str
    expected: str | None = None


LARGE_NUMBER = ValueProblem(
    "too-large-number", "this whole number does not fit in 64 bits", "a number between -2^63 and 2^63 - 1"
)


def scalar_fault(value: object) -> ValueProblem | None:
    """Returns the problem with a value that scenarios must not contain, in either format."""
    if isinstance(value, str):
        found = _FORBIDDEN.search(value)
        return (
            ValueProblem("bad-character", f"the character {_code_point(found.group())} is not allowed")
            if found
            else None
        )
    if isinstance(value, float):
        if math.isfinite(value):
            return None
        return ValueProblem("not-finite", f"{value} is not a finite number", "a finite number")
    if isinstance(value, int):
        return None if -(2**63) <= value < 2**63 else LARGE_NUMBER
    if value is None:
        return None
    return ValueProblem("date-not-allowed", "a scenario has no dates", "a text in quotes, or a number of seconds")


def report_depth(source: Source, span: TextSpan | None, path: Sequence[str | int] = ()) -> None:
    """Reports excessive nesting."""
    source.report("too-deep", f"values are nested more than {MAX_DEPTH} deep", span, path)


def report_nodes(source: Source, span: TextSpan | None, path: Sequence[str | int] = ()) -> None:
    """Reports too many values."""
    source.report("too-large", f"the file expands to more than {MAX_NODES:,} values", span, path)
