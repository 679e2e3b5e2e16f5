"""`path=value`: one value of a document replaced, from the command line, from Python or by a sweep.

Reasons: docs/decisions/0059-values-of-one-agent.md
"""

import re
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn, Self

from symaware_cli.language.plain_value import placed
from symaware_cli.language.problem import Problem, ScenarioError, TextSpan, dotted, nearest, quoted
from symaware_cli.language.source import (
    MAX_DEPTH,
    MappingEntry,
    Path,
    Source,
    SourceNode,
    decode,
    report_depth,
    scalar_fault,
)

#: Indices of elements of lists, as they stand behind a name.
_INDICES = re.compile(r"(?:\[\s*[0-9]{1,9}\s*\])*\s*", re.ASCII)

# Mappings whose keys are names chosen by the user: an unknown name is taken for a typing error.
_NAMED = ("agents", "components", "entities")

_Segments = Sequence[tuple[str | int, TextSpan]]


class Assignment:
    """A value for a path, with the position of each part; `str()` is its text, `path=value`.

    The value replaces the present value at the path; null removes it. Missing mappings along the path are created.

    Attributes:
        source: The pseudo file `--set path=value`, whose only line is the text, with its problems; or the file that
            contains the assignment.
        value: The value; null if it cannot be parsed.
    """

    def __init__(
        self, source: Source, segments: _Segments = (), value: SourceNode | None = None, *, keeps_null: bool = False
    ) -> None:
        """Takes the parts of an assignment; without segments it does nothing, for reasons in `source.problems`.

        With `keeps_null`, null is assigned like any other value instead of removing the present one.
        """
        self.source = source
        self.value = value or SourceNode(None, source.at(0))
        self._segments = segments
        self._keeps_null = keeps_null

    @classmethod
    def parse(cls, text: str, option: str = "--set", *, listed: bool = False) -> Self:
        """Parses the text of an option.

        Args:
            text: The text.
            option: The option, for messages.
            listed: Whether the value is a list whose elements are separated by commas, without its brackets; unless it
                is a single mapping, which is taken as it is.
        """
        source = decode(f"{option} {text}", text.encode("utf-8", errors="surrogateescape"))
        if source.problems:
            return cls(source)
        path, equals, value = source.text.partition("=")
        if not equals:
            line, several = len(source.lines[0]), ",value, path=first..last by step or path={uniform: [low, high]}"
            expected = f"path=value{several if listed else ''}"
            source.report("bad-set", f"there is no `=` in {quoted(text)}", _span(source, 0, line), expected=expected)
            return cls(source)
        segments = _segments(source, path)
        if source.problems:
            return cls(source)
        start, value = (len(path), f"[{value}]") if listed else (len(path) + 1, value)
        node = _parsed(source, start, value, tuple(name for name, _ in segments))
        match node.value:
            case [SourceNode(value=dict()) as only] if listed:
                node = only
        return cls(source, segments, node)

    @classmethod
    def of(cls, path: str, value: Any, option: str = "--set", *, listed: bool = False) -> Self:
        """Takes a Python value; positions are those in the text that would be typed for it, as `parse` describes it.

        Raises:
            TypeError: Scenarios have no such value.
        """
        start = len(path) + (0 if listed else 1)
        _, text = placed(value, Source(option, b""), start, (path,))
        text = f"{path}={text[1:-1] if listed else text}"
        source = Source(f"{option} {text}", b"", text)
        span = _span(source, 0, len(path))
        if fault := scalar_fault(path):
            source.report(fault.code, fault.message, span)
        if "=" in path:
            source.report("bad-set-path", f"there is a `=` in the path {quoted(path)}", span)
        segments = _segments(source, path)
        if source.problems:
            return cls(source)
        node, _ = placed(value, source, start, tuple(name for name, _ in segments))
        return cls(source, segments, node)

    @classmethod
    def at(cls, source: Source, path: str, span: TextSpan, value: SourceNode) -> Self:
        """Takes a path and a value from some file; problems of the path are left in `source.problems`."""
        return cls(source, _segments(source, path, span), value)

    def __str__(self) -> str:
        return self.source.text

    @property
    def path(self) -> Path:
        """The keys and indices of the path."""
        return tuple(segment for segment, _ in self._segments)

    def inside(self, *keys: str, own: int = 0) -> Self:
        """Returns the same for an entry of a mapping whose keys are paths, such as `over` of a sweep; null is kept.

        Args:
            keys: The keys of the mapping.
            own: How many further ones are the first segments of the path; the others are the key of the entry.
        """
        if not self._segments:
            return self
        names, rest = [*keys, *map(str, self.path[:own])], self.path[own:]
        first, last = self._segments[0][1], self._segments[-1][1]
        span = TextSpan(first.file, first.line, first.column, last.end_column)
        named = [(name, span) for name in (*names, dotted(rest)) if name]
        return type(self)(self.source, named, self.value, keeps_null=True)

    def without(self, place: int) -> Self:
        """Returns the same without one segment of the path."""
        segments = [*self._segments[:place], *self._segments[place + 1 :]]
        return type(self)(self.source, segments, self.value, keeps_null=self._keeps_null)

    def apply(self, root: SourceNode) -> SourceNode:
        """Returns a document with the value replaced.

        Raises:
            ScenarioError: The path does not fit the document.
        """
        if not self._segments:
            return root
        if self._segments[0][0] == "extends":
            self._refuse("`extends` cannot be set; files are merged before", self._segments[0][1])
        return self._replace(root, 0)

    def _replace(self, node: SourceNode, depth: int) -> SourceNode:
        """Returns a copy of a node with the rest of the path applied to it."""
        if depth == len(self._segments):
            return self.value
        name, span = self._segments[depth]
        if isinstance(node.value, list):
            return self._replace_item(node, node.value, depth)
        if isinstance(name, int):
            return self._replace_in_one(node, depth)
        if not isinstance(node.value, dict | None):
            message = f"{quoted(self._path_before(depth))} is a single value; there is nothing inside it"
            self._refuse(message, span, depth)
        if depth == 2 and self._segments[0][0] == "agents" and name.isascii() and name.isdecimal():
            before = self._path_before(depth)
            self._refuse(f"one agent of {quoted(before)} is named in brackets", span, depth, f"{before}[{name}]")
        # An empty value in a file (`with:`) is null, and taken for an empty mapping.
        entries = node.value or {}
        is_last = depth + 1 == len(self._segments)
        if name not in entries and not is_last and self._is_named(depth):
            message = f"there is no {quoted(name)} under {quoted(self._path_before(depth))}"
            expected = f"one of {', '.join(sorted(entries)[:20])}" if entries else None
            self._refuse(message, span, depth, expected, nearest(name, entries))
        if is_last and self.value.value is None and name in entries and not self._keeps_null:
            # As in a file that extends another, null removes the key.
            return SourceNode({key: entry for key, entry in entries.items() if key != name}, node.span)
        child = entries[name].node if name in entries else SourceNode({}, span)
        replaced = self._replace(child, depth + 1)
        return SourceNode(entries | {name: MappingEntry(span, replaced)}, node.span)

    def _replace_item(self, node: SourceNode, items: list[SourceNode], depth: int) -> SourceNode:
        name, span = self._segments[depth]
        before = self._path_before(depth)
        if not isinstance(name, int):
            if name.isascii() and name.isdecimal():
                message = f"an element of {quoted(before)} is named in brackets"
                self._refuse(message, span, depth, f"{before}[{name}]")
            message = f"{quoted(before)} is a list, and {quoted(name)} is not the index of one of its elements"
            self._refuse(message, span, depth, f"{before}[0] to {before}[{len(items) - 1}]" if items else None)
        if name >= len(items):
            message = f"{quoted(before)} has no element {name}"
            self._refuse(message, span, depth, f"0 to {len(items) - 1}" if items else None)
        replaced = self._replace(items[name], depth + 1)
        return SourceNode([*items[:name], replaced, *items[name + 1 :]], node.span)

    def _replace_in_one(self, node: SourceNode, depth: int) -> SourceNode:
        """Replaces a value of one agent of a group; otherwise, only lists have elements."""
        name, span = self._segments[depth]
        assert isinstance(name, int)
        group = node.value
        if depth != 2 or self._segments[0][0] != "agents" or not isinstance(group, dict):
            self._refuse(f"{quoted(self._path_before(depth))} is not a list, and has no element {name}", span, depth)
        count = group["count"].node.value if "count" in group else 1
        if isinstance(count, int) and not isinstance(count, bool) and name >= max(1, count):
            message = f"{quoted(str(self._segments[1][0]))} has no agent {name}"
            self._refuse(message, span, depth, f"0 to {count - 1}" if count > 1 else "0")
        parts = [part for part, _ in self._segments[depth + 1 :]]
        if parts[:1] == ["components"] and parts[2:3] == ["with"] and len(parts) > 3:
            return self._replace_parameter(node, depth, name if "count" in group else None)
        last = depth + (3 if parts[:1] == ["knowledge"] else 2)
        own = parts[: last - depth - 1]
        if len(self._segments) < last or own[0] not in ("state", "knowledge") or not isinstance(own[-1], str):
            where = self._path_before(depth)
            told = dotted(parts) or "agents"
            message = f"{quoted(told)} is one for all agents of {quoted(str(self._segments[1][0]))}"
            one = f"{where}[{name}]"
            expected = (
                f"{one}.state, {one}.knowledge.NAME or {one}.components.NAME.with.PARAMETER, which may differ among "
                f"its agents; for all of them {where}.{told}; or agents that differ in more as a group of their own"
            )
            self._refuse(message, self._segments[min(depth + 1, len(self._segments) - 1)][1], depth, expected)
        # An agent without a number in its id is the only one, and its value is its own.
        return self._replaced_at(node, own, name if "count" in group else None, last)

    def _replace_parameter(self, node: SourceNode, depth: int, row: int | None) -> SourceNode:
        """Replaces a parameter of one agent's component, beside those that the others have."""
        group: Any = node.value
        key, (name, span) = self._segments[depth + 1][0], self._segments[depth + 2]
        components = group[key].node if key in group else SourceNode({}, span)
        named = components.value if isinstance(components.value, dict) else {}
        if name not in named:
            message = f"there is no {quoted(str(name))} under {quoted(f'{self._path_before(depth)}.{key}')}"
            expected = f"one of {', '.join(sorted(named)[:20])}" if named else None
            self._refuse(message, span, depth + 2, expected, nearest(str(name), named))
        component = named[str(name)].node
        if row is None:
            replaced = self._replace(component, depth + 3)
        else:
            replaced = self._with_own(component, depth + 4, str(row))
        components = SourceNode({**named, str(name): MappingEntry(named[str(name)].key, replaced)}, components.span)
        return SourceNode({**group, str(key): MappingEntry(group[key].key, components)}, node.span)

    def _with_own(self, component: SourceNode, depth: int, row: str) -> SourceNode:
        """Returns the section of a component with a parameter of one agent, initially equal to that of the others."""
        entries = component.value if isinstance(component.value, dict) else {}
        parameter, span = self._segments[depth]
        if not isinstance(parameter, str):
            self._refuse("a parameter has a name", span, depth)
        own = _entries(entries.get("own"))
        given, common = _entries(own.get(row)), _entries(entries.get("with"))
        present = given.get(parameter) or common.get(parameter)
        replaced = self._replace(present.node if present else SourceNode(None, span), depth + 1)
        changed = SourceNode({**given, parameter: MappingEntry(span, replaced)}, span)
        whole = SourceNode({**own, row: MappingEntry(span, changed)}, span)
        return SourceNode({**entries, "own": MappingEntry(span, whole)}, component.span)

    def _replaced_at(self, node: SourceNode, keys: list[str | int], row: int | None, depth: int) -> SourceNode:
        """Replaces the value of an agent under some keys of its group."""
        if not keys:
            return self._replace(node, depth) if row is None else self._replace_own(node, row, depth)
        entries = node.value if isinstance(node.value, dict) else {}
        key, span = str(keys[0]), self._segments[depth - len(keys)][1]
        child = entries[key].node if key in entries else SourceNode(None, span)
        replaced = self._replaced_at(child, keys[1:], row, depth)
        return SourceNode({**entries, key: MappingEntry(span, replaced)}, node.span)

    def _replace_own(self, node: SourceNode, row: int, depth: int) -> SourceNode:
        """Replaces the value of one agent: in a list for each, or beside the value that the others have."""
        value = node.value
        if isinstance(value, list) and any(isinstance(each.value, list) for each in value) and row < len(value):
            return SourceNode([*value[:row], self._replace(value[row], depth), *value[row + 1 :]], node.span)
        items = value["each"].node.value if isinstance(value, dict) and set(value) == {"each"} else None
        if isinstance(value, dict) and isinstance(items, list) and row < len(items):
            each = [*items[:row], self._replace(items[row], depth), *items[row + 1 :]]
            listed = SourceNode(each, value["each"].node.span)
            return SourceNode({"each": MappingEntry(value["each"].key, listed)}, node.span)
        owns: dict[str, MappingEntry] = {}
        rest = node
        if isinstance(value, dict) and set(value) == {"own", "rest"} and isinstance(value["own"].node.value, dict):
            owns, rest = value["own"].node.value, value["rest"].node
        span = self._segments[depth - 1][1]
        replaced = self._replace(owns[str(row)].node if str(row) in owns else rest, depth)
        own = SourceNode({**owns, str(row): MappingEntry(span, replaced)}, self.value.span)
        return SourceNode({"own": MappingEntry(span, own), "rest": MappingEntry(span, rest)}, node.span)

    def _is_named(self, depth: int) -> bool:
        """Returns whether a segment names something under a mapping of names."""
        return depth > 0 and self._segments[depth - 1][0] in _NAMED and self._segments[0][0] != "parameters"

    def _path_before(self, depth: int) -> str:
        return dotted(segment for segment, _ in self._segments[:depth])

    def _refuse(
        self, message: str, span: TextSpan, depth: int = 0, expected: str | None = None, suggestion: str | None = None
    ) -> NoReturn:
        path, line = dotted(self.path[: depth + 1]), self.source.line_text(span.line)
        raise ScenarioError([Problem("bad-set-path", message, span, path, expected, suggestion, line)])


