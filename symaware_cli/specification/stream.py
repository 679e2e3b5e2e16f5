"""Formulas evaluated instant by instant.

A stream stands for a formula, and has streams for its operands. Pushed once at each instant, it returns the exact
robustness at the instant that lies its horizon back, in time that does not depend on the widths of windows. Of instants
after that one it tells bounds when asked: those between which the robustness lies, whatever the samples to come
(Deshmukh et al., "Robust online monitoring of signal temporal logic", RV 2015). All arrays have the rows along their
last axis; they hold robustness, or the truth alone, for which falsehood is less than truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from symaware_cli.specification.formula import (
    Always,
    And,
    Constant,
    Eventually,
    Formula,
    Historically,
    Not,
    Once,
    Or,
    Predicate,
    Since,
    Until,
)
from symaware_cli.specification.sliding import (
    EXTREMA,
    Extremum,
    History,
    Recent,
    Starts,
    UntilWindow,
    Values,
    accumulated,
    highest,
    lowest,
    sliding,
    sliding_until,
)


class Clock:
    """What streams of a formula have in common.

    Attributes:
        rows: Number of rows.
        boolean: Whether streams hold the truth alone.
        single: Whether values are pushed as numbers of a single row instead of arrays [rows].
        now: The last instant that was pushed.
        ended: Whether the declared run ends with it.
    """

    def __init__(self, rows: int, boolean: bool) -> None:
        self.rows = rows
        self.boolean = boolean
        self.single = rows == 1
        self.now = -1
        self.ended = False

    @property
    def dtype(self) -> type:
        """The type of robustness or truth."""
        return bool if self.boolean else float

    def extreme(self, greatest: bool) -> float | bool:
        """The greatest or the least value."""
        return highest(self.dtype) if greatest else lowest(self.dtype)

    def value(self, greatest: bool) -> Any:
        """The greatest or least value, as it is pushed."""
        return self.extreme(greatest) if self.single else self.full(1, greatest)[0]

    def full(self, instants: int, greatest: bool) -> Values:
        """So many instants of the greatest or least value [instants, rows]."""
        return np.full((instants, self.rows), self.extreme(greatest))


class Stream:
    """A formula that is evaluated instant by instant.

    Attributes:
        clock: The common clock.
        horizon: The number of steps after which exact values are known; None if only at the end of the run.
        reach: The number of steps ahead of now after which bounds no longer change from one instant to the next.
        soonest: The numbers of steps before which nothing is known of lower and upper bounds; infinite for never, as
            long as the run goes on.
        exact: The last instant whose exact value was returned, or -1.
    """

    def __init__(
        self, clock: Clock, horizon: int | None, reach: int, soonest: tuple[float, float] = (-np.inf, -np.inf)
    ) -> None:
        self.soonest = soonest
        self.exact = -1
        self.clock = clock
        self.horizon = horizon
        self.reach = reach

    def push(self, samples: Sequence[Any]) -> Any:
        """Go on by an instant, after the clock has.

        Args:
            samples: Robustness or truth of each predicate. Nobody writes to these arrays, nor to those returned.

        Returns:
            The exact value at the instant that lies the horizon back; None as long as there is no such instant.
        """
        raise NotImplementedError

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """Lower (side 0) or upper (side 1) bounds at instants after the last one whose exact value was returned.

        Returns:
            The bounds from `begin` up to but not including `end` [instants, rows], not to be written to; None where
            nothing is known of any of them.
        """
        raise NotImplementedError

    def known(self, side: int, begin: int, end: int) -> Values | None:
        """Bounds, without asking where nothing can be known yet."""
        return None if self.clock.now < begin + self.soonest[side] else self.bound(side, begin, end)

    def bound_or_extreme(self, side: int, begin: int, end: int) -> Values:
        """Bounds, which are infinite where nothing is known."""
        found = self.bound(side, begin, end) if begin < end else None
        return self.clock.full(max(end - begin, 0), side == 1) if found is None else found


class ConstantStream(Stream):
    """What always holds, or never does."""

    def __init__(self, clock: Clock, value: bool) -> None:
        super().__init__(clock, 0, 0)
        self._value = value
        self._row = clock.value(value)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        self.exact += 1
        return self._row

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        return None if self._value == (side == 1) else self.clock.full(end - begin, self._value)


class PredicateStream(Stream):
    """A predicate."""

    def __init__(self, clock: Clock, index: int) -> None:
        super().__init__(clock, 0, 0, (0, 0))
        self._index = index

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        self.exact += 1
        return samples[self._index]

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        return None


class NotStream(Stream):
    """A negation."""

    def __init__(self, clock: Clock, operand: Stream) -> None:
        super().__init__(clock, operand.horizon, operand.reach, operand.soonest[::-1])
        self._operand = operand

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value = self._operand.push(samples)
        if value is None:
            return None
        self.exact += 1
        if self.clock.boolean:
            return not value if self.clock.single else np.logical_not(value)
        return -value

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        found = self._operand.bound(1 - side, begin, end)
        if found is None:
            return None
        return np.logical_not(found) if self.clock.boolean else np.negative(found)


class Together:
    """Operands whose exact values are known after different times, brought to the same instants."""

    def __init__(self, clock: Clock, operands: Sequence[Stream], last: int | None) -> None:
        """Bring operands together.

        Args:
            clock: The common clock.
            operands: The streams of the operands.
            last: The last instant whose bounds are asked for, if any.
        """
        horizons = [each.horizon for each in operands if each.horizon is not None]
        self.operands = list(operands)
        self.horizon = max(horizons) if len(horizons) == len(operands) else None
        self.reach = max(each.reach for each in operands)
        self._last = last
        self._early = [None if each.horizon == self.horizon else Recent() for each in operands]

    def push(self, samples: Sequence[Any]) -> list[Any] | None:
        """Exact values at the same instant, if all know one."""
        found: list[Any] = []
        horizon = self.horizon
        for operand, early in zip(self.operands, self._early, strict=False):
            value = operand.push(samples)
            if value is None:
                continue
            if early is None:
                found.append(value)
            elif horizon is not None:
                value = early.delayed(value, horizon - (operand.horizon or 0))
                if value is not None:
                    found.append(value)
            elif self._last is None or early.end <= self._last:
                early.append(value)
        return found if len(found) == len(self.operands) else None

    def bound(self, position: int, side: int, begin: int, end: int) -> Values | None:
        """Bounds of an operand; as they are known after exact values of all."""
        operand, early = self.operands[position], self._early[position]
        exact = operand.exact + 1
        if early is None or begin >= exact:
            return operand.bound(side, begin, end)
        if end <= exact:
            return early.between(begin, end, operand.clock.rows)
        later = operand.bound(side, exact, end)
        if later is None:
            later = operand.clock.full(end - exact, side == 1)
        return np.concatenate([early.between(begin, exact, operand.clock.rows), later])


class JunctionStream(Stream):
    """A conjunction, or a disjunction."""

    def __init__(self, clock: Clock, operands: Sequence[Stream], greatest: bool, last: int | None) -> None:
        self._together = Together(clock, operands, last)
        lower, upper = ([each.soonest[side] for each in operands] for side in (0, 1))
        soonest = (min(lower), max(upper)) if greatest else (max(lower), min(upper))
        super().__init__(clock, self._together.horizon, self._together.reach, soonest)
        self._greatest = greatest
        # What is known late is known least.
        late = [(0 if each.horizon is None else 1, -(each.horizon or 0)) for each in operands]
        self._order = sorted(range(len(operands)), key=late.__getitem__)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        found = self._together.push(samples)
        if found is None:
            return None
        self.exact += 1
        return reduce(EXTREMA[self.clock.single][self._greatest], found)

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        ufunc = np.maximum if self._greatest else np.minimum
        result = None
        for position in self._order:
            found = self._together.bound(position, side, begin, end)
            if found is not None:
                result = found if result is None else ufunc(result, found)
            elif self._greatest == (side == 1):
                return None
        return result


class AheadStream(Stream):
    """The least or greatest in a window ahead."""

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
        self._starts = Starts(first, last, greatest, starts, clock.rows, clock.dtype)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        value = self._operand.push(samples)
        if value is None:
            return None
        at = self._operand.exact
        if self._window is not None:
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
            # Most often the last instant tells that nothing is known yet.
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
            # All windows have begun: they have the first of these instants in common.
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


class ToTheEndStream(Stream):
    """The least or greatest from an instant on to the end of the run."""

    def __init__(self, clock: Clock, operand: Stream, greatest: bool, starts: int | None) -> None:
        super().__init__(clock, None, operand.reach)
        self._operand = operand
        self._greatest = greatest
        #: Of each instant that is asked for, the extremum so far; if all are, the values instead, as few ask for these.
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
        """The extrema so far of the instants from one to another that have been pushed [instants, rows]."""
        if self._last_start is not None:
            return self._starts.between(begin, max(begin, min(end, self._starts.end)))
        if begin >= min(end, self._values.end):
            return self.clock.full(0, False)
        values = self._values.between(begin, self._values.end, self.clock.rows)
        return accumulated(np.maximum if self._greatest else np.minimum, values[::-1])[::-1][: max(end - begin, 0)]

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class.

        The run may end now or go on for ever, so that each bound is that of the worse of both.
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
        if found is None and not len(starts) and not goes_on and not self.clock.ended:
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


class AgoStream(Stream):
    """The least or greatest in a window of the past."""

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
    """The least or greatest from the beginning of the run on."""

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


class UntilStream(Stream):
    """Right at most so many steps ahead, or before the end of the run, and left up to then."""

    def __init__(
        self, clock: Clock, left: Stream, right: Stream, last: int | None, starts: int | None, lasts: int | None
    ) -> None:
        self._together = Together(clock, [left, right], lasts)
        horizon = self._together.horizon
        super().__init__(clock, None if horizon is None or last is None else horizon + last, self._together.reach)
        self._last = last
        self._window = None if last is None else UntilWindow(last + 1, clock.single, clock.value(False))
        self._last_start = starts
        #: Of each start that is asked for, the least of left and the robustness, so far.
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


class SinceStream(Stream):
    """Right at some instant up to now, and left after it."""

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


def stream(formula: Formula, clock: Clock, last: int | None) -> Stream:
    """A stream for a formula.

    Args:
        formula: The formula.
        clock: The common clock, and what is evaluated: robustness or truth.
        last: The last instant at which bounds are asked for; -1 for none at all, None for all.
    """

    def further(steps: int) -> int | None:
        return last if last is None or last < 0 else last + steps

    ever = -1 if last == -1 else None
    greatest = isinstance(formula, Or | Eventually | Once)
    match formula:
        case Constant():
            return ConstantStream(clock, formula.value)
        case Predicate():
            return PredicateStream(clock, formula.index)
        case Not():
            return NotStream(clock, stream(formula.operand, clock, last))
        case And() | Or():
            if len(formula.operands) == 1:
                return stream(formula.operands[0], clock, last)
            operands = [stream(each, clock, last) for each in formula.operands]
            return JunctionStream(clock, operands, greatest, last)
        case Always(first, None) | Eventually(first, None) | Historically(first, None) | Once(first, None) if first:
            shifted = replace(formula, last=first, operand=replace(formula, first=0))
            return stream(shifted, clock, last)
        case Always(_, None, operand) | Eventually(_, None, operand):
            return ToTheEndStream(clock, stream(operand, clock, ever), greatest, last)
        case Always(first, int(until), operand) | Eventually(first, int(until), operand):
            return AheadStream(clock, stream(operand, clock, further(until)), first, until, greatest, last)
        case Historically(_, None, operand) | Once(_, None, operand):
            return SoFarStream(clock, stream(operand, clock, last), greatest)
        case Historically(first, int(until), operand) | Once(first, int(until), operand):
            return AgoStream(clock, stream(operand, clock, last), first, until, greatest)
        case Until(0, until, left, right):
            below = ever if until is None else further(until)
            return UntilStream(clock, stream(left, clock, below), stream(right, clock, below), until, last, below)
        case Until(first, until, left, right):
            within = Until(0, None if until is None else until - first, left, right)
            both = (Always(0, first - 1, left), Eventually(first, first, within))
            return stream(And(both), clock, last)
        case Since(0, None, left, right):
            return SinceStream(clock, stream(left, clock, last), stream(right, clock, last), last)
        case Since(first, until, left, right):
            parts: list[Formula] = [Since(0, None, left, right)]
            if first:
                parts = [Once(first, first, parts[0]), Historically(0, first - 1, left)]
            if until is not None:
                parts.append(Once(first, until, right))
            return stream(And(tuple(parts)), clock, last)
    raise TypeError(f"{formula!r} is no formula")
