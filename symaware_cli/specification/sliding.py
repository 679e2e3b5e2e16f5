"""Windows that slide over successive values, in arrays with the instants along the first axis."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import accumulate, islice
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

#: The lesser and the greater of two: of arrays, and of single numbers, for which NumPy would take some times as long.
EXTREMA: tuple[tuple[Callable[[Any, Any], Any], ...], ...] = ((np.minimum, np.maximum), (min, max))

#: Up to so many columns, extrema are accumulated column by column.
_FEW = 100

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


def accumulated(ufunc: np.ufunc, values: Values, out: Values | None = None) -> Values:
    """The least or greatest of each value and those before it, along the first axis."""
    if values[:1].size < _FEW:
        return ufunc.accumulate(values, out=out)
    # NumPy would go from column to column, which is several times slower for many of them.
    found = np.empty_like(values) if out is None else out
    found[:1] = values[:1]
    for i in range(1, len(values)):
        ufunc(found[i - 1], values[i], out=found[i])
    return found


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

    def between(self, begin: int, end: int) -> Values:
        """The arrays from an instant on, up to but not including another [instants, ...]."""
        offset = self._begin - self.first
        return self._data[begin + offset : end + offset]


class Recent:
    """Values of the last instants, each of all rows [rows] or the number of a single one.

    Attributes:
        first: The instant of the first value that is kept.
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
        """Forget what lies before an instant."""
        while self.first < before:
            self._values.popleft()
            self.first += 1

    def delayed(self, value: Any, steps: int) -> Any:
        """Add the value of the next instant, and take out the one that lies so many steps before it, if there is."""
        self._values.append(value)
        self.end += 1
        if self.end - self.first <= steps:
            return None
        self.first += 1
        return self._values.popleft()

    def at(self, instant: int) -> Any:
        """The value of an instant."""
        return self._values[instant - self.first]

    def between(self, begin: int, end: int, rows: int) -> Values:
        """The values from an instant on, up to but not including another [instants, rows]."""
        return np.array(list(islice(self._values, begin - self.first, end - self.first))).reshape(-1, rows)


class Starts:
    """Of each instant at which a window ahead begins that has not ended, the extremum so far.

    Attributes:
        end: The instant after the last one at which a window has begun.
    """

    def __init__(self, first: int, last: int, greatest: bool, final: int | None, rows: int, dtype: type) -> None:
        """Begin without windows.

        Args:
            first: How many steps after its instant a window begins.
            last: How many steps after its instant it ends.
            greatest: Whether the greatest is asked for, or else the least.
            final: The last instant that is asked for; -1 for none at all, None for all.
            rows: Number of rows.
            dtype: The type of values.
        """
        self.end = 0
        self._first, self._last = first, last
        self._greatest = greatest
        self._final = final
        self._single = rows == 1
        self._gone = 0
        self._extrema = History(rows, dtype=dtype)
        #: A single row keeps values themselves, which most often nobody asks for.
        self._values = Recent()
        self._only: Any = None

    def extend(self, at: int, value: Any) -> None:
        """Go on to an instant with its value."""
        begun, final = at - self._first, self._final
        if begun < 0 or (final is not None and self._gone > final):
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

    def between(self, begin: int, end: int) -> Values | None:
        """The extrema of windows that begin from one instant up to another [instants, rows]; None if none has begun."""
        end = min(end, self.end)
        if begin >= end:
            return None
        if not self._single:
            return self._extrema.between(begin, end)
        if self._final == 0:
            return np.array([[self._only]])
        # The first value that was kept is that of instant `first`.
        values = self._values.between(begin, self._values.end, 1)
        return accumulated(np.maximum if self._greatest else np.minimum, values[::-1])[::-1][: end - begin]


class Extremum:
    """The least or greatest of the last so many values, in amortised constant time.

    Values are taken in blocks as long as the window, which so consists of the end of one block and the beginning of the
    next: van Herk, Pattern Recognition Letters 13 (1992); Gil and Werman, IEEE PAMI 15 (1993).
    """

    def __init__(self, width: int, single: bool, greatest: bool, neutral: Any) -> None:
        self._width = width
        self._single = single
        self._greatest = greatest
        self._block: list[Any] = []
        self._beginning = neutral
        #: Of the last block, the extremum of each value and those after it.
        self._ends = [neutral] * width

    def push(self, value: Any) -> Any:
        """Take a value, and return the extremum."""
        block = self._block
        better = EXTREMA[self._single][self._greatest]
        beginning = self._beginning
        if not block:
            beginning = value
        elif not self._single:
            beginning = better(beginning, value)
        elif (value > beginning) is self._greatest:
            beginning = value
        block.append(value)
        if len(block) < self._width:
            self._beginning = beginning
            return better(self._ends[len(block)], beginning)
        self._ends = list(accumulate(reversed(block), better))
        self._ends.reverse()
        self._block = []
        return beginning


class UntilWindow:
    """The robustness of "left until right" within the last so many values, in amortised constant time.

    It is found by blocks, as an extremum is: of a stretch of instants, what counts is the least of left and the
    robustness within the stretch, and stretches are joined by these alone.
    """

    def __init__(self, width: int, single: bool, neutral: Any) -> None:
        self._width = width
        self._single = single
        self._lefts: list[Any] = []
        self._rights: list[Any] = []
        self._held = neutral
        self._until = neutral
        #: Of the end of the last block from each of its instants on.
        self._holds = [neutral] * width
        self._untils = [neutral] * width

    def push(self, left: Any, right: Any) -> Any:
        """Take both at an instant, and return the whole, which has a meaning as soon as the window is full."""
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
            return greatest(self._untils[length], least(self._holds[length], self._until))
        for i in range(length - 2, -1, -1):
            rights[i] = greatest(rights[i], least(lefts[i], rights[i + 1]))
            lefts[i] = least(lefts[i], lefts[i + 1])
        self._holds, self._untils = lefts, rights
        self._lefts, self._rights = [], []
        return self._until


def lowest(dtype: type) -> float | bool:
    """What is less than any other value: falsehood, or minus infinity."""
    return False if dtype is bool else -np.inf


def highest(dtype: type) -> float | bool:
    """What is greater than any other value: truth, or infinity."""
    return True if dtype is bool else np.inf
