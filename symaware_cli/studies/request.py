"""Requests for sweeps from the command line or Python, converted to the same tree as the file of a sweep."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from symaware_cli.language import MappingEntry, Source, SourceNode, TextSpan, decode, quoted, texts
from symaware_cli.studies.sweep_document import is_range


@dataclass(frozen=True, slots=True)
class SweepRequest:
    """Options of a sweep; those that are None or empty leave the value of the file unchanged.

    Attributes:
        over: The varied parameters, as ``path=value,value``, ``path=first..last by step`` or ``path={uniform: [low,
            high]}``.
        set: The changes to all runs, as ``path=value``.
        variants: The names of variants, each with its changes as ``path=value; path=value``.
        options: Further entries of the document by their keys, as text.
        entries: Further entries, as ``key=value`` or ``key.name=value``.
    """

    over: Sequence[str] = ()
    set: Sequence[str] = ()
    variants: Sequence[tuple[str, str]] = ()
    options: Mapping[str, str] | None = None
    entries: Sequence[str] = ()

    def overlays(self) -> Iterator[tuple[Source, SourceNode | None]]:
        """Yield each option as a pseudo source file with its tree; the tree is None if the option is invalid."""
        for text in self.over:
            yield _assigned("--over", text, ("over",), as_list=True)
        for text in self.set:
            yield _assigned("--set", text, ("set",))
        for name, text in self.variants:
            yield _variant(name, text)
        for key, text in (self.options or {}).items():
            yield _option(key, text)
        for text in self.entries:
            yield _assigned("--with", text, None)


def _option(key: str, text: str) -> tuple[Source, SourceNode | None]:
    source = decode(
        f"--{key}" if key in ("runs", "seed") else f"--with {key}={text}",
        text.encode("utf-8", errors="surrogateescape"),
    )
    value = None if source.problems else _value(source, 0, source.text)
    return source, None if value is None else _nested((key,), source.at(0), value)


def _assigned(
    option: str, text: str, inside: tuple[str, ...] | None, *, as_list: bool = False
) -> tuple[Source, SourceNode | None]:
    source = decode(f"{option} {text}", text.encode("utf-8", errors="surrogateescape"))
    return source, None if source.problems else _assignment(source, 0, len(source.text), inside, as_list=as_list)


def _variant(name: str, text: str) -> tuple[Source, SourceNode | None]:
    source = decode(f"variant {name}: {text}", text.encode("utf-8", errors="surrogateescape"))
    if source.problems:
        return source, None
    content = source.text
    root = _nested(("variants", name), _span(source, 0, len(content)), SourceNode({}, _span(source, 0, len(content))))
    start = 0
    for part in content.split(";"):
        if part.strip():
            one = _assignment(source, start, start + len(part), ("variants", name))
            if one is None:
                return source, None
            root = merged(root, one)
        start += len(part) + 1
    return source, root


def _assignment(
    source: Source, start: int, end: int, inside: tuple[str, ...] | None, *, as_list: bool = False
) -> SourceNode | None:
    """Parse ``path=value`` between two positions of a one-line text.

    Args:
        source: The text.
        start: The first position.
        end: The position after the last.
        inside: The mapping of the document that contains the path; None if the path begins with its name.
        as_list: Whether commas separate values.
    """
    text = source.text[start:end]
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        forms = "path=value, value or path=first..last by step or path={uniform: [low, high]}"
        expected = forms if as_list else "path=value"
        source.report("bad-set", f"{quoted(text.strip())} sets no value", _span(source, start, end), expected=expected)
        return None
    span = _span(source, start, start + len(path.rstrip()))
    if as_list and not is_range(value):
        # Commas separate values: the text after the path is the inside of a list.
        node = _value(source, start + len(path), f"[{value}]")
        if node is not None and isinstance(node.value, list) and len(node.value) == 1:
            (only,) = node.value
            # A single mapping is a distribution.
            node = only if isinstance(only.value, dict) else node
    else:
        node = _value(source, start + len(path) + 1, value)
    keys = path.strip().split(".", 1) if inside is None else (*inside, path.strip())
    return None if node is None else _nested(keys, span, node)


def _value(source: Source, start: int, text: str) -> SourceNode | None:
    """Read a value as YAML, with columns that match the text that the user typed."""
    from symaware_cli.language import parse_yaml

    blank = Source(source.name, b"", " " * start + text)
    parse_yaml(blank)
    for each in blank.problems:
        source.report(each.code, each.message, each.span, expected=each.expected, suggestion=each.suggestion)
    if blank.root is None and not source.problems:
        return SourceNode(None, source.at(start))
    return blank.root


def _nested(path: Sequence[str], span: TextSpan, node: SourceNode) -> SourceNode:
    for key in reversed(path):
        node = SourceNode({key: MappingEntry(span, node)}, span)
    return node


def _span(source: Source, start: int, end: int) -> TextSpan:
    return source.text_span(1, start + 1, 1, end + 1)


def merged(base: SourceNode, overlay: SourceNode) -> SourceNode:
    """Return a tree merged with an overlay: mappings merge, everything else is replaced."""
    if not isinstance(base.value, dict) or not isinstance(overlay.value, dict):
        return overlay
    entries = dict(base.value)
    for key, entry in overlay.value.items():
        known = entries.get(key)
        entries[key] = MappingEntry(entry.key, merged(known.node, entry.node)) if known else entry
    return SourceNode(entries, overlay.span)


def varied(path: str, values: Iterable[Any] | Mapping[str, Any] | str) -> Sequence[str]:
    """Return a varied parameter in the syntax of ``--over``."""
    if isinstance(values, str):
        return (f"{path}={values}",)
    if isinstance(values, Mapping):
        return texts({path: values})
    return tuple(f"{path}={text.partition('=')[2][1:-1]}" for text in texts({path: list(values)}))
