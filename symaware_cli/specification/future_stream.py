"""Streams of the future operators: always, eventually and until."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from symaware_cli.specification.sliding import (
    EXTREMA,
    Extremum,
    History,
    Recent,
    Starts,
    UntilWindow,
    Values,
    accumulated,
    sliding,
    sliding_until,
)
from symaware_cli.specification.stream import Clock, Stream, Together


class NextStream(Stream):
    """The value at the next instant; a neutral one at the last instant of the run."""

    def __init__(self, clock: Clock, operand: Stream, weak: bool) -> None:
        lower, upper = operand.soonest
        # At the end of the run either bound may become known at once.
        soonest = (min(lower + 1, 0.0), upper + 1) if weak else (lower + 1, min(upper + 1, 0.0))
        super().__init__(clock, None if operand.horizon is None else operand.horizon + 1, operand.reach, soonest)
        self._operand = operand
        self._weak = weak

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value = self._operand.push(samples)
        if value is None or self._operand.exact < 1:
            return None
        self.exact += 1
        return value

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        found = self._operand.bound(side, begin + 1, end + 1)
        last = self.clock.now
        if self.clock.ended:
            if not begin <= last < end:
                return found
            found = self.clock.full(end - begin, side == 1) if found is None else found.copy()
            found[last - begin] = self.clock.extreme(self._weak)
        elif found is not None and self._weak == (side == 1) and end > last:
            # The run may end with any instant from the last one on.
            found = found.copy()
            found[max(last - begin, 0) :] = self.clock.extreme(self._weak)
        return found


class AheadStream(Stream):
    """The minimum or maximum over a window ahead."""

    def __init__(
        self, clock: Clock, operand: Stream, first: int, last: int, greatest: bool, starts: int | None
    ) -> None:
        lower, upper = operand.soonest
        soonest = (first + lower, last + upper) if greatest else (last + lower, first + upper)
        super().__init__(clock, None if operand.horizon is None else operand.horizon + last, operand.reach, soonest)
        self._operand = operand
        self._first, self._last = first, last
        self._greatest = greatest
        self._window: Extremum | None = None
        if last > first:
            self._window = Extremum(last - first + 1, clock.single, greatest, clock.value(not greatest))
        self._starts = Starts(first, last, greatest, starts, clock.rows, clock.dtype, clock.single)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value = self._operand.push(samples)
        if value is None:
            return None
        at = self._operand.exact
        if self._window is not None:
            if not self._starts.are_over:
                self._starts.extend(at, value)
            value = self._window.push(value)
        if at < self._last:
            return None
        self.exact += 1
        return value

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        ufunc = np.maximum if self._greatest else np.minimum
        window = begin + self._first
        pending = max(window, self._operand.exact + 1)
        one = end - begin == 1 and self._greatest == (side == 1) and pending < begin + self._last
        if one and self._operand.known(side, begin + self._last, end + self._last) is None:
            # In most calls, the last instant alone shows that the bound is trivial.
            return None
        found = self._operand.known(side, pending, end + self._last)
        starts = self._starts.between(begin, end)
        if found is None:
            if self._greatest == (side == 1) or starts is None:
                return None
            if len(starts) == end - begin:
                return starts
            return np.concatenate([starts, self.clock.full(end - begin - len(starts), side == 1)])
        if end - 1 + self._first <= pending:
            # All windows have begun and share the first of these instants.
            common = begin + self._last + 1 - pending
            least = ufunc.reduce(found[:common], axis=0, keepdims=True)
            found = least if end - begin == 1 else accumulated(ufunc, np.concatenate([least, found[common:]]))
        else:
            if pending > window:
                found = np.concatenate([self.clock.full(pending - window, not self._greatest), found])
            found = sliding(ufunc, found, self._last - self._first + 1)
        if starts is not None:
            ufunc(found[: len(starts)], starts, out=found[: len(starts)])
        return found


class WholeRunStream(Stream):
    """The minimum or maximum of momentary values from the first instant to the end of the run; at no later instant."""

    def __init__(self, clock: Clock, operand: Stream, greatest: bool) -> None:
        super().__init__(clock, None, operand.reach)
        self._operand = operand
        self._greatest = greatest
        #: The extremum so far, replaced when it changes.
        self._extremum: Any = None
        self._is_changed = True

    @property
    def is_changed(self) -> bool:
        """See the base class."""
        return self._is_changed

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value, known, single = self._operand.push(samples), self._extremum, self.clock.single
        if known is not None:
            value = EXTREMA[single][self._greatest](known, value)
            # Comparing bytes takes a fifth of the time of comparing arrays of few rows.
            self._is_changed = value != known if single else value.tobytes() != known.tobytes()
        if self._is_changed:
            self._extremum = value
        return None

    def first(self) -> tuple[Values | None, Values | None]:
        """See the base class."""
        known = self._extremum
        if known is None or self.clock.ended:
            return super().first()
        extremum = np.array([known]) if self.clock.single else known
        return (extremum, None) if self._greatest else (None, extremum)

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        known, ended = self._extremum, self.clock.ended
        if known is None:
            return self.clock.full(1, not self._greatest) if ended else None
        # Nothing is known of later instants.
        return np.reshape(known, (1, -1)) if ended or self._greatest == (side == 0) else None


class ToTheEndStream(Stream):
    """The minimum or maximum from an instant to the end of the run."""

    def __init__(self, clock: Clock, operand: Stream, greatest: bool, starts: int | None) -> None:
        super().__init__(clock, None, operand.reach)
        self._operand = operand
        self._greatest = greatest
        #: The extremum so far for each start that is needed; if all are needed, the values instead, as few are read.
        self._starts = History(clock.rows, dtype=clock.dtype)
        self._values = Recent()
        self._last_start = starts

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value = self._operand.push(samples)
        if value is None:
            return None
        if self._last_start is None:
            self._values.append(value)
            return None
        starts = self._starts
        if starts.end:
            known = starts.between(0, starts.end)
            (np.maximum if self._greatest else np.minimum)(known, value, out=known)
        if starts.end <= self._last_start:
            starts.append(value)
        return None

    def _begun(self, begin: int, end: int) -> Values:
        """Return the extrema so far for the starts in a range that have been pushed [instants, rows]."""
        if self._last_start is not None:
            return self._starts.between(begin, max(begin, min(end, self._starts.end)))
        if begin >= min(end, self._values.end):
            return self.clock.full(0, False)
        values = self._values.between(begin, self._values.end, self.clock.rows)
        return accumulated(np.maximum if self._greatest else np.minimum, values[::-1])[::-1][: max(end - begin, 0)]

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class.

        The run may end now or continue without end; each bound is the worse of the two cases.
        """
        ufunc = np.maximum if self._greatest else np.minimum
        goes_on = not self.clock.ended and self._greatest == (side == 1)
        last = self.clock.now
        if goes_on:
            last += self._operand.reach + 1
            if self._operand.bound(side, last, last + 1) is None:
                return None
        pending = max(begin, self._operand.exact + 1)
        found = self._operand.bound(side, pending, last + 1) if pending <= last else None
        starts = self._begun(begin, end)
        if found is None and not goes_on:
            if len(starts) == end - begin and pending > last:
                return starts
            if not len(starts) and not self.clock.ended:
                return None
        result = self.clock.full(end - begin, not self._greatest)
        if found is not None:
            within = np.arange(begin, end if goes_on else min(end, last + 1))
            result[: len(within)] = accumulated(ufunc, found[::-1])[::-1][np.clip(within - pending, 0, last - pending)]
        elif goes_on:
            result[:] = self._operand.bound_or_extreme(side, last, last + 1)
        elif pending <= last and self._greatest == (side == 1):
            result[: max(0, last + 1 - begin)] = self.clock.extreme(side == 1)
        ufunc(result[: len(starts)], starts, out=result[: len(starts)])
        return result


