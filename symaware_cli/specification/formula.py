"""Formulas of signal temporal logic (STL) over evenly spaced instants, counted in steps.

A formula is composed of predicates. Each has a *robustness* at each instant: its distance from a change of truth value,
positive where the predicate holds. ``docs/specifications.md`` defines the operators. Windows are numbers of
steps relative to the current instant, both ends included; ``last`` is None where a window extends to the end of the run
(or, in the past, to its beginning).

A robustness of 0 does not determine whether a predicate holds: at 0, ``x > 0`` fails and ``x >= 0`` holds. Such a value
is encoded as `ZERO` where the predicate holds and ``-ZERO`` where it does not, so that the sign is the truth value,
minima and maxima order values correctly, and negation is a change of sign. `plain` decodes both to 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

#: The version of the meaning of specifications: it rises when one of them gets another verdict of the same run.
SEMANTICS = 2

#: A robustness of 0 of a predicate that holds.
ZERO = 1e-300


@dataclass(frozen=True, slots=True)
class Constant:
    """A formula that always holds, with infinite robustness, or never does."""

    value: bool


@dataclass(frozen=True, slots=True)
class Predicate:
    """A predicate: a statement about one instant.

    Attributes:
        index: Its position in the sequence of predicates whose robustness a monitor receives.
    """

    index: int


@dataclass(frozen=True, slots=True)
class Not:
    """Negation: the robustness changes sign."""

    operand: Formula


@dataclass(frozen=True, slots=True)
class And:
    """Conjunction: the minimum of the robustness."""

    operands: tuple[Formula, ...]


@dataclass(frozen=True, slots=True)
class Or:
    """Disjunction: the maximum of the robustness."""

    operands: tuple[Formula, ...]


@dataclass(frozen=True, slots=True)
class Always:
    """The minimum over the instants ``first`` to ``last`` steps ahead."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Eventually:
    """The maximum over the instants ``first`` to ``last`` steps ahead."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Next:
    """The operand at the next instant; at the last instant of the run it holds if `weak`, and otherwise fails."""

    operand: Formula
    weak: bool = False


@dataclass(frozen=True, slots=True)
class Until:
    """``right`` holds ``first`` to ``last`` steps ahead, and ``left`` from now until just before that instant."""

    first: int
    last: int | None
    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Historically:
    """The minimum over the instants ``first`` to ``last`` steps ago; infinity where there are none."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Once:
    """The maximum over the instants ``first`` to ``last`` steps ago; minus infinity where there are none."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Since:
    """``right`` held ``first`` to ``last`` steps ago, and ``left`` ever since, up to and including now."""

    first: int
    last: int | None
    left: Formula
    right: Formula


Formula: TypeAlias = (
    Constant | Predicate | Not | And | Or | Always | Eventually | Next | Until | Historically | Once | Since
)


def operands(formula: Formula) -> tuple[Formula, ...]:
    """Return the direct operands of a formula, from left to right."""
    match formula:
        case Constant() | Predicate():
            return ()
        case And() | Or():
            return formula.operands
        case Until() | Since():
            return (formula.left, formula.right)
        case _:
            return (formula.operand,)


def from_now(formula: Until | Since) -> Formula:
    """Return an equal formula whose `Until` has a window that begins now, and whose `Since` has no limits."""
    first, last, left, right = formula.first, formula.last, formula.left, formula.right
    if isinstance(formula, Until):
        if not first:
            return formula
        within = Until(0, None if last is None else last - first, left, right)
        return And((Always(0, first - 1, left), Eventually(first, first, within)))
    if not first and last is None:
        return formula
    parts: list[Formula] = [Since(0, None, left, right)]
    if first:
        parts = [Once(first, first, parts[0]), Historically(0, first - 1, left)]
    if last is not None:
        parts.append(Once(first, last, right))
    return And(tuple(parts))


def horizon(formula: Formula) -> int | None:
    """Return after how many steps the exact robustness is known; None if only at the end of the run."""
    below = [horizon(each) for each in operands(formula)]
    if any(each is None for each in below):
        return None
    deepest = max((each for each in below if each is not None), default=0)
    if isinstance(formula, Always | Eventually | Until):
        return None if formula.last is None else deepest + formula.last
    return deepest + isinstance(formula, Next)


def cut(formula: Formula, instants: int) -> Formula:
    """Return a formula with equal robustness whose windows are not longer than a run can tell.

    Beyond the last instant, all samples are unknown. So a window ahead that reaches past it contains the same values
    wherever it ends, except that operands which look back still see known samples for some time; and a window in the
    past that reaches before the first instant contains the same values wherever it begins.

    A window in the past that begins later than now is kept within a window ahead that has no end: the run may go on
    until it contains known samples again.

    Args:
        formula: The formula.
        instants: Twice the greatest number of instants of the run, or more.

    Returns:
        A formula of the same structure. It is equal in every run of at most half as many instants, at all of them.
    """
    return _cut(formula, instants, instants, False)


def _cut(formula: Formula, instants: int, evaluated: int, endless: bool) -> Formula:
    """Cut windows of a formula.

    Args:
        formula: The formula.
        instants: See `cut`.
        evaluated: The number of instants at which it is evaluated: the known ones, and those that windows reach.
        endless: Whether it is evaluated at all later ones as well.
    """

    def below(further: int = 0, endless: bool = endless) -> tuple[Formula, ...]:
        return tuple(_cut(each, instants, evaluated + further, endless) for each in operands(formula))

    match formula:
        case Constant() | Predicate():
            return formula
        case Not():
            return Not(*below())
        case Next():
            return Next(below(1)[0], formula.weak)
        case And() | Or():
            return type(formula)(below())
        case Always() | Eventually() | Until():
            # One more than suffices for `Until`, whose left operand counts up to the instant before.
            most = instants + max(map(_look_back, operands(formula))) + 2
            first, last = min(formula.first, most), None if formula.last is None else min(formula.last, most)
            return type(formula)(first, last, *below(last or 0, endless or last is None))
        case Historically() | Once() | Since():
            if endless and formula.first > 0:
                return type(formula)(formula.first, formula.last, *below())
            last = None if formula.last is None else min(formula.last, evaluated)
            return type(formula)(min(formula.first, evaluated), last, *below())


def _look_back(formula: Formula) -> int:
    """Return the number of steps after which samples no longer count in windows of the past that have a beginning."""
    before = max(map(_look_back, operands(formula)), default=0)
    if isinstance(formula, Historically | Once | Since):
        return before + (formula.first if formula.last is None else formula.last) + 1
    return before


def looks_back(formula: Formula) -> bool:
    """Return whether a formula contains operators of the past."""
    return isinstance(formula, Historically | Once | Since) or any(map(looks_back, operands(formula)))


def reach(formula: Formula) -> int:
    """Return how many steps the windows of a formula reach at most, those of operands added."""
    inner = max(map(reach, operands(formula)), default=0)
    if isinstance(formula, Constant | Predicate | Not | And | Or):
        return inner
    if isinstance(formula, Next):
        return inner + 1
    return inner + (formula.first if formula.last is None else formula.last)


def encoded(robustness: Array, holds_at_zero: bool) -> Array:
    """Encode robustness so that its sign is the truth value.

    Args:
        robustness: The computed robustness.
        holds_at_zero: Whether the predicate holds where its robustness is 0.

    Returns:
        The encoded robustness; the same array if nothing is 0.
    """
    is_zero = robustness == 0.0
    return np.where(is_zero, ZERO if holds_at_zero else -ZERO, robustness) if np.any(is_zero) else robustness


def have_one_sign(robustness: Array, margin: float = 0.0) -> bool:
    """Return whether all values exceed a margin, or all are below minus it; so none is NaN, nor is any 0.

    For few values this takes half as long as comparing each of them.
    """
    return robustness.size > 0 and (
        robustness.item(robustness.argmin()) > margin or robustness.item(robustness.argmax()) < -margin
    )


def plain(robustness: Array) -> Array:
    """Decode robustness; the inverse of `encoded`. Without a robustness of 0 it is the same array."""
    if have_one_sign(robustness, ZERO):
        return robustness
    is_zero = np.abs(robustness) == ZERO
    return np.where(is_zero, 0.0, robustness) if np.count_nonzero(is_zero) else robustness
