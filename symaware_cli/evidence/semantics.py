"""The robustness of formulas on recorded samples, computed directly from the definitions of the operators.

It shares no code with the monitors that run during a simulation, and is deliberately simple, so that it can check their
verdicts: every window is written out, and its least or greatest element is taken.

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
    """The bounds of the possible robustness at each instant; each of shape (instants, rows)."""

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
        instants: The number of known instants.
        rows: The number of rows.
        ended: Whether the run ends with the known instants; otherwise it may end there, or continue arbitrarily long.
        cut: Whether bounded windows are also truncated to the known instants, so that the last instant has no
            successor, as in linear temporal logic over finite traces.
        times: The number of instants to evaluate, from the first on; by default all known ones. Evaluating a single one
            is cheap: an operator without nested ones then takes time linear in `instants`, otherwise quadratic.
    """
    # From `far` on, all values are constant: known samples affect them only through past operators with unbounded
    # windows.
    far = instants + _look_back(formula)
    unknown = np.full((far + 1 - instants, rows), np.inf)

    def of(part: Formula, times: int = far + 1) -> RobustInterval:
        """Return the bounds of a subformula at the first `times` instants."""
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
                else:  # the run may end at any instant from the last known one on
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
        """Return the instants from t to the end of a window; without an end, for the longest or the shortest run."""
        if cut or (last is None and (ended or not longest)):
            return np.arange(t, instants if last is None else min(t + last + 1, instants))
        steps = far + 1 if last is None else min(last, far + 1)
        return np.minimum(np.arange(t, t + steps + 1), far)

    def back(t: int, last: int | None) -> Instants:
        """Return the instants from t back to the beginning of a window in the past."""
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
        """Return the maximum over a window of min(right, all left values nearer to the instant than right)."""
        held = np.minimum.accumulate(np.concatenate([np.full((1, rows), np.inf), left[:-1]]))[: len(right)]
        greatest: Array = np.minimum(right, held)[first:].max(axis=0, initial=-np.inf)
        return greatest

    return of(formula, instants if times is None else times)


def _look_back(formula: Formula) -> int:
    """Return a bound, in instants, of how far the windows of a formula look back, apart from unbounded ones."""
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
