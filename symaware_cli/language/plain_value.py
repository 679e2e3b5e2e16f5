"""Python values as the values of a scenario, with the text that a person would type for them."""

import json
import math
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

from symaware_cli.language.source import (
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


def plain(value: Any, path: str, depth: int = 0) -> Any:
    """Returns a value as dictionaries, lists and scalars.

    Args:
        value: The value; NumPy's arrays and numbers, tuples and paths are converted.
        path: Its path, for messages.
        depth: How deep it is nested. What is too deep is cut off, as values may contain themselves.

    Raises:
        TypeError: It has a type that scenarios do not support, or a mapping has two equal keys.
    """
    if depth > MAX_DEPTH:
        return None
    if isinstance(value, Mapping):
        found = {str(key): plain(each, path, depth + 1) for key, each in value.items()}
        if len(found) < len(value):
            raise TypeError(f"{path}: two keys of a mapping are the same text")
        return found
    if isinstance(value, list | tuple):
        return [plain(each, path, depth + 1) for each in value]
    if hasattr(value, "tolist"):  # an array, or a number, of NumPy
        return plain(value.tolist(), path, depth)
    if isinstance(value, PathLike):
        return plain(fspath(value), path, depth)
    if value is None or isinstance(value, bool):
        return value
    # Instances of subclasses, such as members of an enumeration, become plain ones.
    if isinstance(value, str):
        return str.__str__(value)
    if isinstance(value, int):
        return int.__int__(value)
    if isinstance(value, float):
        return float.__float__(value)
    raise TypeError(f"{path}: a scenario holds no {type(value).__name__}")


def written(value: Any) -> str:
    """Returns a plain value as YAML on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{written(key)}: {written(each)}' for key, each in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    # Characters that scenarios must not contain are escaped, so that messages can be printed.
    return json.dumps(value, ensure_ascii=scalar_fault(value) is not None)


def node_of(value: Any, source: Source, start: int, path: Path) -> SourceNode:
    """Returns the node of a plain value, with the position of each part; adds problems to the source.

    Args:
        value: The value.
        source: A text of one line that contains what `written` returned for the value.
        start: The index in the line at which that begins.
        path: The path of the value, for messages.
    """
    node, _ = _Placement(source, path).node(value, start)
    if node.height > MAX_DEPTH:
        report_depth(source, node.span, path)
    if node.size > MAX_NODES:
        report_nodes(source, node.span, path)
    return node


class _Placement:
    def __init__(self, source: Source, path: Path) -> None:
        self._source = source
        self._path = path

    def node(self, value: Any, start: int) -> tuple[SourceNode, int]:
        """Returns the node of a value whose text begins at an index, and the index at which that ends."""
        if not isinstance(value, dict | list):
            return self._scalar(value, start)
        entries: dict[str, MappingEntry] = {}
        items: list[SourceNode] = []
        end = start + 1
        for each in value:
            end += 2 if end > start + 1 else 0  # the comma
            if isinstance(value, dict):
                key, end = self._scalar(each, end)
                node, end = self.node(value[each], end + 2)
                entries[each] = MappingEntry(key.span, node)
            else:
                node, end = self.node(each, end)
                items.append(node)
        span = self._source.text_span(1, start + 1, 1, end + 2)
        return SourceNode(entries if isinstance(value, dict) else items, span), end + 1

    def _scalar(self, value: Any, start: int) -> tuple[SourceNode, int]:
        end = start + len(written(value))
        span = self._source.text_span(1, start + 1, 1, end + 1)
        fault = scalar_fault(value)
        if fault:
            self._source.report(fault.code, fault.message, span, self._path, expected=fault.expected)
        return SourceNode(None if fault else value, span), end
