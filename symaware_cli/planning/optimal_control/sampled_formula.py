"""Formulas for plans with longer steps than those of the world: if they hold at the steps, they hold in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from symaware_cli.planning.optimal_control.affine_predicate import Face, Intersection, StateSet, Union
from symaware_cli.specification import formula as stl

#: Of a predicate the states in which it holds, and those in which its negation does.
PredicateSets = tuple[StateSet, StateSet]


@dataclass(frozen=True, slots=True)
class SampledFormula:
    """A formula over the steps of a plan.

    Attributes:
        formula: The formula, in steps of the plan.
        sets: Of each predicate the states in which it holds, and those in which its negation does.
    """

    formula: stl.Formula
    sets: tuple[PredicateSets, ...]

    @property
    def horizon(self) -> int | None:
        """The last step that it is about; None for the end of the plan."""
        return stl.horizon(self.formula)


def sampled(formula: stl.Formula, sets: Sequence[PredicateSets], every: int) -> SampledFormula:
    """Return a formula about every k-th instant that implies a formula about all instants, on straight lines.

    Between two steps of the plan the state moves along a line. A condition on all instants holds on a whole line if
    both of its ends are in the same half spaces: a convex region then contains the line, and the line passes an
    obstacle on one side. A condition on some instant is required at a step.

    Args:
        formula: The formula, in steps of the world.
        sets: Of each predicate the states in which it holds, and those in which its negation does.
        every: The number of steps of the world in a step of the plan, k.

    Raises:
        ValueError: An operator has no such formula: ``until``, and those of the past.
    """
    if every == 1:
        return SampledFormula(formula, tuple(sets))
    sampler = _Sampler(sets, every)
    return SampledFormula(sampler.implying(formula, True, False), tuple(sampler.sets))


class _Sampler:
    """Translates formulas in positive normal form; a formula with `positive` False stands for its negation."""

    def __init__(self, sets: Sequence[PredicateSets], every: int) -> None:
        self.sets = list(sets)
        self._every = every
        self._faces: dict[Face, stl.Predicate] = {}

    def implying(self, formula: stl.Formula, positive: bool, on_way: bool) -> stl.Formula:
        """Return a formula that implies another one at a step, or on the whole line from there to the next step."""
        match formula:
            case stl.Constant(value=value):
                return stl.Constant(value == positive)
            case stl.Predicate(index=index):
                if on_way:
                    return self._within(self.sets[index][0 if positive else 1])
                return formula if positive else stl.Not(formula)
            case stl.Not(operand=operand):
                return self.implying(operand, not positive, on_way)
            case stl.And(operands=operands) | stl.Or(operands=operands):
                parts = tuple(self.implying(each, positive, on_way) for each in operands)
                return _junction(isinstance(formula, stl.And) == positive, parts)
            case (
                stl.Always(first=first, last=last, operand=operand)
                | stl.Eventually(first=first, last=last, operand=operand)
            ):
                if isinstance(formula, stl.Always) != positive:
                    return self._sometime(first, last, operand, positive, int(on_way))
                start, end = first // self._every, None if last is None else -(-last // self._every) - (not on_way)
                if end is not None and end < start:
                    return stl.Always(start, start, self.implying(operand, positive, False))
                return stl.Always(start, end, self.implying(operand, positive, True))
        raise ValueError(f"a plan with steps of its own has no formula for `{type(formula).__name__.lower()}`")

    def _sometime(self, first: int, last: int | None, operand: stl.Formula, positive: bool, later: int) -> stl.Formula:
        """Return that an operand holds at a step of a window, or of all windows that begin up to a step later."""
        start, end = -(-first // self._every) + later, None if last is None else last // self._every
        if end is not None and end < start:
            return stl.Constant(False)
        return stl.Eventually(start, end, self.implying(operand, positive, False))

    def _within(self, states: StateSet) -> stl.Formula:
        match states:
            case bool():
                return stl.Constant(states)
            case Face():
                if states not in self._faces:
                    self._faces[states] = stl.Predicate(len(self.sets))
                    outside = Face(tuple(-each for each in states.normal), -states.offset)
                    self.sets.append((states, outside))
                face = self._faces[states]
                return stl.And((face, stl.Always(1, 1, face)))
            case Union(parts=parts) | Intersection(parts=parts):
                return _junction(isinstance(states, Intersection), tuple(self._within(each) for each in parts))


def _junction(every: bool, parts: tuple[stl.Formula, ...]) -> stl.Formula:
    return stl.And(parts) if every else stl.Or(parts)
