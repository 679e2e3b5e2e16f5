"""Python values as nodes of a document, with the text that a person would type for them."""

import json
import math
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

from symaware_cli.language.problem import TextSpan, dotted
from symaware_cli.language.source import MAX_DEPTH, MappingEntry, Path, Source, SourceNode, scalar_fault


def placed(value: Any, source: Source, start: int, path: Path) -> tuple[SourceNode, str]:
    """Returns the node of a Python value, and the value as YAML on one line.

    Args:
        value: The value; NumPy's arrays and numbers, tuples and paths are converted.
        source: The text in which the value stands; problems are added to it.
        start: The index in its only line at which the value begins.
        path: The path of the value, for messages.

    Raises:
        TypeError: The value has a type that scenarios do not support, or a mapping has two equal keys.
    """
    writing = _Writing(source, start, path)
    return writing.node(value, 0), "".join(writing.parts)


class _Writing:
    def __init__(self, source: Source, start: int, path: Path) -> None:
        self.parts: list[str] = []
        self._source = source
        self._path = path
        self._end = start

    def node(self, value: Any, depth: int) -> SourceNode:
        """Writes a value, and returns its node."""
        if depth > MAX_DEPTH:
            # A document that is nested so deep is refused; without an end, as values may contain themselves.
            value = None
        if hasattr(value, "tolist"):  # an array, or a number, of NumPy
            value = value.tolist()
        begin = self._end
        if isinstance(value, Mapping):
            self._write("{")
            entries: dict[str, MappingEntry] = {}
            for key, each in value.items():
                self._write(", " if entries else "")
                name = self._scalar(str(key))
                self._write(": ")
                entries[str(key)] = MappingEntry(name.span, self.node(each, depth + 1))
            if len(entries) < len(value):
                raise TypeError(f"{dotted(self._path)}: two keys of a mapping are the same text")
            self._write("}")
            return SourceNode(entries, self._span(begin))
        if isinstance(value, list | tuple):
            self._write("[")
            items: list[SourceNode] = []
            for each in value:
                self._write(", " if items else "")
                items.append(self.node(each, depth + 1))
            self._write("]")
            return SourceNode(items, self._span(begin))
        return self._scalar(value)

    def _scalar(self, value: Any) -> SourceNode:
        if isinstance(value, PathLike):
            value = fspath(value)
        if isinstance(value, int) and not isinstance(value, bool):
            value = int.__int__(value)  # a member of an enumeration becomes a plain number or text
        elif isinstance(value, str):
            value = str.__str__(value)
        elif isinstance(value, float):
            value = float.__float__(value)
        elif not isinstance(value, bool | None):
            raise TypeError(f"{dotted(self._path)}: a scenario holds no {type(value).__name__}")
        begin, fault = self._end, scalar_fault(value)
        if isinstance(value, float) and not math.isfinite(value):
            self._write(".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf")
        else:
            # Characters that scenarios must not contain are escaped, so that messages can be printed.
            self._write(json.dumps(value, ensure_ascii=fault is not None))
        if fault:
            self._source.report(fault.code, fault.message, self._span(begin), self._path, expected=fault.expected)
        return SourceNode(None if fault else value, self._span(begin))

    def _write(self, text: str) -> None:
        self.parts.append(text)
        self._end += len(text)

    def _span(self, begin: int) -> TextSpan:
        return self._source.text_span(1, begin + 1, 1, self._end + 1)
