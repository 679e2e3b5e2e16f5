"""Finds the critical sample of a formula: the one that explains why it holds or fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Array, Formula, operands
from symaware_cli.specification.whole import Bounds, bounds


@dataclass(frozen=True, slots=True)
class Reason:
    """The critical sample of a formula, or the operator whose window has no instant.

    Attributes:
        predicate: The index of its predicate; None if an operator without instants, or a constant, decides.
        instant: The number of the instant of the sample, or of that operator.
        robustness: The robustness of the predicate at that instant; infinite where there is no predicate.
        path: The operand positions that lead from the formula to the predicate or operator.
        instants: The instant of each formula on that path, from the formula itself to the predicate or operator.
        value: The bound of the robustness of the formula at its first instant that the sample accounts for: the
            robustness of the predicate or, below an odd number of negations, its opposite.
    """

    predicate: int | None
    instant: int
    robustness: float
    path: tuple[int, ...]
    instants: tuple[int, ...]
    value: float


def reasons(
    formula: Formula, samples: Sequence[Array], instants: int, ended: bool, side: int | None = None
) -> list[Reason | None]:
    """Find, for each row, the sample that accounts for a bound of the robustness of a formula at the first instant.

    Args:
        formula: The formula.
        samples: Robustness of each predicate [instants, rows].
        instants: Number of instants whose samples are known.
        ended: Whether the declared run ends with the last of these instants.
        side: The bound: 0 for the lower, 1 for the upper one. By default that which decides the verdict: the lower
            bound if the formula holds, otherwise the upper bound or, if that is infinite, the lower one.

    Returns:
        The earliest sample whose robustness equals the bound; None if nothing is known of it.
    """
    rows = samples[0].shape[1]
    known: dict[Formula, Bounds] = {}
    return [_Trace(samples, instants, ended, row, known).reason(formula, side) for row in range(rows)]


class _Trace:
    def __init__(
        self, samples: Sequence[Array], instants: int, ended: bool, row: int, known: dict[Formula, Bounds]
    ) -> None:
        self.samples = samples
        self.instants = instants
        self.ended = ended
        self.row = row
        self.known = known

    def reason(self, formula: Formula, side: int | None) -> Reason | None:
        lower, upper = self.among(formula, 0, 1)[0]
        if side is None:
            side = 0 if lower > 0.0 or not (upper < 0.0 or np.isfinite(upper)) else 1
        value = float((lower, upper)[side])
        path: list[int] = []
        t, instants = 0, [0]
        while not isinstance(formula, stl.Predicate):
            step = self.step(formula, t, side)
            if step is None:
                return Reason(None, t, np.inf, tuple(path), tuple(instants), value)
            if isinstance(formula, stl.Not):
                side = 1 - side
            position, t = step
            formula = operands(formula)[position]
            path.append(position)
            instants.append(t)
        if t >= self.instants:
            return None
        robustness = float(self.samples[formula.index][t, self.row])
        return Reason(formula.index, t, robustness, tuple(path), tuple(instants), value)

    def step(self, formula: Formula, t: int, side: int) -> tuple[int, int] | None:
        """Return the first operand, and its first instant, whose bound equals that of the formula at an instant."""
        value = self.among(formula, t, t + 1)[0, side]
        match formula:
            case stl.Not():
                return 0, t
            case stl.And() | stl.Or():
                equal = (
                    (position, t)
                    for position, each in enumerate(formula.operands)
                    if self.among(each, t, t + 1)[0, side] == value
                )
                return next(equal, None)
            case stl.Next():
                return self.first(0, formula.operand, t + 1, t + 2, side, value)
            case stl.Always() | stl.Eventually():
                return self.first(0, formula.operand, t + formula.first, self.end(formula, t), side, value)
            case stl.Historically() | stl.Once():
                begin = 0 if formula.last is None else max(0, t - formula.last)
                return self.first(0, formula.operand, begin, t - formula.first + 1, side, value)
            case stl.Until():
                begin, end = t + formula.first, self.end(formula, t)
                lefts, rights = (self.among(each, t, end)[:, side] for each in (formula.left, formula.right))
                so_far = np.minimum.accumulate(np.concatenate([[np.inf], lefts[:-1]]))
                found = np.flatnonzero(np.minimum(rights, so_far)[formula.first :] == value)
                if not len(found):
                    return None
                at = begin + int(found[0])
                return (1, at) if rights[at - t] == value else self.first(0, formula.left, t, at, side, value)
            case stl.Since():
                begin, end = 0 if formula.last is None else max(0, t - formula.last), t - formula.first + 1
                lefts, rights = (self.among(each, begin, t + 1)[:, side] for each in (formula.left, formula.right))
                since = np.minimum.accumulate(np.concatenate([lefts[1:], [np.inf]])[::-1])[::-1]
                found = np.flatnonzero(np.minimum(rights, since)[: max(end - begin, 0)] == value)
                if not len(found):
                    return None
                at = begin + int(found[0])
                return (
                    (1, at) if rights[at - begin] == value else self.first(0, formula.left, at + 1, t + 1, side, value)
                )
        return None

    def end(self, formula: stl.Always | stl.Eventually | stl.Until, t: int) -> int:
        """Return the instant after a window ahead; of an unbounded one, after the known values of the operands."""
        if formula.last is not None:
            return t + formula.last + 1
        if self.ended:
            return max(t, self.instants)
        known = (self.bounds(each) for each in operands(formula))
        return max(t + formula.first, self.instants, *(len(each.values) for each in known)) + 1

    def first(
        self, position: int, formula: Formula, begin: int, end: int, side: int, value: float
    ) -> tuple[int, int] | None:
        found = np.flatnonzero(self.among(formula, begin, end)[:, side] == value)
        return (position, begin + int(found[0])) if len(found) else None

    def among(self, formula: Formula, begin: int, end: int) -> Array:
        """Return bounds at successive instants [instants, 2]."""
        return self.bounds(formula).upto(max(end, 0))[begin:, :, self.row]

    def bounds(self, formula: Formula) -> Bounds:
        """Return the bounds of all rows, computed once."""
        if formula not in self.known:
            self.known[formula] = bounds(formula, self.samples, self.instants, self.samples[0].shape[1], self.ended)
        return self.known[formula]
