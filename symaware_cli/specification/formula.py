"""Formulas of signal temporal logic over instants that are evenly spaced, counted in steps.

A formula is made of predicates, each of which has a *robustness* at each instant: how far it is from changing its
truth, positive where it holds. ``docs/specifications.md`` says what each operator means. Windows are numbers of steps
from the instant in question, both ends included; ``last`` is None where a window ends with the run (or, in the past,
begins with it).

A robustness of 0 does not tell whether a predicate holds: ``x > 0`` fails at 0 where ``x >= 0`` holds. Such a value is
written as `ZERO` where it holds and ``-ZERO`` where it does not, so that the sign is the truth, the order is the one
that minima and maxima need, and negation is a change of sign. `plain` turns them back into 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

#: A robustness of 0 of what holds.
ZERO = 1e-300


@dataclass(frozen=True, slots=True)
class Constant:
    """What always holds, with infinite robustness, or never does."""

    value: bool


@dataclass(frozen=True, slots=True)
class Predicate:
    """A statement about one instant.

    Attributes:
        index: Its position among the predicates whose robustness a monitor is given.
    """

    index: int


@dataclass(frozen=True, slots=True)
class Not:
    """Negation: the robustness changes its sign."""

    operand: Formula


@dataclass(frozen=True, slots=True)
class And:
    """Conjunction: the least robustness."""

    operands: tuple[Formula, ...]


@dataclass(frozen=True, slots=True)
class Or:
    """Disjunction: the greatest robustness."""

    operands: tuple[Formula, ...]


@dataclass(frozen=True, slots=True)
class Always:
    """The least over instants from ``first`` to ``last`` steps ahead."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Eventually:
    """The greatest over instants from ``first`` to ``last`` steps ahead."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Until:
    """``right`` from ``first`` to ``last`` steps ahead, and ``left`` from now on up to, not including, that instant."""

    first: int
    last: int | None
    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Historically:
    """The least over instants from ``first`` to ``last`` steps ago; infinite where there are none."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Once:
    """The greatest over instants from ``first`` to ``last`` steps ago; minus infinity where there are none."""

    first: int
    last: int | None
    operand: Formula


@dataclass(frozen=True, slots=True)
class Since:
    """``right`` from ``first`` to ``last`` steps ago, and ``left`` after that instant up to now, now included."""

    first: int
    last: int | None
    left: Formula
    right: Formula


Formula: TypeAlias = Constant | Predicate | Not | And | Or | Always | Eventually | Until | Historically | Once | Since


def operands(formula: Formula) -> tuple[Formula, ...]:
    """The formulas that a formula is directly made of, from left to right."""
    match formula:
        case Constant() | Predicate():
            return ()
        case And() | Or():
            return formula.operands
        case Until() | Since():
            return (formula.left, formula.right)
        case _:
            return (formula.operand,)


def horizon(formula: Formula) -> int | None:
    """How many steps after an instant its exact robustness is known; None where only the end of the run decides."""
    below = [horizon(each) for each in operands(formula)]
    if any(each is None for each in below):
        return None
    deepest = max((each for each in below if each is not None), default=0)
    if isinstance(formula, Always | Eventually | Until):
        return None if formula.last is None else deepest + formula.last
    return deepest


def encoded(robustness: Array, holds_at_zero: bool) -> Array:
    """Robustness whose sign is the truth.

    Args:
        robustness: As computed.
        holds_at_zero: Whether the predicate holds where it is 0.
    """
    return np.where(robustness == 0.0, ZERO if holds_at_zero else -ZERO, robustness)


def plain(robustness: Array) -> Array:
    """The robustness that `encoded` was given."""
    return np.where(np.abs(robustness) == ZERO, 0.0, robustness)
