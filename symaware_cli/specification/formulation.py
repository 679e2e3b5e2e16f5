"""Translates the syntax tree of a specification into a formula: separate predicates, windows in steps, checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from symaware_cli.core import nanoseconds
from symaware_cli.specification import formula as stl
from symaware_cli.specification.columns import KindError, Lookup, robustness
from symaware_cli.specification.node import NEXT, Constant, Junction, Node, Not, Temporal, walk
from symaware_cli.specification.printing import printed
from symaware_cli.specification.token import ExpressionError

#: Maximum depth of nested operators in a formula.
_DEEPEST = 50

#: The number of instants beyond the end of the run at which formulas are evaluated at most: predictions reach there.
_BEYOND = 10_000


@dataclass(frozen=True, slots=True)
class Atom:
    """A predicate of a formula.

    Attributes:
        node: Its syntax tree.
        text: Its text, for messages.
        robustness: Evaluates it for all rows.
    """

    node: Node
    text: str
    robustness: Callable[[Lookup], Any]


@dataclass(frozen=True, slots=True)
class Formulation:
    """The formula of a specification, with its predicates.

    Attributes:
        formula: The formula; its predicates refer to atoms by position.
        atoms: The distinct predicates, in order of occurrence.
        tree: The syntax tree of the formula.
        time_step: The time between two instants, in nanoseconds.
    """

    formula: stl.Formula
    atoms: tuple[Atom, ...]
    tree: Node
    time_step: int

    @property
    def horizon(self) -> int | None:
        """After how many steps the robustness is known; None if only at the end of the run."""
        return stl.horizon(self.formula)


def formulate(tree: Node, time_step: int, steps: int = 0) -> Formulation:
    """Translate the syntax tree of a specification into a formula.

    Args:
        tree: The syntax tree.
        time_step: The time between two instants, in nanoseconds.
        steps: The number of steps of the run, beyond which windows are cut, as they need memory.

    Raises:
        ExpressionError: A window contains no instant, a temporal operator is used as a value, the operators are nested
            too deeply, or the windows reach too far.
    """
    builder = _Formulator(time_step)
    instants = 2 * steps + _BEYOND
    formula = stl.cut(builder.formula(tree, 0), instants)
    # Without windows in the past within windows ahead, each cut window reaches some more than `instants`.
    if stl.reach(formula) > 2 * _DEEPEST * instants:
        said = "windows in the past, within windows ahead, reach too far beyond the end of the run"
        raise ExpressionError(said, tree.span)
    return Formulation(formula, tuple(builder.atoms), tree, time_step)


def parts(node: Node) -> tuple[Node, ...]:
    """Return the parts of a node that correspond to the operands of its formula, from left to right.

    Of ``a implies b``, which means ``not a or b``, they are ``not a`` and ``b``.
    """
    match node:
        case Junction(operator="implies", operands=(premise, conclusion)):
            return Not(premise.span, premise), conclusion
        case Junction() | Temporal():
            return node.operands
        case Not(operand=operand):
            return (operand,)
    return ()


def subformula(tree: Node, path: Sequence[int]) -> Node:
    """Return the part of a specification at a path of operand positions in its formula."""
    for place in path:
        tree = parts(tree)[place]
    return tree


class _Formulator:
    """Translates a tree recursively and collects its distinct predicates."""

    def __init__(self, time_step: int) -> None:
        self._time_step = time_step
        self.atoms: list[Atom] = []
        self._places: dict[Node, int] = {}

    def formula(self, node: Node, depth: int) -> stl.Formula:
        if depth > _DEEPEST:
            raise ExpressionError("the formula is nested too deeply", node.span)
        match node:
            case Constant(value=bool() as value):
                return stl.Constant(value)
            case Not(operand=operand):
                return stl.Not(self.formula(operand, depth + 1))
            case Junction():
                operands = tuple(self.formula(each, depth + 1) for each in parts(node))
                return stl.And(operands) if node.operator == "and" else stl.Or(operands)
            case Temporal():
                return self._temporal(node, depth)
        return self._predicate(node)

    def _temporal(self, node: Temporal, depth: int) -> stl.Formula:
        operands = [self.formula(each, depth + 1) for each in node.operands]
        if node.operator in NEXT:
            return stl.Next(operands[0], weak=node.operator == "weak next")
        first, last = self._steps(node)
        match node.operator:
            case "until":
                return stl.Until(first, last, *operands)
            case "since":
                return stl.Since(first, last, *operands)
            case "always":
                return stl.Always(first, last, operands[0])
            case "historically":
                return stl.Historically(first, last, operands[0])
            case "once":
                return stl.Once(first, last, operands[0])
            case "eventually":
                return stl.Eventually(first, last, operands[0])
        raise AssertionError(f"`{node.operator}` has no formula")

    def _steps(self, node: Temporal) -> tuple[int, int | None]:
        """Return the window of an operator in steps."""
        if node.window is None:
            return 0, None
        start, end = node.window
        step = self._time_step
        first = -(-nanoseconds(start) // step)
        if math.isinf(end):
            return first, None
        last = nanoseconds(end) // step
        if first > last:
            said = f"no instant lies in the window from {start:g} s to {end:g} s: they are {step / 1e9:g} s apart"
            raise ExpressionError(said, node.span)
        return first, last

    def _predicate(self, node: Node) -> stl.Formula:
        for each in walk(node):
            if isinstance(each, Temporal | Junction | Not):
                word = each.operator if isinstance(each, Temporal | Junction) else "not"
                raise ExpressionError(f"`{word}` cannot stand within a value or the arguments of a function", each.span)
        if node not in self._places:
            try:
                evaluate = robustness(node)
            except KindError as error:
                raise ExpressionError(str(error), node.span) from None
            self._places[node] = len(self.atoms)
            self.atoms.append(Atom(node, printed(node), evaluate))
        return stl.Predicate(self._places[node])
