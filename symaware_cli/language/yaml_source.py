"""Parses YAML into nodes: the core schema of YAML 1.2, without tags that create objects and without recursion.

The tree is built from PyYAML's events, because its own loaders follow YAML 1.1 (where `no` is false and `1:30` is
ninety), discard positions, accept duplicate keys, and recurse.

Reasons: docs/decisions/0004-yaml-1.2-and-merge-patch.md
"""

import re
from collections.abc import Callable
from typing import Final

import yaml

from symaware_cli.language.problem import MAX_PROBLEMS, TextSpan, nearest, quoted
from symaware_cli.language.source import (
    MAX_DEPTH,
    MAX_NODES,
    MappingEntry,
    Scalar,
    Source,
    SourceNode,
    report_depth,
    report_nodes,
    scalar_fault,
)
from symaware_cli.language.yaml_syntax import report_syntax_error

_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_CORE = "tag:yaml.org,2002:"
_SCALAR_TYPES: Final[dict[str, tuple[type, ...]]] = {
    _CORE + "null": (type(None),),
    _CORE + "bool": (bool,),
    _CORE + "int": (int,),
    _CORE + "float": (float, int),
}
_KNOWN_TAGS: Final = {*_SCALAR_TYPES, _CORE + "str", _CORE + "map", _CORE + "seq"}
_WORDS: Final[dict[str, Scalar]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")


def parse_yaml(source: Source, plain: Callable[[str], Scalar] | None = None) -> None:
    """Fills in `source.root` and `source.problems` from YAML text.

    Args:
        source: The text.
        plain: Returns the value of an unquoted scalar; by default that in the core schema of YAML 1.2.
    """
    builder = _YamlNodeBuilder(source, plain or plain_scalar)
    try:
        for event in yaml.parse(source.text, Loader=_LOADER):
            builder.handle(event)
    except _ReadingStopped:
        pass
    except yaml.YAMLError as error:
        report_syntax_error(source, error)
    source.root = builder.root


def plain_scalar(text: str) -> Scalar:
    """Returns the value of an unquoted scalar in the core schema of YAML 1.2."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        # int() rejects thousands of digits; such numbers are out of range anyway.
        return 2**64 if len(text.lstrip("+-0ox")) > 24 else int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    if _FLOAT.fullmatch(text):
        return float(text)
    if _NOT_FINITE.fullmatch(text):
        return float(text.lower().replace(".", ""))
    return text


def name_scalar(text: str) -> Scalar:
    """Returns an unquoted scalar as it is written, or None for null: names may look like numbers or truth values."""
    return None if text in _WORDS and _WORDS[text] is None else text


class _ReadingStopped(Exception):  # noqa: N818 - the problem itself is already reported
    """Stops the reading of the document."""


class _Frame:
    """A mapping or list that is not closed yet."""

    __slots__ = ("anchor", "entries", "is_flow", "is_mapping", "items", "key", "merged", "span")

    def __init__(self, is_mapping: bool, is_flow: bool, span: TextSpan, anchor: str | None) -> None:
        self.is_mapping = is_mapping
        self.is_flow = is_flow
        self.span = span
        self.anchor = anchor
        self.items: list[SourceNode] = []
        self.entries: dict[str, MappingEntry] = {}
        self.merged: list[SourceNode] = []
        self.key: tuple[str | None, TextSpan] | None = None

    def place(self) -> str | int | None:
        """Returns the path segment of the present value."""
        if self.is_mapping:
            return self.key[0] if self.key else None
        return len(self.items)


class _YamlNodeBuilder:
    """Builds nodes from parser events, with an explicit stack."""

    def __init__(self, source: Source, plain: Callable[[str], Scalar]) -> None:
        self.root: SourceNode | None = None
        self._plain = plain
        self._source = source
        self._stack: list[_Frame] = []
        # None for an anchor whose value is not complete yet.
        self._anchors: dict[str, SourceNode | None] = {}
        self._nodes = 0
        self._documents = 0

    def handle(self, event: yaml.Event) -> None:
        """Processes the next event of the document."""
        if isinstance(event, yaml.ScalarEvent):
            self._scalar(event)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._open(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._close(event)
        elif isinstance(event, yaml.AliasEvent):
            self._alias(event)
        elif isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                message = "a second document starts here; a scenario file holds one"
                self._stop("several-documents", message, self._span(event))

    def _path(self) -> list[str | int]:
        return [place for frame in self._stack if (place := frame.place()) is not None]

    def _span(self, event: yaml.Event) -> TextSpan:
        start, end = event.start_mark, event.end_mark
        assert start is not None
        assert end is not None
        return self._source.text_span(start.line + 1, start.column + 1, end.line + 1, end.column + 1)

    def _report(self, code: str, message: str, span: TextSpan, **hints: str | None) -> None:
        self._source.report(code, message, span, self._path(), **hints)
        if len(self._source.problems) >= MAX_PROBLEMS:
            raise _ReadingStopped

    def _stop(self, code: str, message: str, span: TextSpan) -> None:
        self._report(code, message, span)
        raise _ReadingStopped

    def _scalar(self, event: yaml.ScalarEvent) -> None:
        span = self._span(event)
        is_plain = event.implicit[0] and event.tag is None
        frame = self._stack[-1] if self._stack else None
        if is_plain and event.value == "<<" and frame and frame.is_mapping and frame.key is None:
            self._count(1, span)
            frame.key = (None, span)
            return
        if not self._stack and is_plain and event.value == "":
            # Only comments, or a lone `---`: an empty file, unlike one that contains null.
            return
        value: Scalar = event.value
        if event.tag is not None:
            value = self._tagged(event, event.tag, span)
        elif is_plain:
            value = self._plain(event.value)
        fault = scalar_fault(value)
        if fault:
            self._report(fault.code, fault.message, span, expected=fault.expected)
            value = None
        self._anchor_and_add(SourceNode(value, span), event.anchor)

    def _tagged(self, event: yaml.ScalarEvent, tag: str, span: TextSpan) -> Scalar:
        """Returns the value of a scalar with a tag."""
        text: str = event.value
        if tag == _CORE + "str":
            return text
        types = _SCALAR_TYPES.get(tag)
        if types is None:
            self._refuse_tag(tag, span)
            return text
        value = plain_scalar(text)
        # isinstance() would accept a bool as an int.
        if type(value) not in types:
            self._report("wrong-tag", f"{quoted(text)} is not what its tag says", span)
            return text
        return float(value) if tag == _CORE + "float" and isinstance(value, int) else value

    def _refuse_tag(self, tag: str, span: TextSpan) -> None:
        """Reports a tag that is not allowed, or not on this kind of value."""
        line = self._source.line_text(span.line) or ""
        written = re.compile(r"![^\s,\[\]{}]*").search(line, span.column - 1)
        if written:
            span = TextSpan(span.file, span.line, written.start() + 1, written.end() + 1)
        name = quoted(written.group() if written else tag)
        if tag in _KNOWN_TAGS:
            self._report("wrong-tag", f"the tag {name} does not fit this value", span)
        else:
            self._report("tag-not-allowed", f"the tag {name} is not allowed: a scenario is data, never code", span)

    def _open(self, event: yaml.CollectionStartEvent) -> None:
        span = self._span(event)
        is_mapping = isinstance(event, yaml.MappingStartEvent)
        if event.tag not in (None, _CORE + ("map" if is_mapping else "seq")):
            self._refuse_tag(event.tag, span)
        if len(self._stack) >= MAX_DEPTH:
            report_depth(self._source, span, self._path())
            raise _ReadingStopped
        if event.anchor is not None:
            self._anchors[event.anchor] = None
        self._stack.append(_Frame(is_mapping, bool(event.flow_style), span, event.anchor))

    def _close(self, event: yaml.CollectionEndEvent) -> None:
        frame = self._stack.pop()
        span = frame.span
        if frame.is_flow:
            # The start event has only the span of the opening bracket.
            end = self._span(event)
            span = self._source.text_span(span.line, span.column, end.line, end.end_column)
        if not frame.is_mapping:
            self._anchor_and_add(SourceNode(frame.items, span), frame.anchor)
            return
        entries: dict[str, MappingEntry] = {}
        # The first of several merged mappings takes precedence, and the mapping's own keys over all of them.
        for merged in reversed(frame.merged):
            if isinstance(merged.value, dict):
                entries |= merged.value
        entries |= frame.entries
        self._anchor_and_add(SourceNode(entries, span), frame.anchor)

    def _alias(self, event: yaml.AliasEvent) -> None:
        span = self._span(event)
        name = event.anchor or ""
        if name not in self._anchors:
            anchors = sorted(self._anchors)
            self._report(
                "undefined-alias", f"no anchor &{name} comes before *{name}", span, suggestion=nearest(name, anchors)
            )
            node: SourceNode | None = SourceNode(None, span)
        else:
            node = self._anchors[name]
            if node is None:
                self._report("cyclic-alias", f"the alias *{name} is inside the value it stands for", span)
                node = SourceNode(None, span)
        assert node is not None
        if node.height + len(self._stack) > MAX_DEPTH:
            report_depth(self._source, span, self._path())
            raise _ReadingStopped
        # The children keep their positions; only the value itself has that of the alias.
        self._add(SourceNode(node.value, span), node.size)

    def _anchor_and_add(self, node: SourceNode, anchor: str | None) -> None:
        if anchor is not None:
            self._anchors[anchor] = node
        self._add(node, node.size if not isinstance(node.value, dict | list) else 1)

    def _count(self, nodes: int, span: TextSpan) -> None:
        self._nodes += nodes
        if self._nodes > MAX_NODES:
            report_nodes(self._source, span, self._path())
            raise _ReadingStopped

    def _add(self, node: SourceNode, nodes: int) -> None:
        """Adds a complete value to the present list or mapping, or uses it as the next key."""
        self._count(nodes, node.span)
        if not self._stack:
            self.root = node
            return
        frame = self._stack[-1]
        if not frame.is_mapping:
            frame.items.append(node)
        elif frame.key is None:
            self._add_key(frame, node)
        else:
            self._add_value(frame, node)

    def _add_key(self, frame: _Frame, node: SourceNode) -> None:
        key = node.value
        if isinstance(key, int) and not isinstance(key, bool) and self._text_of(node) == str(key):
            # The number of an agent; in TOML, such a key is a text.
            key = str(key)
        if isinstance(key, str):
            first = frame.entries.get(key)
            # The key is set first, so that the path of the problem ends with it.
            frame.key = (key, node.span)
            if first is not None:
                message = f"the key {quoted(key)} is already on line {first.key.line}"
                self._report("duplicate-key", message, node.span)
            return
        frame.key = ("", node.span)
        if isinstance(node.value, dict | list):
            self._report("key-not-text", "a list or a mapping cannot be a key", node.span, expected="a text")
        else:
            written = self._text_of(node)
            hint = f'"{written}"' if 0 < len(written) <= 30 else "a text"
            self._report("key-not-text", "keys must be text", node.span, expected=hint)

    def _text_of(self, node: SourceNode) -> str:
        """A scalar as it is written."""
        return self._source.lines[node.span.line - 1][node.span.column - 1 : node.span.end_column - 1].strip()

    def _add_value(self, frame: _Frame, node: SourceNode) -> None:
        assert frame.key is not None
        key, span = frame.key
        if key is None:
            self._merge(frame, node)
        elif key not in frame.entries:
            frame.entries[key] = MappingEntry(span, node)
        frame.key = None

    def _merge(self, frame: _Frame, node: SourceNode) -> None:
        merged = node.value if isinstance(node.value, list) else [node]
        for each in merged:
            if not isinstance(each.value, dict):
                self._report("bad-merge", "`<<` takes a mapping or a list of mappings", each.span)
                return
        frame.merged += merged
