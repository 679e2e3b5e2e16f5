"""Formulas of signal temporal logic (STL) over evenly spaced instants, counted in steps.

A formula is composed of predicates, each of which has a *robustness* at each instant: its distance from a change of
truth, positive where the predicate holds. ``docs/specifications.md`` defines the operators. Windows are numbers of
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
SEMANTICS = 1

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


Formula: TypeAlias = Constant | Predicate | Not | And | Or | Always | Eventually | Until | Historically | Once | Since


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
    return deepest


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


def plain(robustness: Array) -> Array:
    """Decode robustness; the inverse of `encoded`."""
    return np.where(np.abs(robustness) == ZERO, 0.0, robustness)
