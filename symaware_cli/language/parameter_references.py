"""Replaces references `${parameters.name}` by the `parameters` of a document."""

import re
from collections.abc import Mapping

from symaware_cli.language.problem import MAX_PROBLEMS, nearest, quoted
from symaware_cli.language.source import (
    MAX_DEPTH,
    MAX_NODES,
    MappingEntry,
    Path,
    Source,
    SourceNode,
    report_depth,
    report_nodes,
)

# `$${` first, so that an escaped reference is never taken for one.
_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}]*)\}|\$\{")
_NAME = re.compile(r"\s*parameters((?:\.[^.\s]+)+)\s*")
_MAX_CHARACTERS = 1024 * 1024


class _Unresolved(Exception):  # noqa: N818 - the problem is already reported; this only unwinds the stack
    """A reference cannot be replaced."""


class _SubstitutionStopped(Exception):  # noqa: N818
    """Stops the substitution; the problem is already reported."""


def substitute(root: SourceNode, sources: Mapping[str, Source]) -> SourceNode:
    """Returns the document with all references replaced; adds a problem to its source for each that cannot be.

    A text that consists of one reference becomes the value itself, with its type and position. A reference
    inside a longer text is formatted into it. `$${` stands for `${`.
    """
    try:
        return _Substitution(root, sources).document()
    except _SubstitutionStopped:
        return root


class _Substitution:
    def __init__(self, root: SourceNode, sources: Mapping[str, Source]) -> None:
        self._root = root
        self._sources = sources
        self._parameters = SourceNode({}, root.span)
        self._resolved: dict[Path, SourceNode] = {}
        self._failed: set[Path] = set()
        self._open: list[Path] = []
        self._characters = 0

    def document(self) -> SourceNode:
        assert isinstance(self._root.value, dict)
        entries = dict(self._root.value)
        if "parameters" in entries:
            node = entries["parameters"].node
            if isinstance(node.value, dict):
                self._parameters = node
            elif node.value is not None:
                self._report("wrong-type", "`parameters` maps names to values", node, ("parameters",))
        for key, entry in entries.items():
            if key == "parameters" and entry.node is self._parameters:
                node = self._parameter((), entry.node)
            else:
                node = self._walk(entry.node, (key,))
            entries[key] = MappingEntry(entry.key, node)
        return SourceNode(entries, self._root.span)

    def _report(self, code: str, message: str, node: SourceNode, path: Path, **hints: str | None) -> None:
        source = self._sources[node.span.file]
        source.report(code, message, node.span, path, **hints)
        if len(source.problems) >= MAX_PROBLEMS:
            raise _SubstitutionStopped

    def _walk(self, node: SourceNode, path: Path) -> SourceNode:
        """Returns a value outside `parameters` with its references replaced, or unchanged if that fails."""
        if isinstance(node.value, dict):
            entries = {
                key: MappingEntry(entry.key, self._walk(entry.node, (*path, key))) for key, entry in node.value.items()
            }
            return self._checked(SourceNode(entries, node.span), path)
        if isinstance(node.value, list):
            items = [self._walk(child, (*path, index)) for index, child in enumerate(node.value)]
            return self._checked(SourceNode(items, node.span), path)
        try:
            return self._fill(node, path)
        except _Unresolved:
            return node

    def _checked(self, node: SourceNode, path: Path) -> SourceNode:
        """Returns a node if its depth and size after the replacement are within bounds."""
        if node.height > MAX_DEPTH:
            report_depth(self._sources[node.span.file], node.span, path)
            raise _SubstitutionStopped
        if node.size > MAX_NODES:
            report_nodes(self._sources[node.span.file], node.span, path)
            raise _SubstitutionStopped
        return node

    def _parameter(self, name: Path, node: SourceNode) -> SourceNode:
        """Returns the parameter with a name (below `parameters`) with its own references replaced."""
        if name in self._resolved:
            return self._resolved[name]
        path = ("parameters", *name)
        if name in self._failed:
            raise _Unresolved
        # The depth of the stack is the sum of the nesting and the chain of references.
        if len(self._open) > 2 * MAX_DEPTH:
            report_depth(self._sources[node.span.file], node.span, path)
            raise _SubstitutionStopped
        self._open.append(name)
        try:
            resolved = self._contents(name, node, path)
        except _Unresolved:
            self._failed.add(name)
            raise
        finally:
            self._open.pop()
        self._resolved[name] = resolved
        return resolved

    def _contents(self, name: Path, node: SourceNode, path: Path) -> SourceNode:
        if not isinstance(node.value, dict | list):
            return self._fill(node, path)
        # All children are processed even if one fails, so that each problem is reported.
        children = self._children(name, node)
        if isinstance(node.value, dict):
            entries = {key: MappingEntry(entry.key, children[key]) for key, entry in node.value.items()}
            return self._checked(SourceNode(entries, node.span), path)
        return self._checked(SourceNode(list(children.values()), node.span), path)

    def _children(self, name: Path, node: SourceNode) -> dict[str | int, SourceNode]:
        parts: dict[str | int, SourceNode]
        if isinstance(node.value, dict):
            parts = {key: entry.node for key, entry in node.value.items()}
        else:
            parts = dict(enumerate(node.children()))
        failed = False
        for key, child in parts.items():
            try:
                parts[key] = self._parameter((*name, key), child)
            except _Unresolved:
                failed = True
        if failed and name:
            raise _Unresolved
        return parts

    def _fill(self, node: SourceNode, path: Path) -> SourceNode:
        """Returns a scalar with its references replaced."""
        text = node.value
        if not isinstance(text, str) or "${" not in text:
            return node
        parts: list[str] = []
        position = 0
        failed = False
        for found in _REFERENCE.finditer(text):
            parts.append(text[position : found.start()])
            position = found.end()
            if found.group() == "$${":
                parts.append("${")
                continue
            try:
                value = self._value(found.group(1), node, path)
                if found.span() == (0, len(text)):
                    return value
                parts.append(self._formatted(value, found.group(), node, path))
            except _Unresolved:
                failed = True
        if failed:
            raise _Unresolved
        parts.append(text[position:])
        return SourceNode("".join(parts), node.span)

    def _value(self, reference: str | None, node: SourceNode, path: Path) -> SourceNode:
        """Returns the value of a reference."""
        found = _NAME.fullmatch(reference) if reference is not None else None
        if found is None:
            message = (
                "`${` has no `}`" if reference is None else f"{quoted('${' + (reference or '') + '}')} is no reference"
            )
            self._report("bad-reference", message, node, path, expected="${parameters.NAME}, or $${ for a plain ${")
            raise _Unresolved
        name = tuple(found.group(1)[1:].split("."))
        target = self._parameters
        for depth, part in enumerate(name):
            if not isinstance(target.value, dict) or part not in target.value:
                suggestion = nearest(part, target.value) if isinstance(target.value, dict) else None
                full = ".".join((*name[:depth], suggestion)) if suggestion else None
                message = f"there is no parameter {quoted('.'.join(name))}"
                self._report("undefined-parameter", message, node, path, suggestion=full)
                raise _Unresolved
            target = target.value[part].node
        if name in self._open:
            cycle = " -> ".join(".".join(map(str, each)) for each in [*self._open[self._open.index(name) :], name])
            self._report("cyclic-parameter", f"a parameter cannot refer to itself: {cycle}", node, path)
            raise _Unresolved
        return self._parameter(name, target)

    def _formatted(self, value: SourceNode, reference: str, node: SourceNode, path: Path) -> str:
        """Returns a value formatted for a longer text."""
        if isinstance(value.value, dict | list | None):
            kind = (
                "a mapping" if isinstance(value.value, dict) else "a list" if isinstance(value.value, list) else "null"
            )
            message = f"{quoted(reference)} is {kind}, which cannot be put inside a text"
            self._report("bad-reference", message, node, path)
            raise _Unresolved
        text = str(value.value).lower() if isinstance(value.value, bool) else str(value.value)
        # Parameters that repeat each other grow exponentially; so the total is bounded, not only each result.
        self._characters += len(text)
        if self._characters > _MAX_CHARACTERS:
            self._report("too-large", "the parameters expand to more than 1 MiB of text", node, path)
            raise _SubstitutionStopped
        return text
