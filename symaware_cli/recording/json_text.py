"""Text: values as JSON, as far as they have a form in it, and what a log has in JSON or YAML, read within bounds.

Whatever comes from a log may have been written by anybody. What is read here is nested so little that nothing behind it
runs out of stack, grows no larger than the text that it stands in, and holds no number that cannot be a float.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

MAX_DEPTH = 64
"""Levels of nesting; a scenario has 32."""

MAX_YAML = 4 << 20
"""Bytes of a text in YAML, which takes a microsecond a byte to read."""

_MAX_DIGITS = 300
"""Of a whole number, which then is below the greatest float."""


def as_json(value: Any) -> str:
    """Write a value as JSON, keys sorted."""
    return json.dumps(plain(value), sort_keys=True)


def read_json(content: bytes | str) -> Any:
    """Read JSON that stands in a log.

    Raises:
        ValueError: It is none, or is nested deeper or has longer numbers than anybody writes.
    """
    try:
        value = json.loads(content, parse_int=_whole)
    except RecursionError:
        raise ValueError(f"values nested more than {MAX_DEPTH} deep") from None
    text = content if isinstance(content, str) else content.decode(json.detect_encoding(content), "surrogatepass")
    if text.count("[") + text.count("{") > MAX_DEPTH:
        _require_shallow(value)
    if "\\ud" in text.lower():
        # Half a character, which has no form in UTF-8, becomes a question mark.
        value = json.loads(json.dumps(value, ensure_ascii=False).encode(errors="replace"))
    return value


def read_yaml(content: bytes) -> Any:
    """Read YAML that stands in a log, as `scenario.resolved` writes it: without aliases.

    Raises:
        ValueError: It is none, or is larger, nested deeper or repeats more than what is written there.
    """
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    if len(content) > MAX_YAML:
        raise ValueError("more text than is read")
    depth = 0
    try:
        # Events come one by one; what is made of them is made by recursion.
        for event in yaml.parse(content, loader):
            if isinstance(event, yaml.AliasEvent):
                raise ValueError("values that are written once and used again")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise ValueError(f"values nested more than {MAX_DEPTH} deep")
        return yaml.load(content, loader)
    except yaml.YAMLError as error:
        raise ValueError("no YAML") from error


def _whole(digits: str) -> int:
    if len(digits) > _MAX_DIGITS:
        raise ValueError(f"a number of {len(digits)} digits")
    return int(digits)


def _require_shallow(value: Any) -> None:
    level = [[value]]
    for _ in range(MAX_DEPTH + 1):
        level = [
            list(inner.values()) if isinstance(inner, dict) else inner
            for outer in level
            for inner in outer
            if isinstance(inner, dict | list)
        ]
    if level:
        raise ValueError(f"values nested more than {MAX_DEPTH} deep")


def plain(value: Any) -> Any:
    """Turn a value into what JSON can hold; what it cannot becomes text."""
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else str(value)
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, set | frozenset):
        return sorted((plain(each) for each in value), key=repr)
    if hasattr(value, "times") and hasattr(value, "values"):
        return {"times": plain(value.times), "values": plain(value.values)}
    if hasattr(value, "state") and hasattr(value, "id"):
        return {"id": value.id} | {name: plain(said) for name, said in value.items()}
    return f"<{type(value).__module__}.{type(value).__qualname__}>"
