"""Translates the syntax tree of a specification into a formula: separate predicates, windows in steps, checks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from symaware_cli.core import nanoseconds
from symaware_cli.specification import formula as stl
from symaware_cli.specification.columns import KindError, Lookup, robustness
from symaware_cli.specification.node import Constant, Junction, Node, Not, Temporal, walk
from symaware_cli.specification.printing import printed
from symaware_cli.specification.token import ExpressionError

#: Maximum depth of nested operators in a formula.
_DEEPEST = 50


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


def formulate(tree: Node, time_step: int) -> Formulation:
    """Translate the syntax tree of a specification into a formula.

    Args:
        tree: The syntax tree.
        time_step: The time between two instants, in nanoseconds.

    Raises:
        ExpressionError: A window contains no instant, a temporal operator is used as a value, or the operators are
            nested too deeply.
    """
    builder = _Formulator(time_step)
    formula = builder.formula(tree, 0)
    return Formulation(formula, tuple(builder.atoms), tree, time_step)


def subformula(tree: Node, path: tuple[int, ...]) -> Node:
    """Return the part of a specification at a path of operand positions, which refer to the translated formula."""
    for place in path:
        match tree:
            case Junction():
                tree = tree.operands[place]
            case Not(operand=operand):
                tree = operand
            case Temporal():
                tree = tree.operands[place]
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
                operands = tuple(self.formula(each, depth + 1) for each in node.operands)
                if node.operator == "and":
                    return stl.And(operands)
                if node.operator == "or":
                    return stl.Or(operands)
                return stl.Or((stl.Not(operands[0]), operands[1]))
            case Temporal():
                return self._temporal(node, depth)
        return self._predicate(node)

    def _temporal(self, node: Temporal, depth: int) -> stl.Formula:
        first, last = self._steps(node)
        operands = [self.formula(each, depth + 1) for each in node.operands]
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
        return stl.Eventually(first, last, operands[0])

    def _steps(self, node: Temporal) -> tuple[int, int | None]:
        """Return the window of an operator in steps."""
        if node.operator == "next":
            return 1, 1
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
