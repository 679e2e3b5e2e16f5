"""Sliding-window extrema over successive values, in arrays with the instants along the first axis."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import accumulate, islice
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

#: Minimum and maximum of two: for arrays, and for single numbers, for which NumPy is several times slower.
EXTREMA: tuple[tuple[Callable[[Any, Any], Any], ...], ...] = ((np.minimum, np.maximum), (min, max))

#: Up to this number of columns, NumPy accumulates extrema efficiently.
_FEW = 100

#: Robustness or truth.
Values: TypeAlias = NDArray[Any]


def sliding(ufunc: np.ufunc, values: Values, width: int) -> Values:
    """Return the minimum or maximum over each window of successive values, by the index where the window begins.

    Overlapping windows are combined: the number of passes is the logarithm of the width.
    """
    covered = 1
    while covered < width:
        step = min(covered, width - covered)
        values = ufunc(values[: len(values) - step], values[step:])
        covered += step
    return values


def sliding_until(left: Values, right: Values, width: int) -> Values:
    """Return the robustness of "left until right" over each window of instants, by the instant where it begins."""
    covered = 1
    while covered < width:
        step = min(covered, width - covered)
        right = np.maximum(right[:-step], np.minimum(left[:-step], right[step:]))
        left = np.minimum(left[:-step], left[step:])
        covered += step
    return right


def accumulated(ufunc: np.ufunc, values: Values, out: Values | None = None) -> Values:
    """Return the running minimum or maximum along the first axis."""
    if values[:1].size < _FEW:
        return ufunc.accumulate(values, out=out)
    # NumPy would iterate over the columns, which is several times slower if there are many.
    found = np.empty_like(values) if out is None else out
    found[:1] = values[:1]
    for i in range(1, len(values)):
        ufunc(found[i - 1], values[i], out=found[i])
    return found


class History:
    """Arrays of successive instants; the oldest can be dropped.

    Attributes:
        first: The instant of the first array kept.
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
        """Add an instant and return its array, for the caller to fill."""
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
        """Drop everything before an instant."""
        if before > self.first:
            self._begin += before - self.first
            self.first = before

    def between(self, begin: int, end: int) -> Values:
        """Return the arrays from `begin` up to but not including `end` [instants, ...]."""
        offset = self._begin - self.first
        return self._data[begin + offset : end + offset]


class Recent:
    """Values of the latest instants, each an array [rows] or the number of a single row.

    Attributes:
        first: The instant of the first value kept.
        end: The instant after the last one.
    """

    def __init__(self) -> None:
        self.first = 0
        self.end = 0
        self._values: deque[Any] = deque()

    def append(self, value: Any) -> None:
        """Add the value of the next instant."""
        self._values.append(value)
        self.end += 1

    def drop(self, before: int) -> None:
        """Drop everything before an instant."""
        while self.first < before:
            self._values.popleft()
            self.first += 1

    def delayed(self, value: Any, steps: int) -> Any:
        """Add the value of the next instant; remove and return the one that many steps before it, if there is one."""
        self._values.append(value)
        self.end += 1
        if self.end - self.first <= steps:
            return None
        self.first += 1
        return self._values.popleft()

    def at(self, instant: int) -> Any:
        """Return the value at an instant."""
        return self._values[instant - self.first]

    def between(self, begin: int, end: int, rows: int) -> Values:
        """Return the values from `begin` up to but not including `end` [instants, rows]."""
        return np.array(list(islice(self._values, begin - self.first, end - self.first))).reshape(-1, rows)


