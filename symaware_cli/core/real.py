"""Real numbers: what may stand in a column or a series, and what must be refused instead of being bent to it."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_REFUSED = {
    "c": "complex numbers, whose imaginary part would be lost",
    "U": "text",
    "S": "bytes",
    "M": "dates",
    "m": "durations",
}


def real(values: ArrayLike) -> NDArray[np.float64]:
    """Return values as an array of floating-point numbers, which is the same one if it is that already.

    Raises:
        TypeError: They are not real numbers.
        ValueError: They are nested lists of different lengths.
    """
    array: NDArray[Any] = np.asarray(values)
    kind = array.dtype.kind
    if kind == "f" and array.dtype == np.float64:
        return array
    if kind == "O":
        strange = next((each for each in array.flat if not isinstance(each, Real)), 0.0)
        if not isinstance(strange, Real):
            raise TypeError(f"expected real numbers, not {'None' if strange is None else type(strange).__name__}")
    elif kind not in "fiub":
        raise TypeError(f"expected real numbers, not {_REFUSED.get(kind, array.dtype)}")
    return array.astype(np.float64)