class UntilStream(Stream):
    """``right`` within a number of steps, or before the end of the run, and ``left`` until then."""

    def __init__(
        self, clock: Clock, left: Stream, right: Stream, last: int | None, starts: int | None, lasts: int | None
    ) -> None:
        self._together = Together(clock, [left, right], lasts)
        horizon = self._together.horizon
        super().__init__(clock, None if horizon is None or last is None else horizon + last, self._together.reach)
        self._last = last
        self._window = None if last is None else UntilWindow(last + 1, clock.single, clock.value(False))
        self._last_start = starts
        #: For each start that is needed: the minimum of left, and the robustness, so far.
        self._least = History(clock.rows, dtype=clock.dtype)
        self._until = History(clock.rows, dtype=clock.dtype)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        found = self._together.push(samples)
        if found is None:
            return None
        left, right = found
        least, until = self._least, self._until
        if least.end > least.first:
            lefts, untils = (each.between(each.first, each.end) for each in (least, until))
            np.maximum(untils, np.minimum(lefts, right), out=untils)
            np.minimum(lefts, left, out=lefts)
        if self._last_start is None or least.end <= self._last_start:
            least.append(left)
            until.append(right)
        if self._window is None or self._last is None:
            return None
        for each in (least, until):
            each.drop(min(self._known - self._last + 1, each.end))
        value = self._window.push(left, right)
        if self._known < self._last:
            return None
        self.exact += 1
        return value

    @property
    def _known(self) -> int:
        horizon = self._together.horizon
        return -1 if horizon is None else max(-1, self.clock.now - horizon)

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        after = self._known + 1
        last = self._last
        begun = max(0, min(end, after) - begin)
        pending = max(begin, after)
        if last is not None:
            stop = end + last
        elif side == 0 or self.clock.ended:
            stop = max(self.clock.now + 1, pending)
        else:
            stop = max(self.clock.now + self.reach + 1, end) + 1
        right = self._together.bound(1, side, pending, stop) if pending < stop else None
        if right is None and pending < stop and end <= stop and side == 1 and not begun:
            return None
        if right is None:
            right = self.clock.full(stop - pending, side == 1)
        left = self._together.bound(0, side, pending, stop) if pending < stop else None
        if left is None:
            left = self.clock.full(stop - pending, side == 1)
        result = self.clock.full(end - begin, False)
        if last is None:
            later = right.copy()
            for i in range(len(later) - 2, -1, -1):
                np.maximum(later[i], np.minimum(left[i], later[i + 1]), out=later[i])
            some = later[: max(end - pending, 0)]
            result[begun : begun + len(some)] = some
            from_now = later[:1]
        else:
            if end > pending:
                result[begun:] = sliding_until(left[: stop - pending], right, last + 1)
            held = accumulated(np.minimum, np.concatenate([self.clock.full(1, True), left[:-1]]))
            from_now = accumulated(np.maximum, np.minimum(right, held))
            from_now = from_now[np.arange(begin, begin + begun) + last - after]
        if begun:
            least, until = (each.between(begin, begin + begun) for each in (self._least, self._until))
            result[:begun] = np.maximum(until, np.minimum(least, from_now)) if len(from_now) else until
        return result
