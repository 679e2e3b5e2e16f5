"""Builds the stream that evaluates a formula online."""

from __future__ import annotations

from dataclasses import replace

from symaware_cli.specification.formula import (
    Always,
    And,
    Constant,
    Eventually,
    Formula,
    Historically,
    Not,
    Once,
    Or,
    Predicate,
    Since,
    Until,
)
from symaware_cli.specification.future_stream import AheadStream, ToTheEndStream, UntilStream
from symaware_cli.specification.past_stream import AgoStream, SinceStream, SoFarStream
from symaware_cli.specification.stream import (
    Clock,
    ConstantStream,
    JunctionStream,
    NotStream,
    PredicateStream,
    Stream,
)


def stream(formula: Formula, clock: Clock, last: int | None) -> Stream:
    """Build the stream of a formula.

    Args:
        formula: The formula.
        clock: The common clock; determines whether robustness or truth is evaluated.
        last: The last instant at which bounds are needed; -1 for none, None for all.
    """

    def further(steps: int) -> int | None:
        return last if last is None or last < 0 else last + steps

    ever = -1 if last == -1 else None
    greatest = isinstance(formula, Or | Eventually | Once)
    match formula:
        case Constant():
            return ConstantStream(clock, formula.value)
        case Predicate():
            return PredicateStream(clock, formula.index)
        case Not():
            return NotStream(clock, stream(formula.operand, clock, last))
        case And() | Or():
            if len(formula.operands) == 1:
                return stream(formula.operands[0], clock, last)
            operands = [stream(each, clock, last) for each in formula.operands]
            return JunctionStream(clock, operands, greatest, last)
        case Always(first, None) | Eventually(first, None) | Historically(first, None) | Once(first, None) if first:
            shifted = replace(formula, last=first, operand=replace(formula, first=0))
            return stream(shifted, clock, last)
        case Always(_, None, operand) | Eventually(_, None, operand):
            return ToTheEndStream(clock, stream(operand, clock, ever), greatest, last)
        case Always(first, int(until), operand) | Eventually(first, int(until), operand):
            return AheadStream(clock, stream(operand, clock, further(until)), first, until, greatest, last)
        case Historically(_, None, operand) | Once(_, None, operand):
            return SoFarStream(clock, stream(operand, clock, last), greatest)
        case Historically(first, int(until), operand) | Once(first, int(until), operand):
            return AgoStream(clock, stream(operand, clock, last), first, until, greatest)
        case Until(0, until, left, right):
            below = ever if until is None else further(until)
            return UntilStream(clock, stream(left, clock, below), stream(right, clock, below), until, last, below)
        case Until(first, until, left, right):
            within = Until(0, None if until is None else until - first, left, right)
            both = (Always(0, first - 1, left), Eventually(first, first, within))
            return stream(And(both), clock, last)
        case Since(0, None, left, right):
            return SinceStream(clock, stream(left, clock, last), stream(right, clock, last), last)
        case Since(first, until, left, right):
            parts: list[Formula] = [Since(0, None, left, right)]
            if first:
                parts = [Once(first, first, parts[0]), Historically(0, first - 1, left)]
            if until is not None:
                parts.append(Once(first, until, right))
            return stream(And(tuple(parts)), clock, last)
    raise TypeError(f"{formula!r} is no formula")
