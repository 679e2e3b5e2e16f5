"""Offline evaluation of formulas: bounds of the robustness at every instant, from all samples so far at once.

The robustness of a formula at an instant lies between two bounds: its values if each sample that is not yet known is as
bad, and as good, as possible (Deshmukh et al., "Robust online monitoring of signal temporal logic", RV 2015). Both are
computed together, in arrays of shape [instants, 2, rows].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Array, Formula
from symaware_cli.specification.sliding import sliding


@dataclass(frozen=True, slots=True)
class Bounds:
    """The bounds of a formula at all instants.

    Attributes:
        values: Lower and upper bounds at the instants from 0 on [instants, 2, rows].
        beyond: The bounds at every later instant [2, rows].
    """

    values: Array
    beyond: Array

    def upto(self, instants: int) -> Array:
        """Return the bounds at the first `instants` instants [instants, 2, rows]."""
        missing = instants - len(self.values)
        if missing <= 0:
            return self.values[:instants]
        return np.concatenate([self.values, np.broadcast_to(self.beyond, (missing, *self.beyond.shape))])


def bounds(formula: Formula, samples: Sequence[Array], instants: int, rows: int, ended: bool) -> Bounds:
    """Compute the bounds of a formula at all instants.

    Args:
        formula: The formula.
        samples: Robustness of each predicate [instants, rows].
        instants: Number of instants whose samples are known.
        rows: Number of rows.
        ended: Whether the declared run ends with the last of these instants.
    """
    return _Evaluation(samples, instants, rows, ended).bounds(formula)


class _Evaluation:
    def __init__(self, samples: Sequence[Array], instants: int, rows: int, ended: bool) -> None:
        self.samples = samples
        self.instants = instants
        self.rows = rows
        self.ended = ended

    def bounds(self, formula: Formula) -> Bounds:
        match formula:
            case stl.Constant():
                value = np.inf if formula.value else -np.inf
                return Bounds(self._full(self.instants, value), self._full(1, value)[0])
            case stl.Predicate():
                none = np.empty((0, self.rows))
                known = self.samples[formula.index][: self.instants] if self.instants else none
                return Bounds(np.stack([known, known], axis=1), self._unknown())
            case stl.Not():
                operand = self.bounds(formula.operand)
                return Bounds(-operand.values[:, ::-1], -operand.beyond[::-1])
            case stl.And() | stl.Or():
                ufunc: np.ufunc = np.minimum if isinstance(formula, stl.And) else np.maximum
                each = [self.bounds(operand) for operand in formula.operands]
                length = max(len(operand.values) for operand in each)
                return Bounds(
                    ufunc.reduce([operand.upto(length) for operand in each]),
                    ufunc.reduce([operand.beyond for operand in each]),
                )
            case stl.Always() | stl.Eventually():
                operand = self.bounds(formula.operand)
                ufunc, neutral, open_side = _extremum(formula)
                if formula.last is None:
                    return self._to_the_end(operand, formula.first, ufunc, neutral, open_side)
                return self._ahead(operand, formula.first, formula.last, ufunc)
            case stl.Next():
                return self._next(self.bounds(formula.operand), formula.weak)
            case stl.Historically() | stl.Once():
                ufunc, neutral, _ = _extremum(formula)
                return self._ago(self.bounds(formula.operand), formula.first, formula.last, ufunc, neutral)
            case stl.Until():
                return self._until(formula)
            case stl.Since():
                return self._since(formula)

    def _full(self, instants: int, value: float) -> Array:
        return np.full((instants, 2, self.rows), value)

    def _unknown(self) -> Array:
        return np.stack([np.full(self.rows, -np.inf), np.full(self.rows, np.inf)])

    def _ahead(self, operand: Bounds, first: int, last: int, ufunc: np.ufunc) -> Bounds:
        length = max(len(operand.values) - first, 0)
        return Bounds(sliding(ufunc, operand.upto(length + last)[first:], last - first + 1)[:length], operand.beyond)

    def _next(self, operand: Bounds, weak: bool) -> Bounds:
        """Shift by an instant. A run that has not ended may end with any instant from the last known one on."""
        length = max(len(operand.values) - 1, self.instants)
        values, beyond = operand.upto(length + 1)[1:].copy(), operand.beyond.copy()
        neutral, last = np.inf if weak else -np.inf, max(self.instants - 1, 0)
        if self.ended:
            values[last : self.instants] = neutral
        else:
            values[last:, int(weak)] = beyond[int(weak)] = neutral
        return Bounds(values, beyond)

    def _to_the_end(self, operand: Bounds, first: int, ufunc: np.ufunc, neutral: float, open_side: int) -> Bounds:
        """Evaluate a window to the end of the run, which may come now or never: each bound is the worse of the two."""
        known = operand.upto(self.instants)[first:]
        known = ufunc.accumulate(known[::-1])[::-1]
        if self.ended:
            values = np.concatenate([known, self._full(self.instants - len(known), neutral)])
            return Bounds(values, self._full(1, neutral)[0])
        length = max(len(operand.values), self.instants)
        values = np.concatenate([known, self._full(length - len(known), neutral)])
        later = operand.upto(length)[first:, open_side]
        later = np.concatenate(
            [later, np.broadcast_to(operand.beyond[open_side], (length - len(later) + 1, self.rows))]
        )
        values[:, open_side] = ufunc.accumulate(later[::-1])[::-1][:length]
        beyond = self._full(1, neutral)[0]
        beyond[open_side] = operand.beyond[open_side]
        return Bounds(values, beyond)

    def _ago(self, operand: Bounds, first: int, last: int | None, ufunc: np.ufunc, neutral: float) -> Bounds:
        known = len(operand.values)
        if last is None:
            values = np.concatenate([self._full(first, neutral), ufunc.accumulate(operand.values)])
            beyond = ufunc(values[-1], operand.beyond) if known else operand.beyond
            return Bounds(values, beyond)
        length = known + last
        before = np.concatenate([self._full(last, neutral), operand.upto(length - first)])
        return Bounds(sliding(ufunc, before, last - first + 1), operand.beyond)

    def _until(self, formula: stl.Until) -> Bounds:
        """Compute a bounded until from windows and an unbounded until.

        A bounded until is the minimum of the unbounded one and of "eventually right in the window": Donzé, Ferrère and
        Maler, "Efficient robust monitoring for STL", CAV 2013.
        """
        left, right = self.bounds(formula.left), self.bounds(formula.right)
        length = max(len(left.values), len(right.values), self.instants)
        first, last = formula.first, formula.last
        some = length + first
        lefts, rights = left.upto(some), right.upto(some)
        values = np.empty((some + 1, 2, self.rows))
        # After the known instants: the next instant is as good as possible, or the run has ended.
        values[some] = right.beyond
        if last is None and self.ended:
            some = length = self.instants
            values = values[: some + 1]
            values[some] = -np.inf
        for t in range(some - 1, -1, -1):
            np.maximum(rights[t], np.minimum(lefts[t], values[t + 1]), out=values[t])
        if last is None and not self.ended:
            # The lower bound is the value if the run ends now.
            values[self.instants :, 0] = -np.inf
            for t in range(self.instants - 1, -1, -1):
                np.maximum(rights[t, 0], np.minimum(lefts[t, 0], values[t + 1, 0]), out=values[t, 0])
        beyond = values[-1] if first == 0 else np.minimum(values[-1], left.beyond)
        if first:
            shifted = np.concatenate([values[first:], np.broadcast_to(values[-1], (first, 2, self.rows))])
            values = np.minimum(sliding(np.minimum, left.upto(length + first), first)[:length], shifted[:length])
        values = values[:length]
        if last is not None:
            values = np.minimum(
                values, sliding(np.maximum, right.upto(length + last)[first:], last - first + 1)[:length]
            )
            beyond = np.minimum(beyond, right.beyond)
        return Bounds(values, beyond)

    def _since(self, formula: stl.Since) -> Bounds:
        left, right = self.bounds(formula.left), self.bounds(formula.right)
        first, last = formula.first, formula.last
        known = max(len(left.values), len(right.values))
        length = known + (first if last is None else last) + 1
        lefts, rights = left.upto(length), right.upto(length)
        values = np.empty((length, 2, self.rows))
        now = self._full(1, -np.inf)[0]
        for t in range(length):
            now = np.maximum(rights[t], np.minimum(lefts[t], now))
            values[t] = now
        if first:
            shifted = np.concatenate([self._full(first, -np.inf), values[: length - first]])
            values = np.minimum(shifted, self._ago(left, 0, first - 1, np.minimum, np.inf).upto(length))
        if last is not None:
            values = np.minimum(values, self._ago(right, first, last, np.maximum, -np.inf).upto(length))
        return Bounds(values[:-1], values[-1])


def _extremum(formula: stl.Always | stl.Eventually | stl.Historically | stl.Once) -> tuple[np.ufunc, float, int]:
    """Return the combining ufunc, its neutral element, and the bound that gets worse with each further sample."""
    if isinstance(formula, stl.Always | stl.Historically):
        return np.minimum, np.inf, 0
    return np.maximum, -np.inf, 1