def _entries(entry: MappingEntry | None) -> dict[str, MappingEntry]:
    """Returns the entries of a mapping; none if it is something else, which is reported elsewhere."""
    return entry.node.value if entry is not None and isinstance(entry.node.value, dict) else {}


def assigned(root: SourceNode, assignments: Iterable[Assignment], sources: dict[str, Source]) -> SourceNode:
    """Returns a document with assignments applied one after the other; adds problems to their `sources`."""
    for each in assignments:
        try:
            root = each.apply(root)
        except ScenarioError as error:
            sources[each.source.name].problems += error.problems
    return root


def _span(source: Source, start: int, end: int) -> TextSpan:
    return source.text_span(1, start + 1, 1, end + 1)


def _segments(source: Source, path: str, span: TextSpan | None = None) -> _Segments:
    """Parses names between dots, each with indices in brackets; `span` is the place of all, by default the text."""
    if "\n" in path or "\r" in path:
        source.report("bad-set-path", "a path is one line", span or _span(source, 0, len(source.lines[0])))
        return ()
    segments: list[tuple[str | int, TextSpan]] = []
    start = 0
    for text in path.split("."):
        name = text.partition("[")[0]
        stripped, indices, begin = name.strip(), text[len(name) :], start + len(name)
        if not stripped:
            message = "a path has a name between its dots, and no dot at its ends"
            source.report("bad-set-path", message, span or _span(source, start, start + len(text)))
        segments.append((stripped, span or _span(source, start, begin)))
        if not _INDICES.fullmatch(indices):
            message, expected = (
                "an element of a list is written in brackets after its name",
                "an index from 0 on, such as",
            )
            here = span or _span(source, begin, start + len(text))
            source.report("bad-set-path", message, here, expected=f"{expected} goal[1]")
            indices = ""
        segments += (
            (int(found[1]), span or _span(source, begin + found.start(), begin + found.end()))
            for found in re.finditer(r"\[\s*(\d+)\s*\]", indices)
        )
        start += len(text) + 1
    if len(segments) > MAX_DEPTH:
        report_depth(source, span or _span(source, 0, len(path)))
    return segments


def _parsed(source: Source, start: int, text: str, path: Path) -> SourceNode:
    """Parses a value whose text begins at an index of its line."""
    # Imported here because most runs have no such text, and a TOML scenario then needs no YAML parser.
    from symaware_cli.language.yaml_source import parse_yaml

    # The path is replaced by blanks, so that columns are those that the user typed.
    blank = Source(source.name, b"", " " * start + text)
    parse_yaml(blank)
    for each in blank.problems:
        source.report(each.code, each.message, each.span, path, expected=each.expected, suggestion=each.suggestion)
    return blank.root or SourceNode(None, _span(source, start, start + 1))
