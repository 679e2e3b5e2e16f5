"""Streams of the past operators: historically, once and since."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from symaware_cli.specification.sliding import EXTREMA, Extremum, Recent, Values, accumulated, sliding
from symaware_cli.specification.stream import Clock, Stream, Together


class AgoStream(Stream):
    """The minimum or maximum over a window of the past."""

    def __init__(self, clock: Clock, operand: Stream, first: int, last: int, greatest: bool) -> None:
        super().__init__(clock, operand.horizon, operand.reach + last)
        self._operand = operand
        self._first, self._last = first, last
        self._greatest = greatest
        self._window: Extremum | None = None
        if last > first:
            self._window = Extremum(last - first + 1, clock.single, greatest, clock.value(not greatest))
        self._recent = Recent()

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value = self._operand.push(samples)
        if value is None:
            return None
        self.exact = at = self._operand.exact
        self._recent.append(value)
        self._recent.drop(at - self._last)
        if at < self._first:
            return self.clock.value(not self._greatest)
        value = self._recent.at(at - self._first)
        return value if self._window is None else self._window.push(value)

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        after = self._operand.exact + 1
        window, stop = begin - self._last, end - self._first
        pending = max(after, window)
        found = self._operand.bound(side, pending, stop) if pending < stop else None
        if found is None and window >= after:
            return None
        parts = []
        if window < 0:
            parts.append(self.clock.full(min(0, stop) - window, not self._greatest))
        if min(after, stop) > max(window, 0):
            parts.append(self._recent.between(max(window, 0), min(after, stop), self.clock.rows))
        if pending < stop:
            parts.append(self.clock.full(stop - pending, side == 1) if found is None else found)
        return sliding(
            np.maximum if self._greatest else np.minimum, np.concatenate(parts), self._last - self._first + 1
        )


class SoFarStream(Stream):
    """The minimum or maximum from the beginning of the run until now."""

    def __init__(self, clock: Clock, operand: Stream, greatest: bool) -> None:
        super().__init__(clock, operand.horizon, operand.reach)
        self._operand = operand
        self._greatest = greatest
        self._so_far = clock.value(not greatest)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value = self._operand.push(samples)
        if value is None:
            return None
        self.exact += 1
        self._so_far = EXTREMA[self.clock.single][self._greatest](self._so_far, value)
        return self._so_far

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        after = self._operand.exact + 1
        found = self._operand.bound(side, after, end)
        if found is None:
            if self._greatest == (side == 1):
                return None
            return np.broadcast_to(self._so_far, (end - begin, self.clock.rows))
        ufunc = np.maximum if self._greatest else np.minimum
        result: Values = ufunc(accumulated(ufunc, found), self._so_far)
        return result[begin - after :]


class SinceStream(Stream):
    """``right`` at some instant up to now, and ``left`` since then."""

    def __init__(self, clock: Clock, left: Stream, right: Stream, last: int | None) -> None:
        self._together = Together(clock, [left, right], last)
        super().__init__(clock, self._together.horizon, self._together.reach)
        self._since = clock.value(False)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        found = self._together.push(samples)
        if found is None:
            return None
        left, right = found
        least, greatest = EXTREMA[self.clock.single]
        self.exact += 1
        self._since = greatest(right, least(left, self._since))
        return self._since

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        after = self.exact + 1
        right = self._together.bound(1, side, after, end)
        if right is None and side == 1:
            return None
        left = self._together.bound(0, side, after, end)
        if left is None and right is None:
            return None
        result = self.clock.full(end - after, False) if right is None else right.copy()
        if left is None:
            left = self.clock.full(end - after, side == 1)
        since = self._since
        for i, row in enumerate(result):
            np.maximum(row, np.minimum(left[i], since), out=row)
            since = row
        return result[begin - after :]
