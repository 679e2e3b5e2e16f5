"""Bounds of the probability that a formula fails, from those of its predicates at each instant.

Nothing is assumed about the dependence between predicates and instants (Boole's inequality): a minimum fails with at
most the sum of the probabilities, and a maximum with at most the least of them. What lies beyond the last instant is as
good as possible, so the bounds are about failures that are certain by then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Array, Formula, from_now
from symaware_cli.specification.sliding import sliding


class TruthBounds(NamedTuple):
    """Upper bounds of probabilities at each instant.

    Attributes:
        fails: That a formula fails; shape (instants, rows).
        holds: That it holds.
    """

    fails: Array
    holds: Array


def truth_bounds(formula: Formula, predicates: Sequence[TruthBounds], instants: int, rows: int) -> TruthBounds:
    """Return bounds of the probability that a formula fails, and that it holds, at each instant.

    Args:
        formula: The formula.
        predicates: The bounds of each predicate.
        instants: The number of instants.
        rows: The number of rows.
    """

    def of(operand: Formula) -> TruthBounds:
        return truth_bounds(operand, predicates, instants, rows)

    match formula:
        case stl.Constant(value):
            never, ever = np.zeros((instants, rows)), np.ones((instants, rows))
            return TruthBounds(never, ever) if value else TruthBounds(ever, never)
        case stl.Predicate(index):
            return predicates[index]
        case stl.Not(operand):
            return _negated(of(operand))
        case stl.And(operands):
            return _all([of(each) for each in operands])
        case stl.Or(operands):
            return _negated(_all([_negated(of(each)) for each in operands]))
        case stl.Always(first, last, operand):
            return _always(of(operand), first, last)
        case stl.Next(operand):
            return _always(of(operand), 1, 1)
        case stl.Eventually(first, last, operand):
            return _negated(_always(_negated(of(operand)), first, last))
        case stl.Historically(first, last, operand):
            return _historically(of(operand), first, last)
        case stl.Once(first, last, operand):
            return _negated(_historically(_negated(of(operand)), first, last))
        case stl.Until(0, last, left, right):
            return _until(of(left), of(right), last)
        case stl.Since(0, None, left, right):
            return _since(of(left), of(right))
        case stl.Until() | stl.Since():
            return of(from_now(formula))
    raise TypeError(f"{formula!r} is no formula")


def _negated(bounds: TruthBounds) -> TruthBounds:
    return TruthBounds(bounds.holds, bounds.fails)


def _all(operands: Sequence[TruthBounds]) -> TruthBounds:
    fails, holds = operands[0]
    for each in operands[1:]:
        fails, holds = fails + each.fails, np.minimum(holds, each.holds)
    return TruthBounds(np.minimum(fails, 1.0), holds)


def _always(operand: TruthBounds, first: int, last: int | None) -> TruthBounds:
    """Return the bounds of `Always`: the sum over the window of `fails`, and the minimum of `holds`."""
    instants, rows = operand.fails.shape
    width = instants if last is None else last - first + 1
    # Beyond the last instant nothing fails, and nothing is known to hold.
    beyond = np.zeros((first + width, rows))
    fails, holds = (np.concatenate([each[first:], beyond])[: instants + width - 1] for each in operand)
    total = np.cumsum(np.concatenate([np.zeros((1, rows)), fails]), axis=0)
    summed = np.maximum(total[width:] - total[:-width], 0.0)[:instants]
    least = np.zeros((instants, rows)) if last is None else sliding(np.minimum, holds, width)[:instants]
    return TruthBounds(np.minimum(summed, 1.0), least)


def _historically(operand: TruthBounds, first: int, last: int | None) -> TruthBounds:
    """Return the bounds of `Historically`, which holds where its window has no instant."""
    instants, rows = operand.fails.shape
    width = instants if last is None else last - first + 1
    ago = first + width - 1
    fails, holds = (
        np.concatenate([np.full((ago, rows), before), each])[: ago + instants - first]
        for each, before in zip(operand, (0.0, 1.0), strict=True)
    )
    total = np.cumsum(np.concatenate([np.zeros((1, rows)), fails]), axis=0)
    summed = np.maximum(total[width:] - total[:-width], 0.0)[:instants]
    return TruthBounds(np.minimum(summed, 1.0), sliding(np.minimum, holds, width)[:instants])


def _until(left: TruthBounds, right: TruthBounds, last: int | None) -> TruthBounds:
    """Return the bounds of `Until` with a window that begins now."""
    instants, rows = left.fails.shape
    fails, holds = np.empty((instants, rows)), np.empty((instants, rows))
    for start in range(instants):
        stop = instants if last is None else min(instants, start + last + 1)
        failed, held = np.zeros(rows), np.ones(rows)  # of left, so far
        least, total = np.ones(rows), np.zeros(rows)
        for at in range(start, stop):
            least = np.minimum(least, right.fails[at] + failed)
            total = total + np.minimum(right.holds[at], held)
            failed = failed + left.fails[at]
            held = np.minimum(held, left.holds[at])
        if last is None or start + last >= instants:
            least = np.minimum(least, failed)  # right may hold just after the last instant
        fails[start], holds[start] = least, np.minimum(total, 1.0)
    return TruthBounds(np.minimum(fails, 1.0), holds)


def _since(left: TruthBounds, right: TruthBounds) -> TruthBounds:
    """Return the bounds of `Since` without limits: right holds, or left does and it did so an instant ago."""
    instants, rows = left.fails.shape
    fails, holds = np.empty((instants, rows)), np.empty((instants, rows))
    failed, held = np.ones(rows), np.zeros(rows)
    for at in range(instants):
        failed = np.minimum(right.fails[at], np.minimum(left.fails[at] + failed, 1.0))
        held = np.minimum(right.holds[at] + np.minimum(left.holds[at], held), 1.0)
        fails[at], holds[at] = failed, held
    return TruthBounds(fails, holds)
