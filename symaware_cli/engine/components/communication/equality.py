"""Equality of knowledge: detects whether a value has changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from symaware_cli.core import AwarenessVector, TimeSeries

_PARTS = {AwarenessVector: AwarenessVector.__slots__, TimeSeries: ("times", "values")}


def same(one: Any, other: Any) -> bool:
    """Return whether two values are equal; NaN equals NaN.

    Args:
        one: Plain values, lists, mappings, arrays, time series or awareness vectors. A value that cannot be compared
            equals only itself.
        other: Likewise.
    """
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return _are_same_arrays(one, other)
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(each, other[name]) for name, each in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    for kind, names in _PARTS.items():
        if isinstance(one, kind) and isinstance(other, kind):
            return all(same(getattr(one, name), getattr(other, name)) for name in names)
    return bool(one == other or (one != one and other != other))


def _are_same_arrays(one: Any, other: Any) -> bool:
    if not isinstance(one, np.ndarray) or not isinstance(other, np.ndarray) or one.shape != other.shape:
        return False
    return bool(np.all((one == other) | ((one != one) & (other != other))))
