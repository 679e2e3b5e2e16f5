"""Whether a formula can be satisfied at all, with its predicates as free propositions, in a run of a given length.

The formula is evaluated for many assignments of truths to its propositions at all instants at once, each in a row. An
assignment may leave a proposition open at an instant: then both it and its negation count as true, so that a formula
that fails nevertheless fails however the proposition turns out. From there on it is a search with unit propagation, as
of Davis, Logemann and Loveland (A Machine Program for Theorem-Proving, Communications of the ACM 5, 1962).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Formula, operands
from symaware_cli.specification.whole import bounds

#: For each assignment, proposition, truth (false, true) and instant, whether that is allowed; shape (rows, n, 2, m).
_Allowed = NDArray[np.bool_]

#: The most values that one evaluation has, and the most evaluations of a search.
_MOST_VALUES = 400_000
_MOST_EVALUATIONS = 60


def can_be_satisfied(formula: Formula, propositions: int, instants: int) -> bool | None:
    """Return whether some truths of the propositions satisfy a formula; None if that takes too long to find out.

    Args:
        formula: The formula.
        propositions: Number of its predicates.
        instants: Number of instants of the run, after which nothing is known.
    """
    if instants > _MOST_VALUES:
        return None
    search = _Search(formula, propositions, instants)
    if not search.succeeds(search.anything[None])[0]:
        return False
    if search.succeeds(search.examples()).any():
        return True
    try:
        return search.run(search.anything.copy())
    except TimeoutError:
        return None


class _Search:
    def __init__(self, formula: Formula, propositions: int, instants: int) -> None:
        self._formula = _separated(formula, positive=True)
        self._instants = instants
        self._evaluations = 0
        self.anything: NDArray[np.bool_] = np.ones((propositions, 2, instants), bool)

    def succeeds(self, allowed: _Allowed) -> NDArray[np.bool_]:
        """Return whether the formula may hold under each assignment."""
        rows = len(allowed)
        samples = [
            np.where(allowed[:, number, truth].T, 1.0, -1.0) for number in range(allowed.shape[1]) for truth in (1, 0)
        ]
        found: NDArray[np.bool_] = bounds(self._formula, samples, self._instants, rows, True).upto(1)[0, 0] > 0.0
        return found

    def examples(self) -> _Allowed:
        """Return assignments that often satisfy what can be satisfied: all true, all false, and drawn ones."""
        count = max(2, min(64, _MOST_VALUES // max(1, self.anything.size)))
        shape = (count, *self.anything.shape[::2])
        truths = np.random.default_rng(0).random(shape) < np.linspace(0.0, 1.0, count)[:, None, None]
        return np.stack([~truths, truths], axis=2)

    def run(self, allowed: NDArray[np.bool_]) -> bool:
        """Search for truths that satisfy the formula.

        Raises:
            TimeoutError: That takes too long.
        """
        while True:
            numbers, instants = np.nonzero(allowed.all(axis=1))
            if not len(numbers):
                return bool(self.succeeds(allowed[None])[0])
            rows = 2 * len(numbers)
            self._evaluations += 1
            if rows * allowed.size > 4 * _MOST_VALUES or self._evaluations > _MOST_EVALUATIONS:
                raise TimeoutError
            tried = np.repeat(allowed[None], rows, axis=0)
            for truth in (0, 1):
                tried[np.arange(truth, rows, 2), numbers, 1 - truth, instants] = False
            may_be = self.succeeds(tried).reshape(-1, 2)
            if not may_be.any(axis=1).all():
                return False
            forced = ~may_be.all(axis=1)
            if not forced.any():
                for truth in (1, 0):
                    chosen = allowed.copy()
                    chosen[numbers[0], 1 - truth, instants[0]] = False
                    if self.run(chosen):
                        return True
                return False
            allowed[numbers[forced], :, instants[forced]] = may_be[forced]


def _separated(formula: Formula, *, positive: bool) -> Formula:
    """Return a formula, or its negation, that grows with all its predicates.

    The predicate i becomes 2 i where it occurs, and 2 i + 1 where its negation does.
    """
    match formula:
        case stl.Constant(value=value):
            return stl.Constant(value == positive)
        case stl.Predicate(index=index):
            return stl.Predicate(2 * index + (0 if positive else 1))
        case stl.Not(operand=operand):
            return _separated(operand, positive=not positive)
    parts = [_separated(each, positive=positive) for each in operands(formula)]
    if positive:
        return _with_operands(formula, parts)
    return stl.Not(_with_operands(formula, [stl.Not(each) for each in parts]))


def _with_operands(formula: Formula, parts: list[Formula]) -> Formula:
    match formula:
        case stl.And() | stl.Or():
            return replace(formula, operands=tuple(parts))
        case stl.Until() | stl.Since():
            return replace(formula, left=parts[0], right=parts[1])
        case stl.Constant() | stl.Predicate():
            return formula
    return replace(formula, operand=parts[0])


def weakened(formula: Formula) -> Formula:
    """Return a formula with `weak next` in place of every `next`."""
    changed = _with_operands(formula, [weakened(each) for each in operands(formula)])
    return replace(changed, weak=True) if isinstance(changed, stl.Next) else changed
