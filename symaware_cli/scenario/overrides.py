"""`--set path=value`: one value of the document replaced from the command line."""

from typing import Self

from symaware_cli.scenario.problem import TextSpan, nearest, quoted
from symaware_cli.scenario.source import MAX_DEPTH, MappingEntry, Path, Source, SourceNode, decode, report_depth

# Mappings whose keys are names chosen by the user: an unknown name is taken for a typing error.
_NAMED = ("agents", "components", "entities")


class Override:
    """One `path=value`, with the position of each segment and of the value.

    Attributes:
        source: The pseudo file `--set path=value`, whose only line is the text.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self._segments: list[tuple[str, TextSpan]] = []
        self._value = SourceNode(None, self._text_span(0, len(source.text)))

    @classmethod
    def of(cls, source: Source, path: str, span: TextSpan, value: SourceNode) -> Self:
        """Takes a path and a value that stand in some file; what is wrong with them is left in `source.problems`."""
        override = cls(source)
        override._segments = [(name.strip(), span) for name in path.split(".")]
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

    def _parse_path(self, path: str) -> None:
        start = 0
        for segment in path.split("."):
            end = start + len(segment)
            name = segment.strip()
            if not name:
                message = "a path has a name between its dots, and no dot at its ends"
                self.source.report("bad-set-path", message, self._text_span(start, end))
            self._segments.append((name, self._text_span(start, end)))
            start = end + 1
        if len(self._segments) > MAX_DEPTH:
            report_depth(self.source, self._text_span(0, len(path)))

    def _parse_value(self, start: int, value: str) -> None:
        # Imported here because most runs have no override, and a TOML scenario then needs no YAML parser.
        from symaware_cli.scenario.yaml_source import parse_yaml

        # The path is replaced by blanks, so that columns are those that the user typed.
        blank = Source(self.source.name, b"", " " * start + value)
        parse_yaml(blank)
        self._value = blank.root or SourceNode(None, self._text_span(start, start + 1))
        for problem in blank.problems:
            self.source.report(
                problem.code,
                problem.message,
                problem.span,
                self._path(),
                expected=problem.expected,
                suggestion=problem.suggestion,
            )

    def _path(self) -> Path:
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
        if not isinstance(node.value, dict | None):
            message = f"{quoted(self._path_before(depth))} is a single value; there is nothing inside it"
            self._refuse(message, span, depth)
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
        # isascii(), because isdecimal() also accepts the digits of other scripts.
        index = int(name) if name.isascii() and name.isdecimal() and len(name) < 10 else len(items)
        if index >= len(items):
            message = f"{quoted(name)} is not the index of an item of {quoted(self._path_before(depth))}"
            expected = f"0 to {len(items) - 1}" if items else None
            self._refuse(message, span, depth, expected)
            return node
        replaced = self._replace(items[index], depth + 1)
        return SourceNode([*items[:index], replaced, *items[index + 1 :]], node.span)

    def _is_named(self, depth: int) -> bool:
        """Returns whether a segment names something under a mapping of names."""
        return depth > 0 and self._segments[depth - 1][0] in _NAMED and self._segments[0][0] != "parameters"

    def _path_before(self, depth: int) -> str:
        return ".".join(segment for segment, _ in self._segments[:depth])

    def _refuse(
        self, message: str, span: TextSpan, depth: int, expected: str | None = None, suggestion: str | None = None
    ) -> None:
        path = self._path()[: depth + 1]
        self.source.report("bad-set-path", message, span, path, expected=expected, suggestion=suggestion)
