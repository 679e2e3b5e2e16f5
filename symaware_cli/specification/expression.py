"""Expressions with a value at one instant, such as ``risk > 0.2 and distance(position, goal) > 1``.

Conditions of components, triggers, ``run.until`` and ``present`` use them. An expression has access only to the names
it is given and to the functions listed here, never to Python.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.core import TimeSeries
from symaware_cli.specification.formula import plain
from symaware_cli.specification.node import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Element,
    Junction,
    Name,
    Node,
    Not,
    Sign,
    Temporal,
    Vector,
    walk,
)
from symaware_cli.specification.parser import parse
from symaware_cli.specification.region import PlacedRegion
from symaware_cli.specification.token import ExpressionError

__all__ = ["FUNCTIONS", "EvaluationError", "Expression", "ExpressionError", "Functions", "Lookup"]

#: Returns the value of a name.
Lookup = Callable[[str], Any]
_Evaluate = Callable[[Lookup], Any]
#: The functions an expression may call: number of arguments (None for any number but 0) and implementation.
Functions = Mapping[str, tuple[int | None, Callable[..., Any]]]

#: Maximum length of a condition, in characters.
_LONGEST = 500


class EvaluationError(Exception):
    """An expression has no value at present; the message gives the reason."""


class Expression:
    """A parsed expression.

    Attributes:
        text: The text.
        tree: Its syntax tree.
        names: The names it refers to, sorted.
    """

    __slots__ = ("_evaluate", "names", "text", "tree")

    def __init__(self, text: str, names: Collection[str], functions: Functions | None = None) -> None:
        """Parse an expression.

        Args:
            text: The text.
            names: The names it may refer to.
            functions: The functions it may call; `FUNCTIONS` by default.

        Raises:
            ExpressionError: The text is not a valid expression.
        """
        functions = FUNCTIONS if functions is None else functions
        tree = parse(text, names, {name: count for name, (count, _) in functions.items()}, longest=_LONGEST)
        for node in walk(tree):
            if isinstance(node, Temporal):
                raise ExpressionError(
                    f"`{node.operator}` belongs in a specification: a condition is about one instant", node.span
                )
        self.text = text
        self.tree = tree
        self._evaluate = _evaluator(tree, functions)
        self.names = tuple(sorted({node.name for node in walk(tree) if isinstance(node, Name)}))

    def value(self, lookup: Lookup) -> Any:
        """Evaluate the expression.

        Args:
            lookup: Returns the value of a name.

        Raises:
            EvaluationError: The expression has no value, for example because of a division by zero.
        """
        try:
            with np.errstate(all="ignore"):
                return self._evaluate(lookup)
        except EvaluationError:
            raise
        except Exception as error:
            said = " ".join(str(error).split()).strip("\"'") or type(error).__name__
            raise EvaluationError(f"`{self.text}` has no value: {said}") from error

    def holds(self, lookup: Lookup) -> bool:
        """Evaluate a condition.

        Raises:
            EvaluationError: The expression has no value, or one that is neither true nor false.
        """
        value = self.value(lookup)
        try:
            return _truth(value)
        except TypeError as error:
            raise EvaluationError(f"`{self.text}` is no condition: {error}") from error


def _truth(value: Any) -> bool:
    if isinstance(value, np.ndarray) and value.ndim:
        raise TypeError(f"it gives {value.size} values; say all(...) or any(...)")
    return bool(value)


def _numeric(value: Any) -> Any:
    """Convert to a float or an array of floats, so that arithmetic is cheap and values cannot grow without limit."""
    if isinstance(value, bool | int | float | np.number | np.bool_):
        return float(value)
    if isinstance(value, np.ndarray | list | tuple):
        return np.asarray(value, float)
    if isinstance(value, TimeSeries):
        return value.values
    raise TypeError(f"a {type(value).__name__} is no number")


def _distance(one: Any, other: Any) -> float:
    first, second = np.broadcast_arrays(_numeric(one), _numeric(other))
    return float(np.linalg.norm(first - second))


def _inside(point: Any, region: Any) -> Any:
    """Return the depth of a point within a region, encoded."""
    if not isinstance(region, PlacedRegion):
        raise TypeError(f"a {type(region).__name__} is not a region")
    return region.robustness(np.atleast_2d(_numeric(point)))[0]


def _extreme(choose: Callable[..., Any]) -> Callable[..., float]:
    def function(*values: Any) -> float:
        numbers = np.concatenate([np.atleast_1d(_numeric(value)).ravel() for value in values])
        if not numbers.size:
            raise ValueError("there are no values to choose from")
        return float(choose(numbers))

    return function


def _numeric_function(call: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *values: call(*map(_numeric, values))


#: The functions of conditions.
FUNCTIONS: Functions = {
    "abs": (1, _numeric_function(np.abs)),
    "all": (1, lambda values: bool(np.all(values))),
    "any": (1, lambda values: bool(np.any(values))),
    "atan2": (2, _numeric_function(np.arctan2)),
    "cos": (1, _numeric_function(np.cos)),
    "count": (1, lambda values: float(np.count_nonzero(values))),
    "distance": (2, _distance),
    "inside": (2, lambda point, region: bool(_inside(point, region) > 0.0)),
    "max": (None, _extreme(np.max)),
    "min": (None, _extreme(np.min)),
    "norm": (1, lambda value: float(np.linalg.norm(_numeric(value)))),
    "signed_distance": (2, lambda point, region: float(plain(_inside(point, region)))),
    "sin": (1, _numeric_function(np.sin)),
    "sqrt": (1, _numeric_function(np.sqrt)),
    "wrap": (1, _numeric_function(lambda angle: np.remainder(angle + math.pi, 2 * math.pi) - math.pi)),
}

_ARITHMETIC: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "%": operator.mod,
    "**": operator.pow,
}
_ORDERS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def _equal(one: Any, other: Any) -> Any:
    if isinstance(one, str) or isinstance(other, str):
        return isinstance(one, str) and isinstance(other, str) and one == other
    if isinstance(one, list | tuple | np.ndarray) or isinstance(other, list | tuple | np.ndarray):
        return bool(np.array_equal(one, other))
    return one == other


def _evaluator(node: Node, functions: Functions) -> _Evaluate:
    """Compile a syntax tree into a function of the lookup."""
    match node:
        case Constant(value=value):
            return lambda lookup: value
        case Name(name=name):
            return lambda lookup: lookup(name)
        case Junction():
            return _junction(node, functions)
        case Not(operand=operand):
            inner = _evaluator(operand, functions)
            return lambda lookup: not _truth(inner(lookup))
        case Sign(operator=sign, operand=operand):
            inner = _evaluator(operand, functions)
            if sign == "+":
                return lambda lookup: _numeric(inner(lookup))
            return lambda lookup: -_numeric(inner(lookup))
        case Arithmetic():
            call = _ARITHMETIC[node.operator]
            left, right = _evaluator(node.left, functions), _evaluator(node.right, functions)
            return lambda lookup: call(_numeric(left(lookup)), _numeric(right(lookup)))
        case Comparison():
            return _comparison(node, functions)
        case Call():
            function, parts = functions[node.function][1], [_evaluator(each, functions) for each in node.arguments]
            return lambda lookup: function(*[part(lookup) for part in parts])
        case Element(operand=operand, key=key):
            inner = _evaluator(operand, functions)
            return lambda lookup: _item(inner(lookup), key)
        case Vector():
            parts = [_evaluator(each, functions) for each in node.items]
            return lambda lookup: np.array([_numeric(part(lookup)) for part in parts])
    raise TypeError(f"{type(node).__name__} has no value at one instant")


def _junction(node: Junction, functions: Functions) -> _Evaluate:
    parts = [_evaluator(each, functions) for each in node.operands]
    if node.operator == "and":
        return lambda lookup: all(_truth(part(lookup)) for part in parts)
    if node.operator == "or":
        return lambda lookup: any(_truth(part(lookup)) for part in parts)
    premise, conclusion = parts
    return lambda lookup: not _truth(premise(lookup)) or _truth(conclusion(lookup))


def _comparison(node: Comparison, functions: Functions) -> _Evaluate:
    operands: Sequence[_Evaluate] = [_evaluator(each, functions) for each in node.operands]
    calls = [_comparator(each) for each in node.operators]

    def compare(lookup: Lookup) -> Any:
        values = [operand(lookup) for operand in operands]
        results = [call(*pair) for call, pair in zip(calls, itertools.pairwise(values), strict=True)]
        # A single comparison of arrays may yield an array, for all(...) and any(...).
        return results[0] if len(results) == 1 else all(_truth(each) for each in results)

    return compare


def _comparator(operator: str) -> Callable[[Any, Any], Any]:
    order = _ORDERS.get(operator)
    if order is not None:
        return lambda one, other: order(_numeric(one), _numeric(other))
    return _equal if operator == "==" else lambda one, other: not _equal(one, other)


def _item(value: Any, key: Any) -> Any:
    if isinstance(value, str):
        raise TypeError("a text has no elements here")
    return value[key]
