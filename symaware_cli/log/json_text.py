"""Conversion of values to JSON, and safe parsing of the JSON and YAML in logs.

A log may come from an untrusted source. Parsed values have bounded nesting, so that later code does not exhaust the
stack, are no larger than their text, and contain no number beyond the range of a float.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

MAX_DEPTH = 64
"""Maximum nesting depth; that of a scenario is 32."""

MAX_YAML = 4 << 20
"""Maximum size of a YAML text [bytes]; parsing takes about a microsecond per byte."""

_MAX_DIGITS = 300
"""Maximum number of digits of an integer; keeps it below the greatest float."""


def as_json(value: Any) -> str:
    """Write a value as JSON, keys sorted."""
    return json.dumps(plain(value), sort_keys=True)


def read_json(content: bytes | str) -> Any:
    """Parse JSON from a log.

    Raises:
        ValueError: It is not JSON, or is nested too deeply or has too long numbers.
    """
    try:
        value = json.loads(content, parse_int=_whole)
    except RecursionError:
        raise ValueError(f"values nested more than {MAX_DEPTH} deep") from None
    text = content if isinstance(content, str) else content.decode(json.detect_encoding(content), "surrogatepass")
    if text.count("[") + text.count("{") > MAX_DEPTH:
        _require_shallow(value)
    if "\\ud" in text.lower():
        # Unpaired surrogates, which UTF-8 cannot represent, become question marks.
        value = json.loads(json.dumps(value, ensure_ascii=False).encode(errors="replace"))
    return value


def read_yaml(content: bytes) -> Any:
    """Parse YAML from a log, as `scenario.resolved` writes it: without aliases.

    Raises:
        ValueError: It is not YAML, or is too large, nested too deeply or contains aliases.
    """
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    if len(content) > MAX_YAML:
        raise ValueError("more text than is allowed")
    depth = 0
    try:
        # Parsing yields events one by one, whereas loading is recursive: check the depth first.
        for event in yaml.parse(content, loader):
            if isinstance(event, yaml.AliasEvent):
                raise ValueError("YAML aliases are not allowed")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise ValueError(f"values nested more than {MAX_DEPTH} deep")
        return yaml.load(content, loader)
    except yaml.YAMLError as error:
        raise ValueError("not YAML") from error


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
    """Convert a value to plain data that JSON can represent; anything else becomes text."""
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
