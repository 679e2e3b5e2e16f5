"""The bounds of a formula straight from the definitions of its operators: slow, and independent of the monitors."""

import math
from collections.abc import Sequence
from functools import cache

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

INF = math.inf


def interval(
    formula: Formula, samples: Sequence[Sequence[float]], instant: int, known: int, ended: bool
) -> tuple[float, float]:
    """Least and greatest robustness of a formula at an instant.

    Args:
        formula: The formula.
        samples: Of each predicate its robustness at each instant.
        instant: Where the formula is evaluated.
        known: Number of instants whose samples are known.
        ended: Whether the run ends with these; otherwise it may end there or go on for as long as one likes.
    """
    # After `far` nothing that is known has an influence but through what looks back without limit.
    far = known + _reach(formula) + 1

    @cache
    def bounds(of: Formula, t: int) -> tuple[float, float]:
        match of:
            case Constant(value):
                return (INF, INF) if value else (-INF, -INF)
            case Predicate(index):
                return (samples[index][t], samples[index][t]) if t < known else (-INF, INF)
            case Not(operand):
                low, high = bounds(operand, t)
                return -high, -low
            case And(operands):
                each = [bounds(operand, t) for operand in operands]
                return min(low for low, _ in each), min(high for _, high in each)
            case Or(operands):
                each = [bounds(operand, t) for operand in operands]
                return max(low for low, _ in each), max(high for _, high in each)
            case Always(first, last, operand):
                lows, highs = windows(t, first, last)
                return (
                    min((bounds(operand, at)[0] for at in highs), default=INF),
                    min((bounds(operand, at)[1] for at in lows), default=INF),
                )
            case Eventually(first, last, operand):
                lows, highs = windows(t, first, last)
                return (
                    max((bounds(operand, at)[0] for at in lows), default=-INF),
                    max((bounds(operand, at)[1] for at in highs), default=-INF),
                )
            case Until(first, last, left, right):
                lows, highs = windows(t, first, last)
                return until(left, right, t, lows, 0), until(left, right, t, highs, 1)
            case Historically(first, last, operand):
                past = range(0 if last is None else max(0, t - last), t - first + 1)
                return (
                    min((bounds(operand, at)[0] for at in past), default=INF),
                    min((bounds(operand, at)[1] for at in past), default=INF),
                )
            case Once(first, last, operand):
                past = range(0 if last is None else max(0, t - last), t - first + 1)
                return (
                    max((bounds(operand, at)[0] for at in past), default=-INF),
                    max((bounds(operand, at)[1] for at in past), default=-INF),
                )
            case Since(first, last, left, right):
                past = range(0 if last is None else max(0, t - last), t - first + 1)
                low, high = (
                    max(
                        (
                            min(
                                [
                                    bounds(right, at)[side],
                                    *(bounds(left, between)[side] for between in range(at + 1, t + 1)),
                                ]
                            )
                            for at in past
                        ),
                        default=-INF,
                    )
                    for side in (0, 1)
                )
                return low, high

    def windows(t: int, first: int, last: int | None) -> tuple[range, range]:
        """The instants ahead if the run is as short as can be, and if it is as long."""
        if last is not None:
            both = range(t + first, t + last + 1)
            return both, both
        shortest = range(t + first, known)
        return shortest, shortest if ended else range(t + first, max(far, t + first) + 1)

    def until(left: Formula, right: Formula, t: int, window: range, side: int) -> float:
        return max(
            (
                min([bounds(right, at)[side], *(bounds(left, between)[side] for between in range(t, at))])
                for at in window
            ),
            default=-INF,
        )

    return bounds(formula, instant)


def _reach(formula: Formula) -> int:
    """A number of steps beyond which windows of a formula do not reach back."""
    match formula:
        case Constant() | Predicate():
            return 0
        case Not(operand):
            return _reach(operand)
        case And(operands) | Or(operands):
            return max((_reach(operand) for operand in operands), default=0)
        case Always(_, _, operand) | Eventually(_, _, operand):
            return _reach(operand)
        case Historically(first, last, operand) | Once(first, last, operand):
            return _reach(operand) + (first if last is None else last) + 1
        case Until(_, _, left, right):
            return max(_reach(left), _reach(right))
        case Since(first, last, left, right):
            return max(_reach(left), _reach(right)) + (first if last is None else last) + 1
