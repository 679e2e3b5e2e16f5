"""Windows that slide over successive values, in arrays with the instants along the first axis."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

#: Robustness, or truth.
Values: TypeAlias = NDArray[Any]


def sliding(ufunc: np.ufunc, values: Values, width: int) -> Values:
    """The least or greatest of so many successive values, for each place where they begin.

    Windows that overlap are combined: the number of passes is the logarithm of the width.
    """
    covered = 1
    while covered < width:
        step = min(covered, width - covered)
        values = ufunc(values[: len(values) - step], values[step:])
        covered += step
    return values


def sliding_until(left: Values, right: Values, width: int) -> Values:
    """The robustness of "left until right" within so many instants, for each instant where these begin."""
    covered = 1
    while covered < width:
        step = min(covered, width - covered)
        right = np.maximum(right[:-step], np.minimum(left[:-step], right[step:]))
        left = np.minimum(left[:-step], left[step:])
        covered += step
    return right


class History:
    """Arrays of successive instants, the older of which may be dropped.

    Attributes:
        first: The instant of the first array that is kept.
        end: The instant after the last one.
    """

    def __init__(self, *shape: int, dtype: type = float, first: int = 0) -> None:
        self.first = first
        self.end = first
        self._data: Values = np.zeros((8, *shape), dtype)
        self._begin = 0

    def append(self, values: Values) -> None:
        """Add the array of the next instant."""
        self.add()[:] = values

    def add(self) -> Values:
        """Add an instant, and return its array, to be written to."""
        at = self._begin + self.end - self.first
        if at == len(self._data):
            kept = self._data[self._begin :]
            if 2 * len(kept) > len(self._data):
                self._data = np.zeros((2 * len(self._data), *self._data.shape[1:]), self._data.dtype)
            at = len(kept)
            self._data[:at] = kept.copy()
            self._begin = 0
        self.end += 1
        row: Values = self._data[at]
        return row

    def drop(self, before: int) -> None:
        """Forget what lies before an instant."""
        if before > self.first:
            self._begin += before - self.first
            self.first = before

    def at(self, instant: int) -> Values:
        """The array of an instant."""
        row: Values = self._data[self._begin + instant - self.first]
        return row

    def between(self, begin: int, end: int) -> Values:
        """The arrays from an instant on, up to but not including another [instants, ...]."""
        offset = self._begin - self.first
        return self._data[begin + offset : end + offset]


class Extremum:
    """The least or greatest of the last so many values, in amortised constant time.

    Values are taken in blocks as long as the window, which so consists of the end of one block and the beginning of the
    next: van Herk, Pattern Recognition Letters 13 (1992); Gil and Werman, IEEE PAMI 15 (1993).
    """

    def __init__(self, width: int, rows: int, greatest: bool, dtype: type) -> None:
        neutral = lowest(dtype) if greatest else highest(dtype)
        self._width = width
        self._greatest = greatest
        self._next = 0
        self._block: Values = np.zeros((width, rows), dtype)
        #: The extremum of each value of the last block and those after it.
        self._ends: Values = np.full((width, rows), neutral)
        self._beginning: Values = np.zeros(rows, dtype)
        self._result: Values = np.zeros(rows, dtype)

    def push(self, value: Values) -> Values:
        """Take a value [rows], and return the extremum, which is overwritten by the next one."""
        ufunc = np.maximum if self._greatest else np.minimum
        at = self._next
        self._block[at] = value
        if at:
            ufunc(self._beginning, value, out=self._beginning)
        else:
            self._beginning[:] = value
        self._next = at = at + 1
        if at < self._width:
            ufunc(self._ends[at], self._beginning, out=self._result)
            return self._result
        self._next = 0
        ufunc.accumulate(self._block[::-1], out=self._ends[::-1])
        return self._beginning


class UntilWindow:
    """The robustness of "left until right" within the last so many values, in amortised constant time.

    As the least and greatest, it is found by blocks: of a stretch of instants, what counts is the least of left and the
    robustness within the stretch, and stretches are joined by these alone.
    """

    def __init__(self, width: int, rows: int, dtype: type) -> None:
        self._width = width
        self._next = 0
        self._lefts: Values = np.zeros((width, rows), dtype)
        self._rights: Values = np.zeros((width, rows), dtype)
        self._least: Values = np.zeros(rows, dtype)
        self._until: Values = np.zeros(rows, dtype)

    def push(self, left: Values, right: Values) -> Values:
        """Take the robustness of both at an instant [rows], and return that of the whole [rows].

        It has a meaning as soon as the window is full.
        """
        at = self._next
        if at:
            np.maximum(self._until, np.minimum(self._least, right), out=self._until)
            np.minimum(self._least, left, out=self._least)
        else:
            self._least[:] = left
            self._until[:] = right
        self._next = at + 1
        if self._next < self._width:
            # Behind `_next` lies the end of the last block, before it the beginning of this one.
            joined: Values = np.maximum(self._rights[at + 1], np.minimum(self._lefts[at + 1], self._until))
            self._lefts[at], self._rights[at] = left, right
            return joined
        self._lefts[at], self._rights[at] = left, right
        self._next = 0
        for i in range(self._width - 2, -1, -1):
            np.maximum(self._rights[i], np.minimum(self._lefts[i], self._rights[i + 1]), out=self._rights[i])
            np.minimum(self._lefts[i], self._lefts[i + 1], out=self._lefts[i])
        return self._until.copy()


def lowest(dtype: type) -> float | bool:
    """What is less than any other value: falsehood, or minus infinity."""
    return False if dtype is bool else -np.inf


def highest(dtype: type) -> float | bool:
    """What is greater than any other value: truth, or infinity."""
    return True if dtype is bool else np.inf
