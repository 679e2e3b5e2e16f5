"""Builds the stream that evaluates a formula online."""

from __future__ import annotations

from dataclasses import replace

from symaware_cli.specification import formula as stl
from symaware_cli.specification.formula import Formula, from_now
from symaware_cli.specification.future_stream import (
    AheadStream,
    NextStream,
    ToTheEndStream,
    UntilStream,
    WholeRunStream,
)
from symaware_cli.specification.past_stream import AgoStream, SinceStream, SoFarStream
from symaware_cli.specification.stream import Clock, ConstantStream, JunctionStream, NotStream, PredicateStream, Stream


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
    greatest = isinstance(formula, stl.Or | stl.Eventually | stl.Once)
    match formula:
        case stl.Constant():
            return ConstantStream(clock, formula.value)
        case stl.Predicate():
            return PredicateStream(clock, formula.index)
        case stl.Not():
            return NotStream(clock, stream(formula.operand, clock, last))
        case stl.And() | stl.Or():
            if len(formula.operands) == 1:
                return stream(formula.operands[0], clock, last)
            operands = [stream(each, clock, last) for each in formula.operands]
            return JunctionStream(clock, operands, greatest, last)
        case (
            stl.Always(first, None)
            | stl.Eventually(first, None)
            | stl.Historically(first, None)
            | stl.Once(first, None)
        ) if first:
            shifted = replace(formula, last=first, operand=replace(formula, first=0))
            return stream(shifted, clock, last)
        case stl.Always(_, None, operand) | stl.Eventually(_, None, operand):
            below = stream(operand, clock, ever)
            if last == 0 and below.is_momentary:
                return WholeRunStream(clock, below, greatest)
            return ToTheEndStream(clock, below, greatest, last)
        case stl.Always(first, int(until), operand) | stl.Eventually(first, int(until), operand):
            return AheadStream(clock, stream(operand, clock, further(until)), first, until, greatest, last)
        case stl.Next(operand, weak):
            return NextStream(clock, stream(operand, clock, further(1)), weak)
        case stl.Historically(_, None, operand) | stl.Once(_, None, operand):
            return SoFarStream(clock, stream(operand, clock, last), greatest)
        case stl.Historically(first, int(until), operand) | stl.Once(first, int(until), operand):
            return AgoStream(clock, stream(operand, clock, last), first, until, greatest)
        case stl.Until(0, until, left, right):
            lasts = ever if until is None else further(until)
            return UntilStream(clock, stream(left, clock, lasts), stream(right, clock, lasts), until, last, lasts)
        case stl.Since(0, None, left, right):
            return SinceStream(clock, stream(left, clock, last), stream(right, clock, last), last)
        case stl.Until() | stl.Since():
            return stream(from_now(formula), clock, last)
    raise TypeError(f"{formula!r} is no formula")
