"""The robustness of formulas on recorded samples, straight from the definitions of the operators.

It shares no code with the monitors that run along with a simulation, and nothing here is clever, so that verdicts can
be checked by it: every window is written out, and its least or greatest element is taken.

Reasons: docs/decisions/0056-next-at-the-end-of-a-run.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Array, Formula

Instants = NDArray[np.intp]


class RobustInterval(NamedTuple):
    """The least and the greatest robustness that are possible at each instant; each of shape (instants, rows)."""

    low: Array
    high: Array


def robustness_interval(
    formula: Formula,
    samples: Sequence[Array],
    instants: int,
    rows: int,
    ended: bool,
    *,
    cut: bool = False,
    times: int | None = None,
) -> RobustInterval:
    """Evaluate a formula at each instant.

    Args:
        formula: The formula.
        samples: The encoded robustness of each predicate at each known instant; each of shape (instants, rows).
        instants: How many instants are known.
        rows: How many rows there are.
        ended: Whether the run ends with these; otherwise it may end there, or go on for as long as one likes.
        cut: Whether windows with an end are cut to what is known as well: so that after the end nothing is next, as in
            linear temporal logic over finite runs.
        times: At how many instants, from the first on; by default at all that are known. To evaluate one is cheap: an
            operator without others below it then takes time in proportion to `instants`, otherwise to their square.
    """
    # From `far` on all values stay the same: what is known has an influence there only through operators that look
    # back without limit.
    far = instants + _look_back(formula)
    unknown = np.full((far + 1 - instants, rows), np.inf)

    def of(part: Formula, times: int = far + 1) -> RobustInterval:
        """The bounds of a part at so many instants."""
        match part:
            case stl.Constant(value):
                truth = np.full((times, rows), np.inf if value else -np.inf)
                return RobustInterval(truth, truth)
            case stl.Predicate(index):
                known = samples[index].reshape(instants, rows)
                return RobustInterval(
                    np.concatenate([known, -unknown])[:times], np.concatenate([known, unknown])[:times]
                )
            case stl.Not(operand):
                low, high = of(operand, times)
                return RobustInterval(-high, -low)
            case stl.And(operands):
                lows, highs = zip(*(of(each, times) for each in operands), strict=True)
                return RobustInterval(np.minimum.reduce(lows), np.minimum.reduce(highs))
            case stl.Or(operands):
                lows, highs = zip(*(of(each, times) for each in operands), strict=True)
                return RobustInterval(np.maximum.reduce(lows), np.maximum.reduce(highs))
            case stl.Always(first, last, operand):
                low, high = of(operand)
                return RobustInterval(least(low, times, first, last, True), least(high, times, first, last, False))
            case stl.Eventually(first, last, operand):
                low, high = of(operand)
                return RobustInterval(-least(-low, times, first, last, False), -least(-high, times, first, last, True))
            case stl.Next(operand, weak):
                low, high = (each[np.minimum(np.arange(times) + 1, far)] for each in of(operand))
                missing = np.inf if weak else -np.inf
                if ended:
                    low[instants - 1 : instants] = high[instants - 1 : instants] = missing
                else:  # the run may end with any instant from the last known one on
                    (high if weak else low)[instants - 1 :] = missing
                return RobustInterval(low, high)
            case stl.Until(first, last, left, right):
                lows, highs = zip(of(left), of(right), strict=True)
                return RobustInterval(
                    reached(*lows, times, first, last, False), reached(*highs, times, first, last, True)
                )
            case stl.Historically(first, last, operand):
                return RobustInterval(*(least_before(each, times, first, last) for each in of(operand)))
            case stl.Once(first, last, operand):
                return RobustInterval(*(-least_before(-each, times, first, last) for each in of(operand)))
            case stl.Since(first, last, left, right):
                return RobustInterval(
                    *(since(*pair, times, first, last) for pair in zip(of(left), of(right), strict=True))
                )

    def ahead(t: int, last: int | None, longest: bool) -> Instants:
        """The instants from t to the end of a window; of one without an end, if the run is as long as can be or not."""
        if cut or (last is None and (ended or not longest)):
            return np.arange(t, instants if last is None else min(t + last + 1, instants))
        steps = far + 1 if last is None else min(last, far + 1)
        return np.minimum(np.arange(t, t + steps + 1), far)

    def back(t: int, last: int | None) -> Instants:
        """The instants from t back to the beginning of a window in the past."""
        return np.arange(t, -1 if last is None else max(-1, t - last - 1), -1)

    def least(values: Array, times: int, first: int, last: int | None, longest: bool) -> Array:
        first = min(first, far + 1)
        windows = (ahead(t, last, longest)[first:] for t in range(times))
        return np.array([values[window].min(axis=0, initial=np.inf) for window in windows]).reshape(times, rows)

    def least_before(values: Array, times: int, first: int, last: int | None) -> Array:
        windows = (back(t, last)[first:] for t in range(times))
        return np.array([values[window].min(axis=0, initial=np.inf) for window in windows]).reshape(times, rows)

    def reached(left: Array, right: Array, times: int, first: int, last: int | None, longest: bool) -> Array:
        first = min(first, far + 1)
        windows = (ahead(t, last, longest) for t in range(times))
        return np.array([best(right[window], left[window], first) for window in windows]).reshape(times, rows)

    def since(left: Array, right: Array, times: int, first: int, last: int | None) -> Array:
        windows = (back(t, last) for t in range(times))
        return np.array([best(right[window], left[window], first) for window in windows]).reshape(times, rows)

    def best(right: Array, left: Array, first: int) -> Array:
        """The greatest, over a window, of the least of what is on the right and of all on the left nearer than it."""
        held = np.minimum.accumulate(np.concatenate([np.full((1, rows), np.inf), left[:-1]]))[: len(right)]
        greatest: Array = np.minimum(right, held)[first:].max(axis=0, initial=-np.inf)
        return greatest

    return of(formula, instants if times is None else times)


def _look_back(formula: Formula) -> int:
    """A number of instants beyond which windows of a formula do not look back, but those without a beginning."""
    match formula:
        case stl.Constant() | stl.Predicate():
            return 0
        case stl.Not(operand) | stl.Next(operand) | stl.Always(_, _, operand) | stl.Eventually(_, _, operand):
            return _look_back(operand)
        case stl.And(operands) | stl.Or(operands):
            return max((_look_back(operand) for operand in operands), default=0)
        case stl.Until(_, _, left, right):
            return max(_look_back(left), _look_back(right))
        case stl.Historically(first, last, operand) | stl.Once(first, last, operand):
            return _look_back(operand) + (first if last is None else last) + 1
        case stl.Since(first, last, left, right):
            return max(_look_back(left), _look_back(right)) + (first if last is None else last) + 1
