"""Parses TOML into nodes: tomllib determines validity and values, tree-sitter the positions."""

import re
import tomllib
from bisect import bisect_right
from itertools import accumulate
from typing import Any, Final

import tree_sitter
import tree_sitter_toml

from symaware_cli.language.problem import MAX_PROBLEMS, TextSpan, quoted
from symaware_cli.language.source import (
    LARGE_NUMBER,
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
from symaware_cli.language.toml_syntax import excessive_nesting, report_syntax_error

_DATED: Final = {"local_date", "local_time", "local_date_time", "offset_date_time"}


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


class _SpanTable:
    """The spans of all keys and values of a TOML document.

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
        # The number of tables so far in each array of tables.
        self._arrays: dict[Path, int] = {}
        # Paths that must not be defined again: values, headers and tables created by dotted keys.
        self._final: dict[Path, TextSpan] = {}
        self._leaves: list[tuple[Path, str, tree_sitter.Node]] = []
        self._columns: dict[int, list[int]] = {}

    def walk(self) -> None:
        """Collects the spans from tree-sitter's tree."""
        language = tree_sitter.Language(tree_sitter_toml.language())
        # Bound to a name, because nodes do not keep their tree alive.
        tree = tree_sitter.Parser(language).parse(self._source.text.encode())
        for node in tree.root_node.named_children:
            if node.type == "pair":
                self._pair((), node)
            elif node.type == "table":
                self._table(node, is_array=False)
            elif node.type == "table_array_element":
                self._table(node, is_array=True)

    def report_leaves(self) -> None:
        """Reports bad numbers and dates of a document that tomllib rejects."""
        for path, kind, node in self._leaves:
            if len(self._source.problems) >= MAX_PROBLEMS:
                return
            try:
                text = (node.text or b"").decode()
                fault = scalar_fault(object() if kind in _DATED else tomllib.loads(f"x={text}")["x"])
            except ValueError:
                fault = LARGE_NUMBER if kind == "integer" else None
            if fault:
                self._source.report(fault.code, fault.message, self._span(node), path, expected=fault.expected)

    def _table(self, node: tree_sitter.Node, *, is_array: bool) -> None:
        children = node.named_children
        names = self._names(children[0]) if children else []
        if not names:
            return
        path: Path = ()
        for name, span in names[:-1]:
            path = self._current((*path, name))
            # The path of an array of tables ends with the index of its last table, so the name is one before.
            self._add_span(path if path[-1] == name else path[:-1], span)
        name, span = names[-1]
        path = (*path, name)
        if path in self._final and not (is_array and path in self._arrays):
            self.duplicates.append((path, span, self._final[path]))
            return
        self._final.setdefault(path, span)
        if is_array:
            self._add_span(path, span)
            index = self._arrays.get(path, 0)
            self._arrays[path] = index + 1
            path = (*path, index)
        # A header of its own is a better place than being named on the way to an inner table.
        self.keys[path] = self.values[path] = span
        for child in children[1:]:
            if child.type == "pair":
                self._pair(path, child)

    def _current(self, path: Path) -> Path:
        """Returns the path of the table that a name means now: in an array of tables, the last one."""
        return (*path, self._arrays[path] - 1) if path in self._arrays else path

    def _add_span(self, path: Path, span: TextSpan) -> None:
        self.keys.setdefault(path, span)
        self.values.setdefault(path, span)

    def _pair(self, table: Path, node: tree_sitter.Node) -> None:
        children = [child for child in node.named_children if child.type != "comment"]
        names = self._names(children[0]) if len(children) == 2 else []
        if not names or len(table) > MAX_DEPTH:
            return
        path = table
        for name, span in names[:-1]:
            path = (*path, name)
            self._add_span(path, span)
            self._final.setdefault(path, span)
        name, span = names[-1]
        path = (*path, name)
        if path in self.keys:
            self.duplicates.append((path, span, self.keys[path]))
            return
        self.keys[path] = self._final[path] = span
        self._value(path, children[1])

    def _value(self, path: Path, node: tree_sitter.Node) -> None:
        self.values[path] = self._span(node)
        if len(path) > MAX_DEPTH:
            return
        if node.type == "array":
            items = [child for child in node.named_children if child.type != "comment"]
            for index, child in enumerate(items):
                self._value((*path, index), child)
        elif node.type == "inline_table":
            for child in node.named_children:
                if child.type == "pair":
                    self._pair(path, child)
        elif node.type in ("integer", "float") or node.type in _DATED:
            self._leaves.append((path, node.type, node))

    def _names(self, node: tree_sitter.Node) -> list[tuple[str, TextSpan]]:
        """Returns the parts of a key with their spans; empty if it is not a key."""
        if node.type == "dotted_key":
            return [part for child in node.named_children for part in self._names(child)]
        text = (node.text or b"").decode()
        if node.type == "bare_key":
            return [(text, self._span(node))]
        if node.type == "quoted_key":
            if "\\" not in text:
                return [(text[1:-1], self._span(node))]
            try:
                return [(next(iter(tomllib.loads(f"{text}=0"))), self._span(node))]
            except (ValueError, StopIteration):
                return []
        return []

    def _span(self, node: tree_sitter.Node) -> TextSpan:
        start, end = node.start_point, node.end_point
        return self._source.text_span(
            start.row + 1, self._column(start.row, start.column), end.row + 1, self._column(end.row, end.column)
        )

    def _column(self, row: int, byte: int) -> int:
        """Returns the column in characters, from 1, of a byte offset in a line."""
        text = self._source.line_text(row + 1) or ""
        if text.isascii():
            return byte + 1
        starts = self._columns.get(row)
        if starts is None:
            # Cached for each line, for long lines with many values.
            starts = self._columns[row] = list(accumulate((len(character.encode()) for character in text), initial=0))
        return bisect_right(starts, byte)
