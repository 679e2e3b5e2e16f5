"""Lists of values, and ranges that stand for them."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Any

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})\s*\.\.\s*({_NUMBER})(?:\s+by\s+({_NUMBER}))?\s*")

#: The most values of a range.
_MOST = 100_000


def is_range(text: str) -> bool:
    """Whether a text is a range, such as ``0..1 by 0.1``."""
    return _RANGE.fullmatch(text) is not None


def expanded(value: Any) -> Any:
    """Return the values of a range, with both ends; anything else as it is.

    The values are those that a person would write: ``0..1 by 0.1`` has 0.3, not 0.30000000000000004.

    Raises:
        ValueError: The range is empty, endless or too long.
    """
    found = _RANGE.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        return value
    first, last, step = (Decimal(text) for text in (found[1], found[2], found[3] or "1"))
    if step == 0 or (last - first) / step < 0:
        raise ValueError(f"the range never gets from {first} to {last} by {step}")
    count = int((last - first) / step) + 1
    if count > _MOST:
        raise ValueError(f"the range has {count:,} values; at most {_MOST:,} make sense")
    is_whole = all(re.fullmatch(r"[-+]?\d+", text) for text in (found[1], found[3] or "1"))
    return [int(first + step * k) if is_whole else float(first + step * k) for k in range(count)]
