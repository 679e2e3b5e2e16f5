"""Bounds of the probability that a formula fails, from those of its predicates at each instant.

Nothing is assumed about the dependence between predicates and instants (Boole's inequality): a minimum fails with at
most the sum of the probabilities, and a maximum with at most the least of them. What predicates are beyond the last
instant is not known, so the bounds are about failures that are certain by then. Of operators that look back, such as
`once`, more may be certain: what was true before the last instant stays so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Array, Formula, from_now, looks_back, reach
from symaware_cli.specification.sliding import sliding


class TruthBounds(NamedTuple):
    """Upper bounds of probabilities at each instant.

    Attributes:
        fails: That a formula fails; shape (instants, rows).
        holds: That it holds.
    """

    fails: Array
    holds: Array


class _Course(NamedTuple):
    """Upper bounds of the probabilities that a formula is known to fail, and to hold.

    Attributes:
        fails: At each instant that is looked at; shape (instants, rows).
        holds: Likewise.
        fails_later: At one of all later instants or more; shape (rows,).
        holds_later: Likewise.
    """

    fails: Array
    holds: Array
    fails_later: Array
    holds_later: Array


def truth_bounds(formula: Formula, predicates: Sequence[TruthBounds], instants: int, rows: int) -> TruthBounds:
    """Return bounds of the probability that a formula fails, and that it holds, at each instant.

    Args:
        formula: The formula.
        predicates: The bounds of each predicate.
        instants: The number of instants.
        rows: The number of rows.
    """
    # Windows that look back see known instants for some time yet.
    more = np.zeros((min(reach(formula), 2 * instants) if looks_back(formula) else 0, rows))
    never = np.zeros(rows)
    courses = [
        _Course(np.concatenate([each.fails, more]), np.concatenate([each.holds, more]), never, never)
        for each in predicates
    ]
    found = _course(formula, courses, instants + len(more), rows)
    return TruthBounds(found.fails[:instants], found.holds[:instants])


def _course(formula: Formula, predicates: Sequence[_Course], instants: int, rows: int) -> _Course:
    """Return the bounds of a formula; see `truth_bounds`."""

    def of(operand: Formula) -> _Course:
        return _course(operand, predicates, instants, rows)

    match formula:
        case stl.Constant(value):
            never, ever = np.zeros((instants, rows)), np.ones((instants, rows))
            # Of these, too, nothing is known later.
            later = np.zeros(rows)
            return _Course(never, ever, later, later) if value else _Course(ever, never, later, later)
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


def _negated(course: _Course) -> _Course:
    return _Course(course.holds, course.fails, course.holds_later, course.fails_later)


def _all(operands: Sequence[_Course]) -> _Course:
    fails, holds, fails_later, holds_later = operands[0]
    for each in operands[1:]:
        fails, holds = fails + each.fails, np.minimum(holds, each.holds)
        fails_later, holds_later = fails_later + each.fails_later, np.minimum(holds_later, each.holds_later)
    return _Course(np.minimum(fails, 1.0), holds, np.minimum(fails_later, 1.0), holds_later)


def _always(operand: _Course, first: int, last: int | None) -> _Course:
    """Return the bounds of `Always`: the sum over the window of `fails`, and the minimum of `holds`."""
    instants, rows = operand.fails.shape
    width = instants if last is None else last - first + 1
    # Windows that reach beyond the last instant contain all later ones, as far as is known.
    later = np.broadcast_to(operand.holds_later, (first + width, rows))
    beyond = np.zeros((first + width, rows))
    fails = np.concatenate([operand.fails[first:], beyond])[: instants + width - 1]
    holds = np.concatenate([operand.holds[first:], later])[: instants + width - 1]
    total = np.cumsum(np.concatenate([np.zeros((1, rows)), fails]), axis=0)
    summed = np.maximum(total[width:] - total[:-width], 0.0)[:instants]
    if last is None:
        least = np.minimum(np.minimum.accumulate(holds[::-1])[::-1], operand.holds_later)[:instants]
        summed = summed + operand.fails_later
    else:
        least = sliding(np.minimum, holds, width)[:instants]
        summed[max(0, instants - last) :] += operand.fails_later
    return _Course(np.minimum(summed, 1.0), least, operand.fails_later, operand.holds_later)


def _historically(operand: _Course, first: int, last: int | None) -> _Course:
    """Return the bounds of `Historically`, which holds where its window has no instant."""
    instants, rows = operand.fails.shape
    width = instants if last is None else last - first + 1
    ago = first + width - 1
    fails, holds = (
        np.concatenate([np.full((ago, rows), before), each])[: ago + instants - first]
        for each, before in zip(operand[:2], (0.0, 1.0), strict=True)
    )
    total = np.cumsum(np.concatenate([np.zeros((1, rows)), fails]), axis=0)
    summed = np.maximum(total[width:] - total[:-width], 0.0)[:instants]
    # Each later window has one of these instants, or a later one, and fails or holds there; or it is longer.
    since = 0 if last is None else max(0, instants - last)
    fails_later = operand.fails[since:].sum(axis=0) + operand.fails_later
    if first > instants:
        holds_later = np.ones(rows)
    elif last is None:
        holds_later = operand.holds[: instants - first + 1].min(axis=0, initial=1.0)
        holds_later = holds_later if first else np.minimum(holds_later, operand.holds_later)
    else:
        holds_later = operand.holds[since:].sum(axis=0) + operand.holds_later
    return _Course(
        np.minimum(summed, 1.0),
        sliding(np.minimum, holds, width)[:instants],
        np.minimum(fails_later, 1.0),
        np.minimum(holds_later, 1.0),
    )


def _until(left: _Course, right: _Course, last: int | None) -> _Course:
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
            # Right may hold just after the last instant.
            least = np.minimum(least, right.fails_later + failed)
            total = total + np.minimum(right.holds_later, held)
        fails[start], holds[start] = least, np.minimum(total, 1.0)
    return _Course(np.minimum(fails, 1.0), holds, right.fails_later, right.holds_later)


def _since(left: _Course, right: _Course) -> _Course:
    """Return the bounds of `Since` without limits: right holds, or left does and it did so an instant ago."""
    instants, rows = left.fails.shape
    fails, holds = np.empty((instants, rows)), np.empty((instants, rows))
    failed, held = np.ones(rows), np.zeros(rows)
    for at in range(instants):
        failed = np.minimum(right.fails[at], np.minimum(left.fails[at] + failed, 1.0))
        held = np.minimum(right.holds[at] + np.minimum(left.holds[at], held), 1.0)
        fails[at], holds[at] = failed, held
    later = np.minimum(np.minimum(left.holds_later, held) + right.holds_later, 1.0)
    return _Course(fails, holds, right.fails_later, later)
