"""Text: values as JSON, as far as they have a form in it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def as_json(value: Any) -> str:
    """Write a value as JSON, keys sorted."""
    return json.dumps(plain(value), sort_keys=True)


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
        return {name: plain(getattr(value, name)) for name in ("id", "state", "intent", "uncertainty", "risk")}
    return f"<{type(value).__module__}.{type(value).__qualname__}>"
