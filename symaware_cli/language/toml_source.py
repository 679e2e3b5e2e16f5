"""Parses TOML into nodes: tomllib determines validity and values, a walk over the text their positions.

Reasons: docs/decisions/0002-dependencies.md
"""

import re
import tomllib
from bisect import bisect_right
from typing import Any, Final

from symaware_cli.language.problem import MAX_PROBLEMS, TextSpan, quoted
from symaware_cli.language.source import (
    LARGE_NUMBER,
    LINE_BREAK,
    MAX_DEPTH,
    MAX_NODES,
    MappingEntry,
    Path,
    Source,
    SourceNode,
    report_depth,
    report_nodes,
    scalar_fault,
)
from symaware_cli.language.toml_syntax import excessive_nesting, report_syntax_error, text_end

# Possessive quantifiers, so that no text causes backtracking.
_SPACE: Final = re.compile(r"[ \t]*+")
_BLANK: Final = re.compile(r"(?:[ \t\r\n]++|#[^\n]*+)*+")
_LINE: Final = re.compile(r"[^\n]*+")
_BARE: Final = re.compile(r"[A-Za-z0-9_-]++")
# A time may follow a date after a space.
_SCALAR: Final = re.compile(r"[^\s,\]}#]++(?:(?<=\d\d\d\d-\d\d-\d\d) \d[^\s,\]}#]*+)?+")


def parse_toml(source: Source) -> None:
    """Fills in `source.root` and `source.problems` from TOML text."""
    deep = excessive_nesting(source.text)
    if deep is not None:
        # Checked first, because tomllib recurses.
        report_depth(source, source.at(deep))
        return
    try:
        data = tomllib.loads(source.text)
    except tomllib.TOMLDecodeError as error:
        _report_invalid(source, error)
    except RecursionError:
        report_depth(source, None)
    except ValueError:
        # Not a TOMLDecodeError: int() refuses to read thousands of digits.
        digits = re.search(r"[0-9_]{4000,}", source.text)
        source.report(LARGE_NUMBER.code, LARGE_NUMBER.message, source.at(digits.start() if digits else 0))
    else:
        if not data:
            return
        if _count(data) > MAX_NODES:
            report_nodes(source, source.at(0))
            return
        spans = _SpanTable(source)
        spans.walk()
        source.root = _TomlNodeBuilder(source, spans).build(data, ())


def _report_invalid(source: Source, error: tomllib.TOMLDecodeError) -> None:
    """Reports a syntax error; for duplicate keys, reports all of them and every bad value."""
    if re.search(r"overwrite|twice|[Dd]uplicate|immutable|redefine", str(error)):
        spans = _SpanTable(source)
        spans.walk()
        if spans.duplicates:
            for path, span, first in spans.duplicates[:MAX_PROBLEMS]:
                message = f"the key {quoted(str(path[-1]))} is already on line {first.line}"
                source.report("duplicate-key", message, span, path)
            spans.report_leaves()
            return
    report_syntax_error(source, error)


def _count(data: dict[str, Any]) -> int:
    """Returns the number of values, without recursing."""
    count = 0
    waiting: list[Any] = [data]
    while waiting:
        value = waiting.pop()
        count += 1
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
    return count


class _TomlNodeBuilder:
    """Builds nodes from the data that tomllib read; a value without a known span gets that of its parent."""

    def __init__(self, source: Source, spans: "_SpanTable") -> None:
        self._source = source
        self._spans = spans

    def build(self, value: Any, path: Path, parent: TextSpan | None = None) -> SourceNode:
        span = self._spans.values.get(path) or parent or self._source.at(0)
        if not isinstance(value, dict | list):
            fault = scalar_fault(value)
            if fault is None:
                return SourceNode(value, span)
            if len(self._source.problems) < MAX_PROBLEMS:
                self._source.report(fault.code, fault.message, span, path, expected=fault.expected)
            return SourceNode(None, span)
        if len(path) >= MAX_DEPTH:
            # Dotted keys nest without brackets.
            report_depth(self._source, span, path)
            return SourceNode(None, span)
        if isinstance(value, list):
            return SourceNode([self.build(item, (*path, index), span) for index, item in enumerate(value)], span)
        entries = {}
        for key, item in value.items():
            key_span = self._spans.keys.get((*path, key), span)
            fault = scalar_fault(key)
            if fault:
                self._source.report(fault.code, fault.message, key_span, (*path, key))
            entries[key] = MappingEntry(key_span, self.build(item, (*path, key), key_span))
        return SourceNode(entries, span)


