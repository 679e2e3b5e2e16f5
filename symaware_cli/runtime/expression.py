"""Expressions in a scenario, such as ``risk > 0.2 and distance(position, goal) > 1``.

They are parsed with Python's own grammar, but only what stands here is understood, and nothing of Python is reached:
no attributes, no calls but those of `FUNCTIONS`, no loops. Work and memory are bounded by the length of the text.
"""

from __future__ import annotations

import ast
import itertools
import math
import operator
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.core import TimeSeries

#: What a name stands for.
Lookup = Callable[[str], Any]
_Node = Callable[[Lookup], Any]

_LONGEST = 500


class ExpressionError(ValueError):
    """A text is no expression.

    Attributes:
        problem: What is wrong, in one sentence.
        start: Where in the text, in characters.
        end: Where that ends.
        names: What could stand there, if it is a name that is wrong.
        name: The name that is wrong, if one is.
    """

    def __init__(self, problem: str, start: int, end: int, name: str = "", names: Collection[str] = ()) -> None:
        super().__init__(problem)
        self.problem = problem
        self.start = start
        self.end = end
        self.name = name
        self.names = sorted(names)


class EvaluationError(Exception):
    """An expression has no value at present; the message says why."""


class Expression:
    """An expression that was found to be sound.

    Attributes:
        text: As written.
        names: What it refers to, sorted.
    """

    __slots__ = ("_node", "names", "text")

    def __init__(self, text: str, names: Collection[str]) -> None:
        """Parse an expression.

        Args:
            text: As written.
            names: What it may refer to.

        Raises:
            ExpressionError: It is none.
        """
        parser = _Parser(text, names)
        self.text = text
        self._node = parser.parse()
        self.names = tuple(sorted(parser.used))

    def value(self, lookup: Lookup) -> Any:
        """Evaluate.

        Args:
            lookup: Tells what a name stands for.

        Raises:
            EvaluationError: It has no value, such as for a division by zero.
        """
        try:
            with np.errstate(all="ignore"):
                return self._node(lookup)
        except EvaluationError:
            raise
        except Exception as error:
            said = " ".join(str(error).split()).strip("\"'") or type(error).__name__
            raise EvaluationError(f"`{self.text}` has no value: {said}") from error

    def holds(self, lookup: Lookup) -> bool:
        """Evaluate a condition.

        Raises:
            EvaluationError: It has no value, or is neither true nor false.
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
    """Make a value such that arithmetic with it costs little and cannot grow: numbers and arrays of them only."""
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


def _extreme(choose: Callable[..., Any]) -> Callable[..., float]:
    def function(*values: Any) -> float:
        numbers = np.concatenate([np.atleast_1d(_numeric(value)).ravel() for value in values])
        if not numbers.size:
            raise ValueError("there are no values to choose from")
        return float(choose(numbers))

    return function


def _numeric_function(call: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *values: call(*map(_numeric, values))


#: What an expression may call: how many arguments (None for any number but 0), and the function.
FUNCTIONS: Mapping[str, tuple[int | None, Callable[..., Any]]] = {
    "abs": (1, _numeric_function(np.abs)),
    "all": (1, lambda values: bool(np.all(values))),
    "any": (1, lambda values: bool(np.any(values))),
    "atan2": (2, _numeric_function(np.arctan2)),
    "cos": (1, _numeric_function(np.cos)),
    "count": (1, lambda values: float(np.count_nonzero(values))),
    "distance": (2, _distance),
    "max": (None, _extreme(np.max)),
    "min": (None, _extreme(np.min)),
    "norm": (1, lambda value: float(np.linalg.norm(_numeric(value)))),
    "sin": (1, _numeric_function(np.sin)),
    "sqrt": (1, _numeric_function(np.sqrt)),
    "wrap": (1, _numeric_function(lambda angle: np.remainder(angle + math.pi, 2 * math.pi) - math.pi)),
}

_ARITHMETIC: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


def _equal(one: Any, other: Any) -> Any:
    if isinstance(one, str) or isinstance(other, str):
        return isinstance(one, str) and isinstance(other, str) and one == other
    if isinstance(one, list | tuple | np.ndarray) or isinstance(other, list | tuple | np.ndarray):
        return bool(np.array_equal(one, other))
    return one == other


class _Parser:
    """Turns a syntax tree into functions; knows where in the text each part stands."""

    def __init__(self, text: str, names: Collection[str]) -> None:
        self._text = text
        self._names = names
        self.used: set[str] = set()

    def parse(self) -> _Node:
        text = self._text
        if len(text) > _LONGEST:
            raise ExpressionError(f"an expression has at most {_LONGEST} characters, not {len(text)}", 0, len(text))
        if not text.strip():
            raise ExpressionError("the expression is empty", 0, len(text))
        flat = text.replace("\n", " ")
        self._indent = len(flat) - len(flat.lstrip())
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # about style, and not ours to repeat
                tree = ast.parse(flat.lstrip(), mode="eval")
        except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
            start = self._indent + max(0, (getattr(error, "offset", None) or 1) - 1)
            start = min(start, max(0, len(text) - 1))
            raise ExpressionError("this is no expression", start, start + 1) from None
        try:
            return self._node(tree.body)
        except RecursionError:
            raise ExpressionError("the expression is nested too deep", 0, len(text)) from None

    def _fail(self, node: ast.AST, problem: str, name: str = "", names: Collection[str] = ()) -> ExpressionError:
        # Columns of the tree are counted in bytes.
        encoded = self._text.replace("\n", " ").lstrip().encode()
        first, last = (getattr(node, each, 0) or 0 for each in ("col_offset", "end_col_offset"))
        start, end = (self._indent + len(encoded[:each].decode(errors="ignore")) for each in (first, last))
        return ExpressionError(problem, start, max(end, start + 1), name, names)

    def _node(self, node: ast.expr) -> _Node:
        match node:
            case ast.Constant(value=bool() | None | str()):
                value = node.value
                return lambda lookup: value
            case ast.Constant(value=int() | float()):
                number = self._number(node)
                return lambda lookup: number
            case ast.Name():
                return self._name(node)
            case ast.BoolOp():
                return self._logic(node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.BinOp():
                return self._arithmetic(node)
            case ast.Compare():
                return self._comparison(node)
            case ast.Call():
                return self._call(node)
            case ast.Subscript():
                return self._element(node)
            case ast.List() | ast.Tuple():
                parts = [self._node(each) for each in node.elts]
                return lambda lookup: np.array([_numeric(part(lookup)) for part in parts])
        raise self._fail(node, f"`{self._excerpt(node)}` is not among what an expression may hold")

    def _excerpt(self, node: ast.expr) -> str:
        error = self._fail(node, "")
        return self._text[error.start : error.end]

    def _number(self, node: ast.Constant) -> float:
        try:
            number = float(node.value)  # type: ignore[arg-type]
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self._fail(node, "the number is too large")
        return number

    def _name(self, node: ast.Name) -> _Node:
        name = node.id
        if name not in self._names:
            if name in FUNCTIONS:
                raise self._fail(node, f"`{name}` is a function: write {name}(...)")
            raise self._fail(node, f"there is no `{name}` here", name, self._names)
        self.used.add(name)
        return lambda lookup: lookup(name)

    def _logic(self, node: ast.BoolOp) -> _Node:
        parts = [self._node(each) for each in node.values]
        if isinstance(node.op, ast.And):
            return lambda lookup: all(_truth(part(lookup)) for part in parts)
        return lambda lookup: any(_truth(part(lookup)) for part in parts)

    def _unary(self, node: ast.UnaryOp) -> _Node:
        inner = self._node(node.operand)
        match node.op:
            case ast.Not():
                return lambda lookup: not _truth(inner(lookup))
            case ast.USub():
                return lambda lookup: -_numeric(inner(lookup))
            case ast.UAdd():
                return lambda lookup: _numeric(inner(lookup))
        raise self._fail(node, f"`{self._excerpt(node)}` is not among what an expression may hold")

    def _arithmetic(self, node: ast.BinOp) -> _Node:
        call = _ARITHMETIC.get(type(node.op))
        if call is None:
            raise self._fail(node, f"`{self._excerpt(node)}` is not among what an expression may hold")
        left, right = self._node(node.left), self._node(node.right)
        return lambda lookup: call(_numeric(left(lookup)), _numeric(right(lookup)))

    def _comparison(self, node: ast.Compare) -> _Node:
        operands: Sequence[_Node] = [self._node(each) for each in (node.left, *node.comparators)]
        calls = [self._comparator(each, node) for each in node.ops]

        def compare(lookup: Lookup) -> Any:
            values = [operand(lookup) for operand in operands]
            results = [call(*pair) for call, pair in zip(calls, itertools.pairwise(values), strict=True)]
            # One comparison of arrays may give an array, for all(...) and any(...).
            return results[0] if len(results) == 1 else all(_truth(each) for each in results)

        return compare

    def _comparator(self, kind: ast.cmpop, node: ast.Compare) -> Callable[[Any, Any], Any]:
        order = _COMPARISONS.get(type(kind))
        if order is not None:
            return lambda one, other: order(_numeric(one), _numeric(other))
        if isinstance(kind, ast.Eq):
            return _equal
        if isinstance(kind, ast.NotEq):
            return lambda one, other: not _equal(one, other)
        raise self._fail(node, "of comparisons there are <, <=, >, >=, == and !=")

    def _call(self, node: ast.Call) -> _Node:
        if not isinstance(node.func, ast.Name):
            raise self._fail(node, f"`{self._excerpt(node.func)}` cannot be called")
        name = node.func.id
        if name not in FUNCTIONS:
            raise self._fail(node.func, f"there is no function `{name}`", name, FUNCTIONS)
        count, function = FUNCTIONS[name]
        if node.keywords or any(isinstance(each, ast.Starred) for each in node.args):
            raise self._fail(node, f"{name}(...) takes plain arguments")
        if len(node.args) != count if count is not None else not node.args:
            wanted = "at least 1 argument" if count is None else f"{count} argument{'s' if count > 1 else ''}"
            raise self._fail(node, f"{name}(...) takes {wanted}, not {len(node.args)}")
        parts = [self._node(each) for each in node.args]
        return lambda lookup: function(*[part(lookup) for part in parts])

    def _element(self, node: ast.Subscript) -> _Node:
        inner, key = self._node(node.value), node.slice
        sign = -1 if isinstance(key, ast.UnaryOp) and isinstance(key.op, ast.USub) else 1
        constant = key.operand if isinstance(key, ast.UnaryOp) and sign < 0 else key
        if not isinstance(constant, ast.Constant) or type(constant.value) not in (int, str):
            raise self._fail(key, 'an element is named by a number or a text, such as state[0] or knowledge["goal"]')
        index = sign * constant.value if isinstance(constant.value, int) else constant.value
        return lambda lookup: _item(inner(lookup), index)


def _item(value: Any, index: Any) -> Any:
    if isinstance(value, str):
        raise TypeError("a text has no elements here")
    return value[index]