class Starts:
    """The extremum so far of each window ahead that has begun and not ended, by the instant it belongs to.

    Attributes:
        end: The instant after the last one whose window has begun.
        are_over: Whether the last window that is asked for has ended.
    """

    def __init__(
        self, first: int, last: int, greatest: bool, final: int | None, rows: int, dtype: type, single: bool
    ) -> None:
        """Create it without windows.

        Args:
            first: Number of steps from an instant to the beginning of its window.
            last: Number of steps from an instant to the end of its window.
            greatest: Whether to compute the maximum instead of the minimum.
            final: The last instant that is needed; -1 for none, None for all.
            rows: Number of rows.
            dtype: The type of values.
            single: Whether values are numbers of a single row instead of arrays [rows].
        """
        self.end = 0
        self._first, self._last = first, last
        self._greatest = greatest
        self._final = final
        self._single = single
        self._gone = 0
        self.are_over = final == -1
        self._extrema = History(rows, dtype=dtype)
        #: For a single row the values are kept instead, since their extrema are seldom read.
        self._values = Recent()
        self._only: Any = None

    def extend(self, at: int, value: Any) -> None:
        """Add the value of an instant."""
        begun, final = at - self._first, self._final
        if begun < 0 or self.are_over:
            return
        if final is None or begun <= final:
            self.end = begun + 1
        gone = max(0, at - self._last + 1)
        if self._single:
            if final == 0:
                self._only = value if self._only is None else EXTREMA[True][self._greatest](self._only, value)
            else:
                self._values.append(value)
                self._values.drop(min(gone, self._values.end))
        else:
            extrema = self._extrema
            extrema.drop(min(at - self._last, extrema.end))
            if extrema.end > extrema.first:
                known = extrema.between(extrema.first, extrema.end)
                (np.maximum if self._greatest else np.minimum)(known, value, out=known)
            if extrema.end < self.end:
                extrema.append(value)
            extrema.drop(min(gone, extrema.end))
        self._gone = gone
        self.are_over = final is not None and gone > final

    def between(self, begin: int, end: int) -> Values | None:
        """Return the extrema of the windows of a range of instants [instants, rows]; None if none has begun."""
        end = min(end, self.end)
        if begin >= end:
            return None
        if not self._single:
            return self._extrema.between(begin, end)
        if self._final == 0:
            return np.array([[self._only]])
        # The first value kept is the one at instant `first`.
        values = self._values.between(begin, self._values.end, 1)
        return accumulated(np.maximum if self._greatest else np.minimum, values[::-1])[::-1][: end - begin]


class Extremum:
    """The minimum or maximum of the latest `width` values, in amortised constant time.

    Values are grouped in blocks as long as the window, so that the window consists of the end of one block and the
    beginning of the next: van Herk, Pattern Recognition Letters 13 (1992); Gil and Werman, IEEE PAMI 15 (1993).
    """

    def __init__(self, width: int, single: bool, greatest: bool, neutral: Any) -> None:
        self._width = width
        self._single = single
        self._greatest = greatest
        self._block: list[Any] = []
        self._neutral = self._beginning = neutral
        #: For each value of the last block, the extremum from it to the end of the block; empty during the first block,
        #: so that a window which is longer than the run needs no memory for the rest.
        self._ends: list[Any] = []

    def push(self, value: Any) -> Any:
        """Add a value and return the extremum of the window."""
        block, beginning, greatest = self._block, self._beginning, self._greatest
        # Numbers are compared here, which takes half as long as `min` and `max`.
        if not block or (self._single and (value > beginning) is greatest):
            beginning = value
        elif not self._single:
            beginning = EXTREMA[False][greatest](beginning, value)
        block.append(value)
        if len(block) < self._width:
            self._beginning = beginning
            end = self._ends[len(block)] if self._ends else self._neutral
            if self._single:
                return end if (end > beginning) is greatest else beginning
            return EXTREMA[False][greatest](end, beginning)
        better = EXTREMA[self._single][greatest]
        self._ends = list(accumulate(reversed(block), better))
        self._ends.reverse()
        self._block = []
        return beginning


class UntilWindow:
    """The robustness of "left until right" within the latest `width` values, in amortised constant time.

    It is computed by blocks, as in `Extremum`: a range of instants is summarised by its minimum of left and its
    robustness, and adjacent ranges are joined by these two.
    """

    def __init__(self, width: int, single: bool, neutral: Any) -> None:
        self._width = width
        self._single = single
        self._lefts: list[Any] = []
        self._rights: list[Any] = []
        self._neutral = self._held = self._until = neutral
        #: For each instant of the last block: both values from it to the end of the block; empty during the first one,
        #: as in `Extremum`.
        self._holds: list[Any] = []
        self._untils: list[Any] = []

    def push(self, left: Any, right: Any) -> Any:
        """Add both values of an instant and return the robustness, which is meaningful once the window is full."""
        least, greatest = EXTREMA[self._single]
        lefts, rights = self._lefts, self._rights
        if lefts:
            self._until = greatest(self._until, least(self._held, right))
            self._held = least(self._held, left)
        else:
            self._until, self._held = right, left
        lefts.append(left)
        rights.append(right)
        length = len(lefts)
        if length < self._width:
            if not self._untils:
                return greatest(self._neutral, least(self._neutral, self._until))
            return greatest(self._untils[length], least(self._holds[length], self._until))
        for i in range(length - 2, -1, -1):
            rights[i] = greatest(rights[i], least(lefts[i], rights[i + 1]))
            lefts[i] = least(lefts[i], lefts[i + 1])
        self._holds, self._untils = lefts, rights
        self._lefts, self._rights = [], []
        return self._until
