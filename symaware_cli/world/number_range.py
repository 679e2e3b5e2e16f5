"""Ranges of numbers as they are written in files and on the command line, such as ``0..1 by 0.1``."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Any

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})\s*\.\.\s*({_NUMBER})(?:\s+by\s+({_NUMBER}))?\s*", re.ASCII)

#: The longest text of a range, which bounds the time that the pattern takes [characters].
_LONGEST = 200

#: The most values of a range, its greatest number, and its least step.
_MOST, _GREATEST, _LEAST_STEP = 100_000, Decimal("1e30"), Decimal("1e-30")

#: The JSON schema of values that are a list or a range.
LISTED = {
    "anyOf": [{"type": "array", "minItems": 1}, {"type": "string", "pattern": r"\.\."}],
    "description": "A list of values, or a range such as `0..1 by 0.1`, with both ends.",
}


def is_range(text: str) -> bool:
    """Whether a text is a range, such as ``0..1 by 0.1``."""
    return len(text) <= _LONGEST and ".." in text and _RANGE.fullmatch(text) is not None


def expanded(value: Any) -> Any:
    """Return the values of a range, with both ends; anything else as it is.

    The values are those that a person would write: ``0..1 by 0.1`` has 0.3, not 0.30000000000000004.

    Raises:
        ValueError: The range is empty, endless or too long, or has neither a step nor whole numbers at its ends.
    """
    found = _RANGE.fullmatch(value) if isinstance(value, str) and is_range(value) else None
    if found is None:
        return value
    if found[3] is None and not all(re.fullmatch(r"[-+]?\d+", text) for text in (found[1], found[2])):
        ends = f"{found[1]}..{found[2]}"
        raise ValueError(
            f"the range {ends} has no step: write `{ends} by STEP` for values that far apart, or "
            f"{{uniform: [{found[1]}, {found[2]}]}} to draw from between them"
        )
    first, last, step = (Decimal(text) for text in (found[1], found[2], found[3] or "1"))
    if max(each.copy_abs() for each in (first, last, step)) > _GREATEST or 0 < step.copy_abs() < _LEAST_STEP:
        raise ValueError(f"numbers of a range are at most {_GREATEST:g}, and its step is at least {_LEAST_STEP:g}")
    if step == 0 or (last - first) / step < 0:
        raise ValueError(f"the range never gets from {first} to {last} by {step}")
    count = int((last - first) / step) + 1
    if count > _MOST:
        raise ValueError(f"the range has {count:,} values; at most {_MOST:,} make sense")
    is_whole = all(re.fullmatch(r"[-+]?\d+", text) for text in (found[1], found[3] or "1"))
    return [int(first + step * k) if is_whole else float(first + step * k) for k in range(count)]
