"""Streams: formulas evaluated online, instant by instant.

A stream evaluates a formula and has streams for its operands. It is pushed once at each instant and returns the exact
robustness at the instant that lies its horizon back, in time independent of the widths of windows. For later instants
it computes bounds on request: an interval that contains the robustness for all continuations (Deshmukh et al., "Robust
online monitoring of signal temporal logic", RV 2015). All arrays have the rows along their last axis; they hold
robustness, or truth values, where false is less than true.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from symaware_cli.specification.sliding import EXTREMA, Recent, Values


class Clock:
    """The state that all streams of a formula share.

    Attributes:
        rows: Number of rows.
        boolean: Whether streams hold truth values instead of robustness.
        single: Whether values are pushed as numbers of a single row instead of arrays [rows].
        now: The last instant that was pushed.
        ended: Whether the declared run ends with `now`.
    """

    def __init__(self, rows: int, boolean: bool, single: bool) -> None:
        self.rows = rows
        self.boolean = boolean
        self.single = single
        self.now = -1
        self.ended = False

    @property
    def dtype(self) -> type:
        """The type of the values: bool or float."""
        return bool if self.boolean else float

    def extreme(self, greatest: bool) -> float | bool:
        """Return the greatest or the least possible value."""
        return greatest if self.boolean else np.inf if greatest else -np.inf

    def value(self, greatest: bool) -> Any:
        """Return the greatest or least possible value in the form that is pushed."""
        return self.extreme(greatest) if self.single else self.full(1, greatest)[0]

    def full(self, instants: int, greatest: bool) -> Values:
        """Return an array of the greatest or least possible value [instants, rows]."""
        return np.full((instants, self.rows), self.extreme(greatest))


class Stream:
    """A formula that is evaluated instant by instant.

    Attributes:
        clock: The common clock.
        horizon: The number of steps after which exact values are known; None if only at the end of the run.
        reach: The number of steps ahead of `now` beyond which bounds no longer change from one instant to the next.
        soonest: The numbers of steps before which lower and upper bounds are trivial; infinite if they are until the
            run ends.
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

    @property
    def is_momentary(self) -> bool:
        """Whether each value is known at once, and nothing is known of later ones."""
        return False

    @property
    def is_changed(self) -> bool:
        """Whether the last push may have changed the bounds at the first instant."""
        return True

    def push(self, samples: Sequence[Any]) -> Any:
        """Process the samples of an instant; the clock has been advanced before.

        Args:
            samples: Robustness or truth of each predicate. These arrays, and those returned, must not be written to.

        Returns:
            The exact value at the instant that lies the horizon back; None if there is no such instant yet.
        """
        raise NotImplementedError

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """Return lower (side 0) or upper (side 1) bounds at instants after `exact`.

        Returns:
            The bounds from `begin` up to but not including `end` [instants, rows], not to be written to; None if all of
            them are trivial.
        """
        raise NotImplementedError

    def known(self, side: int, begin: int, end: int) -> Values | None:
        """Return bounds, without evaluating them where they must be trivial."""
        return None if self.clock.now < begin + self.soonest[side] else self.bound(side, begin, end)

    def first(self) -> tuple[Values | None, Values | None]:
        """Return the bounds at the first instant [rows], in arrays that never change; None where they are trivial."""
        lower, upper = self.known(0, 0, 1), self.known(1, 0, 1)
        return None if lower is None else lower[0].copy(), None if upper is None else upper[0].copy()

    def bound_or_extreme(self, side: int, begin: int, end: int) -> Values:
        """Return bounds, infinite where they are trivial."""
        found = self.bound(side, begin, end) if begin < end else None
        return self.clock.full(max(end - begin, 0), side == 1) if found is None else found


class ConstantStream(Stream):
    """A formula that always holds, or never does."""

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

    @property
    def is_momentary(self) -> bool:
        """See the base class."""
        return True

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

    @property
    def is_momentary(self) -> bool:
        """See the base class."""
        return self._operand.is_momentary

    @property
    def is_changed(self) -> bool:
        """See the base class."""
        return self._operand.is_changed

    def bound(self, side: int, begin: int, end: int) -> Values | None:
        """See the base class."""
        found = self._operand.bound(1 - side, begin, end)
        if found is None:
            return None
        return np.logical_not(found) if self.clock.boolean else np.negative(found)


class Together:
    """Aligns operands whose exact values become known after different times."""

    def __init__(self, clock: Clock, operands: Sequence[Stream], last: int | None) -> None:
        """Align operands.

        Args:
            clock: The common clock.
            operands: The streams of the operands.
            last: The last instant whose bounds are needed, if any.
        """
        horizons = [each.horizon for each in operands if each.horizon is not None]
        self.operands = list(operands)
        self.horizon = max(horizons) if len(horizons) == len(operands) else None
        self.reach = max(each.reach for each in operands)
        self._last = last
        self._early = [None if each.horizon == self.horizon else Recent() for each in operands]
        #: Of each that is known early, by how many steps.
        self._ahead = [(self.horizon or 0) - (each.horizon or 0) for each in operands]

    def push(self, samples: Sequence[Any]) -> list[Any] | None:
        """Push samples; return the exact values of all operands at the next common instant, if all are known."""
        found: list[Any] = []
        for position, operand in enumerate(self.operands):
            value = operand.push(samples)
            if value is None:
                continue
            early = self._early[position]
            if early is None:
                found.append(value)
            elif self.horizon is not None:
                value = early.delayed(value, self._ahead[position])
                if value is not None:
                    found.append(value)
            elif self._last is None or early.end <= self._last:
                early.append(value)
        return found if len(found) == len(self.operands) else None

    def bound(self, position: int, side: int, begin: int, end: int) -> Values | None:
        """Return bounds of an operand at instants after the last common exact value."""
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
    """A conjunction or a disjunction."""

    def __init__(self, clock: Clock, operands: Sequence[Stream], greatest: bool, last: int | None) -> None:
        self._together = Together(clock, operands, last)
        lower, upper = ([each.soonest[side] for each in operands] for side in (0, 1))
        soonest = (min(lower), max(upper)) if greatest else (max(lower), min(upper))
        super().__init__(clock, self._together.horizon, self._together.reach, soonest)
        self._greatest = greatest
        # Operands with the longest horizons first: their bounds are most often trivial.
        late = [(0 if each.horizon is None else 1, -(each.horizon or 0)) for each in operands]
        self._order = sorted(range(len(operands)), key=late.__getitem__)

    def push(self, samples: Sequence[Any]) -> Any:
        """See the base class."""
        found = self._together.push(samples)
        if found is None:
            return None
        self.exact += 1
        single, greatest = self.clock.single, self._greatest
        if single and len(found) == 2:
            # Comparing numbers here takes half as long as `min` and `max`.
            one, other = found
            return other if (other > one if greatest else other < one) else one
        return reduce(EXTREMA[single][greatest], found)

    @property
    def is_momentary(self) -> bool:
        """See the base class."""
        return all(each.is_momentary for each in self._together.operands)

    @property
    def is_changed(self) -> bool:
        """See the base class."""
        return any(each.is_changed for each in self._together.operands)

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
