"""`--set path=value`: one value of the document replaced from the command line.

Reasons: docs/decisions/0059-values-of-one-agent.md
"""

import re
from typing import Self

from symaware_cli.language.problem import TextSpan, dotted, nearest, quoted
from symaware_cli.language.source import MAX_DEPTH, MappingEntry, Path, Source, SourceNode, decode, report_depth

#: Indices of elements of lists, as they stand behind a name.
_INDICES = re.compile(r"(?:\[\s*[0-9]{1,9}\s*\])*\s*", re.ASCII)

# Mappings whose keys are names chosen by the user: an unknown name is taken for a typing error.
_NAMED = ("agents", "components", "entities")


class Override:
    """One `path=value`, with the position of each segment and of the value.

    Attributes:
        source: The pseudo file `--set path=value`, whose only line is the text.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self._segments: list[tuple[str | int, TextSpan]] = []
        self._value = SourceNode(None, self._text_span(0, len(source.text)))

    @classmethod
    def of(cls, source: Source, path: str, span: TextSpan, value: SourceNode) -> Self:
        """Takes a path and a value that stand in some file; what is wrong with them is left in `source.problems`."""
        override = cls(source)
        override._parse_path(path, span)
        override._value = value
        return override

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parses the text; adds problems to `source.problems`."""
        source = decode(f"--set {text}", text.encode("utf-8", errors="surrogateescape"))
        override = cls(source)
        if source.problems:
            return override
        path, equals, value = source.text.partition("=")
        first_line = override._text_span(0, len(source.lines[0]))
        if not equals:
            source.report("bad-set", f"there is no `=` in {quoted(text)}", first_line, expected="path=value")
            return override
        if "\n" in path or "\r" in path:
            source.report("bad-set-path", "a path is one line", first_line)
            return override
        override._parse_path(path)
        if not source.problems:
            override._parse_value(len(path) + 1, value)
        return override

    def _text_span(self, start: int, end: int) -> TextSpan:
        return self.source.text_span(1, start + 1, 1, end + 1)

    def _parse_path(self, path: str, span: TextSpan | None = None) -> None:
        """Parse names between dots, each with indices in brackets; `span` is the place of all, by default the text."""
        start = 0
        for text in path.split("."):
            name = text.partition("[")[0]
            stripped = name.strip()
            if not stripped:
                message = "a path has a name between its dots, and no dot at its ends"
                self.source.report("bad-set-path", message, span or self._text_span(start, start + len(text)))
            self._segments.append((stripped, span or self._text_span(start, start + len(name))))
            self._parse_indices(text[len(name) :], start + len(name), span)
            start += len(text) + 1
        if len(self._segments) > MAX_DEPTH:
            report_depth(self.source, span or self._text_span(0, len(path)))

    def _parse_indices(self, text: str, start: int, span: TextSpan | None) -> None:
        if not _INDICES.fullmatch(text):
            message = "an element of a list stands in brackets behind its name"
            here = span or self._text_span(start, start + len(text))
            self.source.report("bad-set-path", message, here, expected="an index from 0 on, such as goal[1]")
            return
        for found in re.finditer(r"\[\s*(\d+)\s*\]", text):
            here = span or self._text_span(start + found.start(), start + found.end())
            self._segments.append((int(found[1]), here))

    def _parse_value(self, start: int, value: str) -> None:
        # Imported here because most runs have no override, and a TOML scenario then needs no YAML parser.
        from symaware_cli.language.yaml_source import parse_yaml

        # The path is replaced by blanks, so that columns are those that the user typed.
        blank = Source(self.source.name, b"", " " * start + value)
        parse_yaml(blank)
        self._value = blank.root or SourceNode(None, self._text_span(start, start + 1))
        for problem in blank.problems:
            self.source.report(
                problem.code,
                problem.message,
                problem.span,
                self.path,
                expected=problem.expected,
                suggestion=problem.suggestion,
            )

    @property
    def path(self) -> Path:
        """The keys and indices of the path."""
        return tuple(segment for segment, _ in self._segments)

    def apply(self, root: SourceNode) -> SourceNode:
        """Returns the document with the value replaced; adds problems to `source.problems`."""
        if not self._segments:
            # The text could not be parsed, which is already reported.
            return root
        if self._segments[0][0] == "extends":
            message = "`extends` cannot be set; files are merged before"
            self.source.report("bad-set-path", message, self._segments[0][1], ("extends",))
            return root
        return self._replace(root, 0)

    def _replace(self, node: SourceNode, depth: int) -> SourceNode:
        """Returns a copy of a node with the rest of the path applied to it; the node itself if there is a problem."""
        if depth == len(self._segments):
            return self._value
        name, span = self._segments[depth]
        if isinstance(node.value, list):
            return self._replace_item(node, node.value, depth)
        if isinstance(name, int):
            return self._replace_in_one(node, depth)
        if not isinstance(node.value, dict | None):
            message = f"{quoted(self._path_before(depth))} is a single value; there is nothing inside it"
            self._refuse(message, span, depth)
            return node
        if depth == 2 and self._segments[0][0] == "agents" and name.isascii() and name.isdecimal():
            before = self._path_before(depth)
            self._refuse(f"one agent of {quoted(before)} is named in brackets", span, depth, f"{before}[{name}]")
            return node
        # An empty value in a file (`with:`) is null, and taken for an empty mapping.
        entries = node.value or {}
        is_last = depth + 1 == len(self._segments)
        if name not in entries and not is_last and self._is_named(depth):
            message = f"there is no {quoted(name)} under {quoted(self._path_before(depth))}"
            expected = f"one of {', '.join(sorted(entries)[:20])}" if entries else None
            self._refuse(message, span, depth, expected, nearest(name, entries))
            return node
        if is_last and self._value.value is None and name in entries:
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
                return node
            message = f"{quoted(before)} is a list, and {quoted(name)} is not the index of one of its elements"
            self._refuse(message, span, depth, f"{before}[0] to {before}[{len(items) - 1}]" if items else None)
            return node
        if name >= len(items):
            message = f"{quoted(before)} has no element {name}"
            self._refuse(message, span, depth, f"0 to {len(items) - 1}" if items else None)
            return node
        replaced = self._replace(items[name], depth + 1)
        return SourceNode([*items[:name], replaced, *items[name + 1 :]], node.span)

    def _replace_in_one(self, node: SourceNode, depth: int) -> SourceNode:
        """Replaces something of one agent of a group; nothing else but lists has elements."""
        name, span = self._segments[depth]
        assert isinstance(name, int)
        group = node.value
        if depth != 2 or self._segments[0][0] != "agents" or not isinstance(group, dict):
            self._refuse(f"{quoted(self._path_before(depth))} is not a list, and has no element {name}", span, depth)
            return node
        count = group["count"].node.value if "count" in group else 1
        if isinstance(count, int) and not isinstance(count, bool) and name >= max(1, count):
            message = f"{quoted(str(self._segments[1][0]))} has no agent {name}"
            self._refuse(message, span, depth, f"0 to {count - 1}" if count > 1 else "0")
            return node
        last = depth + (3 if len(self._segments) > depth + 1 and self._segments[depth + 1][0] == "knowledge" else 2)
        own = [part for part, _ in self._segments[depth + 1 : last]]
        if len(self._segments) < last or own[0] not in ("state", "knowledge") or not isinstance(own[-1], str):
            where = self._path_before(depth)
            told = dotted([part for part, _ in self._segments[depth + 1 :]]) or "agents"
            message = f"{quoted(told)} is one for all agents of {quoted(str(self._segments[1][0]))}"
            expected = (
                f"{where}[{name}].state or {where}[{name}].knowledge.NAME, which may differ among its agents; for all "
                f"of them {where}.{told}; or agents that differ in more as a group of their own"
            )
            self._refuse(message, self._segments[min(depth + 1, len(self._segments) - 1)][1], depth, expected)
            return node
        # An agent without a number in its id is the only one, and its value is its own.
        return self._replaced_at(node, own, name if "count" in group else None, last)

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
        own = SourceNode({**owns, str(row): MappingEntry(span, replaced)}, self._value.span)
        return SourceNode({"own": MappingEntry(span, own), "rest": MappingEntry(span, rest)}, node.span)

    def _is_named(self, depth: int) -> bool:
        """Returns whether a segment names something under a mapping of names."""
        return depth > 0 and self._segments[depth - 1][0] in _NAMED and self._segments[0][0] != "parameters"

    def _path_before(self, depth: int) -> str:
        return dotted(segment for segment, _ in self._segments[:depth])

    def _refuse(
        self, message: str, span: TextSpan, depth: int, expected: str | None = None, suggestion: str | None = None
    ) -> None:
        path = self.path[: depth + 1]
        self.source.report("bad-set-path", message, span, path, expected=expected, suggestion=suggestion)