class _UnreadableError(Exception):
    """The following text is not TOML."""

    def __init__(self, index: int) -> None:
        super().__init__()
        self.index = index


class _SpanTable:
    """The spans of all keys and values of a TOML document.

    tomllib has no positions. This walks over texts that it accepts, or rejects for a key that is given twice; other
    text is skipped, to the end of its line.

    Attributes:
        keys: The span of the key of each path.
        values: The span of the value at each path; for a table, of its name in the header.
        duplicates: The path, the span and the first span of each duplicate key.
    """

    def __init__(self, source: Source) -> None:
        self.keys: dict[Path, TextSpan] = {}
        self.values: dict[Path, TextSpan] = {}
        self.duplicates: list[tuple[Path, TextSpan, TextSpan]] = []
        self._source = source
        self._text = source.text
        self._starts = [0, *(found.end() for found in LINE_BREAK.finditer(source.text))]
        # The number of tables so far in each array of tables.
        self._arrays: dict[Path, int] = {}
        # Paths that must not be defined again: values, headers and tables created by dotted keys.
        self._final: dict[Path, TextSpan] = {}
        self._leaves: list[tuple[Path, int, int]] = []

    def walk(self) -> None:
        """Collects the spans."""
        # The table that pairs belong to; None if it is given twice.
        table: Path | None = ()
        position = self._after(_BLANK, 0)
        while position < len(self._text):
            try:
                if self._text[position] == "[":
                    table, position = self._header(position)
                else:
                    position = self._pair(table, position)
            except _UnreadableError as unreadable:
                position = self._after(_LINE, unreadable.index)
            position = self._after(_BLANK, position)

    def report_leaves(self) -> None:
        """Reports bad numbers and dates of a document that tomllib rejects."""
        for path, start, end in self._leaves:
            if len(self._source.problems) >= MAX_PROBLEMS:
                return
            text = self._text[start:end]
            try:
                fault = scalar_fault(tomllib.loads(f"x={text}")["x"])
            except tomllib.TOMLDecodeError:
                fault = None
            except ValueError:
                fault = LARGE_NUMBER
            if fault:
                self._source.report(fault.code, fault.message, self._span(start, end), path, expected=fault.expected)

    def _header(self, position: int) -> tuple[Path | None, int]:
        """Reads `[table]` or `[[table]]`; returns the table's path, or None if it is given twice."""
        is_array = self._text.startswith("[[", position)
        names, position = self._names(self._after(_SPACE, position + 1 + is_array))
        position = self._expect("]]" if is_array else "]", position)
        path: Path = ()
        for name, span in names[:-1]:
            path = self._current((*path, name))
            # The path of an array of tables ends with the index of its last table, so the name is one before.
            self._add_span(path if path[-1] == name else path[:-1], span)
        name, span = names[-1]
        path = (*path, name)
        if path in self._final and not (is_array and path in self._arrays):
            self.duplicates.append((path, span, self._final[path]))
            return None, position
        self._final.setdefault(path, span)
        if is_array:
            self._add_span(path, span)
            index = self._arrays.get(path, 0)
            self._arrays[path] = index + 1
            path = (*path, index)
        # A header of its own is a better place than being named on the way to an inner table.
        self.keys[path] = self.values[path] = span
        return path, position

    def _current(self, path: Path) -> Path:
        """Returns the path of the table that a name denotes at present: in an array of tables, the last one."""
        return (*path, self._arrays[path] - 1) if path in self._arrays else path

    def _add_span(self, path: Path, span: TextSpan) -> None:
        self.keys.setdefault(path, span)
        self.values.setdefault(path, span)

    def _pair(self, table: Path | None, position: int) -> int:
        """Reads `key = value` and returns the index behind it; records nothing if the table is None."""
        names, position = self._names(position)
        position = self._after(_SPACE, self._expect("=", position))
        if table is None or len(table) > MAX_DEPTH:
            return self._value(None, position)
        path = table
        for name, span in names[:-1]:
            path = (*path, name)
            self._add_span(path, span)
            self._final.setdefault(path, span)
        name, span = names[-1]
        path = (*path, name)
        if path in self.keys:
            self.duplicates.append((path, span, self.keys[path]))
            return self._value(None, position)
        self.keys[path] = self._final[path] = span
        return self._value(path, position)

    def _value(self, path: Path | None, start: int) -> int:
        """Reads a value and returns the index behind it; records it and its content if the path is not None."""
        inner = None if path is None or len(path) > MAX_DEPTH else path
        opening = self._text[start : start + 1]
        if opening == "[":
            end = self._items(inner, start)
        elif opening == "{":
            end = self._inline_table(inner, start)
        elif opening in ("'", '"'):
            end = text_end(self._text, start) or -1
        else:
            end = self._after(_SCALAR, start)
            if inner is not None and opening not in ("t", "f"):
                self._leaves.append((inner, start, end))
        if end <= start:
            raise _UnreadableError(start)
        if path is not None:
            self.values[path] = self._span(start, end)
        return end

    def _items(self, path: Path | None, position: int) -> int:
        position = self._after(_BLANK, position + 1)
        index = 0
        while not self._text.startswith("]", position):
            position = self._after(_BLANK, self._value(None if path is None else (*path, index), position))
            index += 1
            if self._text.startswith(",", position):
                position = self._after(_BLANK, position + 1)
            elif not self._text.startswith("]", position):
                raise _UnreadableError(position)
        return position + 1

    def _inline_table(self, path: Path | None, position: int) -> int:
        position = self._after(_SPACE, position + 1)
        while not self._text.startswith("}", position):
            position = self._after(_SPACE, self._pair(path, position))
            if self._text.startswith(",", position):
                position = self._after(_SPACE, position + 1)
            elif not self._text.startswith("}", position):
                raise _UnreadableError(position)
        return position + 1

    def _names(self, position: int) -> tuple[list[tuple[str, TextSpan]], int]:
        """Reads the parts of a key with their spans; returns them and the index behind the space after them."""
        names = []
        while True:
            quoted = text_end(self._text, position)
            end = quoted or self._after(_BARE, position)
            name = self._text[position:end]
            if quoted and "\\" in name:
                try:
                    name = next(iter(tomllib.loads(f"{name}=0")))
                except (ValueError, StopIteration):
                    raise _UnreadableError(end) from None
            elif quoted:
                name = name[1:-1]
            elif not name:
                raise _UnreadableError(position)
            names.append((name, self._span(position, end)))
            position = self._after(_SPACE, end)
            if not self._text.startswith(".", position):
                return names, position
            position = self._after(_SPACE, position + 1)

    def _expect(self, mark: str, position: int) -> int:
        if not self._text.startswith(mark, position):
            raise _UnreadableError(position)
        return position + len(mark)

    def _after(self, pattern: re.Pattern[str], position: int) -> int:
        """Returns the index behind the match of a pattern, which may be empty."""
        found = pattern.match(self._text, position)
        return found.end() if found else position

    def _span(self, start: int, end: int) -> TextSpan:
        line, end_line = (bisect_right(self._starts, index) for index in (start, end))
        return self._source.text_span(
            line, start - self._starts[line - 1] + 1, end_line, end - self._starts[end_line - 1] + 1
        )
