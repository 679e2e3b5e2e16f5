"""Arrays of real numbers: conversion, checks for finite values, and read-only arrays."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: The bound of elements of a state: beyond it, double precision is coarser than 0.1, and differences are meaningless.
FARTHEST = 1e15
#: The greatest finite number.
MOST = float(np.finfo(float).max)

#: The most elements of one dot product: with more than 10,000, OpenBLAS waits for other threads, unless it has one.
_PART = 8192

_REFUSED = {
    "c": "complex numbers, whose imaginary part would be lost",
    "U": "text",
    "S": "bytes",
    "M": "dates",
    "m": "durations",
}


def real(values: ArrayLike) -> NDArray[np.float64]:
    """Return values as an array of floating-point numbers; such an array is returned as it is.

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


def frozen(values: ArrayLike) -> Array:
    """Return the values as a read-only array; copied unless it is one already.

    It is laid out row by row, because some of NumPy's functions give other last bits for other layouts.

    Raises:
        TypeError: They are not real numbers.
    """
    if type(values) is np.ndarray and values.dtype == float:
        flags = values.flags
        if values.base is None and flags.c_contiguous and not flags.writeable:
            return values
        array = values.copy()
    else:
        array = np.array(real(values), order="C")
    array.setflags(write=False)  # takes half as long as to set it in `flags`
    return array


def is_finite(array: Array) -> bool:
    """Return whether all elements are finite; usually at the cost of one dot product.

    It may overflow, and then every element is checked. `numpy.dot` would warn of that, with some kernels of BLAS and
    not with others; `numpy.vdot` never does.
    """
    return math.isfinite(_squared(array)) or bool(np.isfinite(array).all())


def is_within(array: Array, most: float) -> bool:
    """Return whether all elements are finite and within the bound; as cheap as `is_finite`."""
    squared = float(np.vdot(array, array)) if array.size <= _PART else _squared(array)
    # The square of the bound may be infinite, and that of an array then tells nothing.
    return (squared <= most * most and squared <= MOST) or bool((np.abs(array) <= most).all())


def _squared(array: Array) -> float:
    """Return the sum of the squares of all elements, to be compared only: its last bits depend on BLAS."""
    if array.size <= _PART:
        return float(np.vdot(array, array))
    flat, total = array.ravel(), 0.0
    for begin in range(0, flat.size, _PART):
        part = flat[begin : begin + _PART]
        total += float(np.vdot(part, part))
    return total


def said_of(values: Array) -> str:
    """Describe the invalid values of a row that is out of bounds."""
    what = "is not finite" if not is_finite(values) else f"has run away, beyond {FARTHEST:g}"
    return f"{what}: {values.tolist()}"


def distinct(numbers: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Return the distinct whole numbers, ascending, as `numpy.unique` does, which hashes them and takes longer."""
    ascending = np.sort(numbers).astype(np.int64, copy=False)
    first = np.ones(len(ascending), bool)
    first[1:] = ascending[1:] != ascending[:-1]
    found: NDArray[np.int64] = ascending[first]
    return found
