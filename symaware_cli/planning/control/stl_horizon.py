"""How far ahead `control.stl` plans, if its scenario does not say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from symaware_cli.specification import Specification
from symaware_cli.specification.formula import Always, And, Eventually, Formula, Not, Or, horizon


def planned_steps(specifications: Sequence[Specification]) -> int | None:
    """Return the number of steps to plan ahead for specifications; None for all remaining steps of the run.

    A plan is as long as the longest part of a specification that has an end. Conditions that have to hold always are
    planned for over that time, and later by later plans. Any other part without an end may become due at the end of the
    run; then plans lead up to it, and likewise if no part has an end.
    """
    longest, due_at_end = ends(specifications)
    return None if due_at_end else longest or None


def ends(specifications: Sequence[Specification]) -> tuple[int, bool]:
    """Return the duration of the longest part of specifications with an end, in steps; 0 if none has an end.

    Also return whether a part without an end may become due at the end of the run.
    """
    longest, due_at_end = 0, False
    for each in specifications:
        formulation = each.formulation
        most = None if each.end is None else max(0, each.end - each.start) // formulation.time_step
        for conjunct, positive in _conjuncts(formulation.formula, True):
            last = [end for end in (horizon(conjunct), most) if end is not None]
            if last:
                longest = max(longest, min(last))
            else:
                due_at_end = due_at_end or not _is_invariant(conjunct, positive)
    return longest, due_at_end


def _conjuncts(formula: Formula, positive: bool) -> Iterator[tuple[Formula, bool]]:
    """Yield formulas that must all hold or, where they are not positive, fail."""
    match formula:
        case Not(operand=operand):
            yield from _conjuncts(operand, not positive)
        case And(operands=operands) if positive:
            for each in operands:
                yield from _conjuncts(each, True)
        case Or(operands=operands) if not positive:
            for each in operands:
                yield from _conjuncts(each, False)
        case _:
            yield formula, positive


def _is_invariant(formula: Formula, positive: bool) -> bool:
    """Whether a formula without an end says that something, which has an end, holds at every instant."""
    return isinstance(formula, Always if positive else Eventually) and horizon(formula.operand) is not None
