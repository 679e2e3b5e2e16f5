"""Evaluation of expressions: the tables of operators and functions, and the robustness of predicates.

Conditions, `run.until`, metrics, specifications and conditions on the rows of a table are all evaluated here, for many
rows at once: agents, pairs, samples of a prediction, or runs of a sweep. The caller looks up the values of names.

A value is a number that all rows share, or an array with the rows along its first axis: shape (n,) for a number per
row, (n, d) for a vector per row. The result of a row, to the bit, depends neither on the number of rows nor on its
index.

An undefined value is NaN, and so is the robustness of a comparison with it. Under
``np.errstate(divide="raise", over="raise")`` a division by zero and a number that is too large are errors.

Reasons: docs/decisions/0072-one-evaluator-of-expressions.md
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import lengths, wrapped
from symaware_cli.specification.absence import AbsentError
from symaware_cli.specification.formula import ZERO, Array, have_one_sign, plain
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
from symaware_cli.specification.parser import RESERVED
from symaware_cli.specification.region import PlacedRegion
from symaware_cli.specification.token import ExpressionError

#: Returns the values of a name for all rows.
Lookup = Callable[[str], Any]
Evaluate = Callable[[Lookup], Any]

#: The errors by which an expression has no value.
NO_VALUE = (TypeError, ValueError, LookupError, ArithmeticError)

#: The least, the greatest, all and any of no values.
_OF_NOTHING: Mapping[np.ufunc, float | bool] = {
    np.minimum: np.inf,
    np.maximum: -np.inf,
    np.logical_and: True,
    np.logical_or: False,
}


#: The type of the elements of nearly all arrays.
_DOUBLE = np.dtype(np.float64)


class KindError(TypeError):
    """A value has the wrong type for an operation; the message names both."""


class Function(NamedTuple):
    """A function of expressions.

    Attributes:
        arguments: How many it takes; None for any number but 0.
        call: Computes it for all rows.
        unit: The unit of its value; ``same`` for that of its arguments, ``root`` for the square root of that, "" if it
            has none.
    """

    arguments: int | None
    call: Callable[..., Any]
    unit: str = ""


Functions = Mapping[str, Function]


def values(node: Node, functions: Functions | None = None) -> Evaluate:
    """Compile a tree without temporal operators into a function that evaluates it.

    Args:
        node: The tree.
        functions: The functions that it calls; `FUNCTIONS` by default.
    """
    functions = FUNCTIONS if functions is None else functions
    of = partial(values, functions=functions)
    match node:
        case Constant(value=value):
            return lambda lookup: value
        case Name(name=name):
            return lambda lookup: lookup(name)
        case Sign(operator=sign, operand=operand):
            inner = of(operand)
            if sign == "+":
                return lambda lookup: _number(inner(lookup))
            return lambda lookup: -_number(inner(lookup))
        case Arithmetic():
            call, left, right = ARITHMETIC[node.operator], of(node.left), of(node.right)
            return lambda lookup: call(*_aligned(_number(left(lookup)), _number(right(lookup))))
        case Comparison():
            margin = _margin(node, functions)
            return lambda lookup: margin(lookup) > 0.0
        case Call():
            function, parts = functions[node.function].call, [of(each) for each in node.arguments]
            if len(parts) == 2:
                one, other = parts
                return lambda lookup: function(one(lookup), other(lookup))
            return lambda lookup: function(*[part(lookup) for part in parts])
        case Element(operand=operand, key=key):
            inner = of(operand)
            return lambda lookup: _element(inner(lookup), key)
        case Vector():
            parts = [of(each) for each in node.items]
            if all(map(_is_fixed, node.items)):
                fixed = _vector([_number(part(dict[str, Any]().__getitem__)) for part in parts])
                return lambda lookup: fixed
            return lambda lookup: _vector([_number(part(lookup)) for part in parts])
        case Not() | Junction():
            return truth(node, functions)
    raise KindError("a formula with temporal operators has no value at one instant")


def _is_fixed(node: Node) -> bool:
    """Whether a tree is a number, with or without a sign."""
    number = node.operand if isinstance(node, Sign) else node
    return isinstance(number, Constant) and isinstance(number.value, int | float)


def truth(node: Node, functions: Functions | None = None) -> Evaluate:
    """Compile a condition without temporal operators into a function that returns whether it holds, for each row.

    It does not hold where it has no value because an agent is absent. Once all rows are decided by the first operands
    of ``and``, ``or`` or ``implies``, the others are not evaluated.

    Args:
        node: The condition.
        functions: As for `values`.
    """
    match node:
        case Not(operand=operand):
            inner = truth(operand, functions)
            return lambda lookup: inner(lookup) ^ True
        case Junction(operator="implies", operands=(premise, conclusion)):
            return truth(Junction(node.span, "or", (Not(premise.span, premise), conclusion)), functions)
        case Junction():
            parts = [truth(each, functions) for each in node.operands]
            return partial(_all_of if node.operator == "and" else _any_of, parts)
    evaluate = values(node, functions)

    def holds(lookup: Lookup) -> Any:
        try:
            return _truths(evaluate(lookup))
        except AbsentError:
            return False

    return holds


def robustness(node: Node) -> Callable[[Lookup], Array]:
    """Compile a predicate into a function that returns its robustness, encoded as by `formula.encoded`.

    Args:
        node: A comparison, ``inside(...)``, ``all(...)`` or ``any(...)`` of a comparison, or a Boolean value.
    """
    match node:
        case Comparison():
            margin = _margin(node)

            def of_each(lookup: Lookup) -> Array:
                found = margin(lookup)
                is_column = isinstance(found, np.ndarray) and found.ndim == 1
                return found if is_column else _one_each(np.asarray(found, float))

            return of_each
        case Call(function="inside"):
            point, region = (values(each) for each in node.arguments)
            return lambda lookup: _inside(point(lookup), region(lookup))
        case Call(function="all" | "any", arguments=(Comparison() as compared,)):
            margin, choose = _margin(compared), np.minimum if node.function == "all" else np.maximum
            return lambda lookup: np.asarray(_reduced(choose, margin(lookup)), float)
    evaluate = values(node)
    return lambda lookup: np.where(_truths(evaluate(lookup)), np.inf, -np.inf)


def check_momentary(tree: Node, said: str) -> None:
    """Check that a tree is about one instant.

    Args:
        tree: The tree.
        said: The reason why it has to be.

    Raises:
        ExpressionError: It has a temporal operator.
    """
    for node in walk(tree):
        if isinstance(node, Temporal):
            raise ExpressionError(f"`{node.operator}` belongs in {said}", node.span)


def _all_of(parts: Sequence[Evaluate], lookup: Lookup) -> Any:
    found = parts[0](lookup)
    for part in parts[1:]:
        if not (found.any() if isinstance(found, np.ndarray) else found):
            break
        found = found & part(lookup)
    return found


def _any_of(parts: Sequence[Evaluate], lookup: Lookup) -> Any:
    found = parts[0](lookup)
    for part in parts[1:]:
        if found.all() if isinstance(found, np.ndarray) else found:
            break
        found = found | part(lookup)
    return found


def _truths(value: Any) -> Any:
    """Return a value that is true or false for each row."""
    if isinstance(value, bool | np.bool_):
        return value
    found: NDArray[Any] = np.asarray(value)
    if found.dtype != bool:
        raise KindError(f"{'a number' if found.dtype.kind in 'fiu' else _kind(value)} is not a condition; compare it")
    return _one_each(found)


def _one_each(value: NDArray[Any]) -> NDArray[Any]:
    if value.ndim > 1:
        raise KindError(f"there are {value.shape[1]} values of each; use all(...) or any(...)")
    return value


def _number(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype is _DOUBLE:  # nearly always; comparing the types of elements takes longer
            return value
        if value.dtype.kind in "fbiu":
            return value if value.dtype == np.float64 else value.astype(float)
    elif isinstance(value, float):
        return value
    if isinstance(value, int | np.number | np.bool_):
        return float(value)
    raise KindError(f"{_kind(value)} is not a number")


def _kind(value: Any) -> str:
    if isinstance(value, PlacedRegion):
        return f"the region `{value.name}`"
    if isinstance(value, str) or (isinstance(value, np.ndarray) and value.dtype == object):
        return "a text"
    return "nothing" if value is None else "a table" if hasattr(value, "__getitem__") else "a value"


def _aligned(one: Any, other: Any) -> tuple[Any, Any]:
    """Give two values the same number of axes.

    A number per row is combined with each element of a vector, and a vector per row with each vector of a table.
    """
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.ndim != other.ndim:
            more = max(one.ndim, other.ndim)
            one, other = (
                each.reshape(each.shape[:1] + (1,) * (more - each.ndim) + each.shape[1:]) for each in (one, other)
            )
        for mine, its in zip(one.shape[1:], other.shape[1:], strict=True):
            if mine != its and 1 not in (mine, its):
                raise KindError(f"a vector of {mine} does not go with one of {its}")
    return one, other


def _vector(items: Sequence[Any]) -> Array:
    columns = [each for each in items if isinstance(each, np.ndarray)]
    if not columns:
        return np.array([items])
    if any(each.ndim > 1 for each in columns):
        raise KindError("the elements of a vector are numbers")
    rows = max(map(len, columns))
    return np.stack([np.broadcast_to(np.asarray(each, float), (rows,)) for each in items], axis=1)


def _element(value: Any, key: int | str) -> Any:
    if isinstance(value, np.ndarray):
        if isinstance(key, int) and value.dtype != object:
            if value.ndim < 2:
                raise KindError("a number has no elements")
            if not value.shape[1]:
                raise AbsentError("there are no agents")
            if not -value.shape[1] <= key < value.shape[1]:
                raise KindError(f"there is no element {key} in a vector of {value.shape[1]}")
            return _shared(value[:, key])
    elif hasattr(value, "__getitem__") and not isinstance(value, str):
        return value[key]
    raise KindError(f"{_kind(value)} has no element {key!r}")


def _shared(numbers: NDArray[Any]) -> Any:
    """Return the number of a single row as one that all rows share, which saves time."""
    return numbers.item() if numbers.shape == (1,) else numbers


def _flat(value: NDArray[Any]) -> NDArray[Any]:
    """Return all elements of each row; shape (n, k)."""
    return value if value.ndim == 2 else value.reshape(len(value), math.prod(value.shape[1:]))


def _reduced(choose: Any, value: Any) -> Any:
    """Return the least or greatest element of each row, or whether all or any are true."""
    if not isinstance(value, np.ndarray):
        return value
    if not value.size:
        return np.full(len(value), _OF_NOTHING[choose])
    if len(value) == 1:
        return choose.reduce(value, axis=None)
    first, *others = _flat(value).T
    for each in others:
        first = choose(first, each)
    return first


def _extreme(choose: Any) -> Callable[..., Any]:
    def function(*given: Any) -> Any:
        parts = [_reduced(choose, _number(each)) for each in given]
        total = parts[0]
        for each in parts[1:]:
            total = choose(total, each)
        return total

    return function


def _norm(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return abs(value)
    return _shared(lengths(_flat(value)))


def _distance(one: Any, other: Any) -> Any:
    first, second = _aligned(_number(one), _number(other))
    return _norm(first - second)


def _points(value: Any) -> Array:
    point = _number(value)
    if not isinstance(point, np.ndarray) or point.ndim != 2:
        raise KindError("a point has coordinates, such as position")
    return point


def _inside(point: Any, region: Any) -> Array:
    if not isinstance(region, PlacedRegion):
        raise KindError(f"{_kind(region)} is not a region")
    return region.robustness(_points(point))


def _elementwise(call: Callable[..., Any]) -> Callable[..., Any]:
    def function(*given: Any) -> Any:
        numbers = [_number(each) for each in given]
        return call(*(_aligned(*numbers) if len(numbers) == 2 else numbers))

    return function


def _every(choose: Any) -> Callable[[Any], Any]:
    return lambda value: _reduced(choose, _number(value) != 0.0)


def _count(value: Any) -> Any:
    number = _number(value)
    if not isinstance(number, np.ndarray):
        return float(number != 0.0)
    return np.count_nonzero(_flat(number), axis=1).astype(float)


#: The functions of expressions.
FUNCTIONS: Functions = {
    "abs": Function(1, _elementwise(np.abs), "same"),
    "all": Function(1, _every(np.logical_and)),
    "any": Function(1, _every(np.logical_or)),
    "atan2": Function(2, _elementwise(np.arctan2)),
    "cos": Function(1, _elementwise(np.cos), "1"),
    "count": Function(1, _count, "1"),
    "distance": Function(2, _distance, "same"),
    "inside": Function(2, lambda point, region: _inside(point, region) > 0.0),
    "max": Function(None, _extreme(np.maximum), "same"),
    "min": Function(None, _extreme(np.minimum), "same"),
    "norm": Function(1, lambda value: _norm(_number(value)), "same"),
    "signed_distance": Function(2, lambda point, region: plain(_inside(point, region)), "m"),
    "sin": Function(1, _elementwise(np.sin), "1"),
    "sqrt": Function(1, _elementwise(np.sqrt), "root"),
    "wrap": Function(1, _elementwise(wrapped), "same"),
}

#: The number of arguments of each function; see `parser.parse`.
ARGUMENTS: Mapping[str, int | None] = {name: function.arguments for name, function in FUNCTIONS.items()}

#: Words that have a meaning in every expression, so that nothing else can be called so.
TAKEN: frozenset[str] = RESERVED.union(FUNCTIONS)


def _divided(call: Callable[[Any, Any], Any], one: Any, other: Any) -> Any:
    """Divide; a division by zero gives NaN, never infinity."""
    is_zero = np.equal(other, 0.0)
    if not np.count_nonzero(is_zero):  # several times as fast as `any` for few rows
        return call(one, other)
    if np.geterr()["divide"] == "raise":
        raise ZeroDivisionError("division by zero")
    return np.where(is_zero, np.nan, call(one, other))[()]


#: The binary operators of numbers.
ARITHMETIC: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": partial(_divided, np.divide),
    "%": partial(_divided, np.remainder),
    "**": np.power,
}


def _order(one: Any, other: Any, *, holds_at_zero: bool) -> Any:
    """Return the robustness of ``one > other`` or ``one >= other``; infinities that are equal are 0 apart."""
    one, other = _aligned(_number(one), _number(other))
    return _encoded(one - other, one == other, holds_at_zero)


def _equality(one: Any, other: Any, *, equal: bool) -> Any:
    """Return the distance of values from being equal, or different; infinite for non-numeric values."""
    try:
        one, other = _number(one), _number(other)
    except KindError:
        return np.where(np.equal(_reduced(np.logical_and, one == other), equal), np.inf, -np.inf)[()]
    one, other = _aligned(one, other)
    is_same = one == other
    if isinstance(is_same, np.ndarray):
        apart = _reduced(np.maximum, np.where(is_same, 0.0, abs(one - other)))
    else:
        apart = 0.0 if is_same else abs(one - other)
    return _encoded(-apart if equal else apart, apart == 0.0, equal)


def _encoded(margin: Any, is_zero: Any, holds_at_zero: bool) -> Any:
    """Encode a robustness as `formula.encoded` does, given where it is 0."""
    zero = ZERO if holds_at_zero else -ZERO
    if isinstance(is_zero, np.ndarray):
        return np.where(is_zero, zero, margin) if np.count_nonzero(is_zero) else margin
    return zero if is_zero else margin


def _order_with(value: Evaluate, number: float, is_above: bool, holds_at_zero: bool) -> Evaluate:
    """Compile the robustness of ``value > number``, or of another order with a finite number.

    It equals that of `_order`, but both need not be compared as well: their difference is 0 only if they are equal.

    Args:
        value: Evaluates what is compared with the number.
        number: The number.
        is_above: Whether the value is to be greater.
        holds_at_zero: Whether it may be equal.
    """
    zero = ZERO if holds_at_zero else -ZERO
    shared = np.array(number)  # which NumPy combines with an array in half the time of a Python number

    def margin(lookup: Lookup) -> Any:
        found = _number(value(lookup))
        if not isinstance(found, np.ndarray):
            apart = found - number if is_above else number - found
            return zero if apart == 0.0 else apart
        apart = found - shared if is_above else shared - found
        if have_one_sign(apart) or np.count_nonzero(apart) == apart.size:
            return apart
        return np.where(apart == 0.0, zero, apart)

    return margin


#: The robustness of each comparison of two values.
COMPARISONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": lambda one, other: _order(other, one, holds_at_zero=False),
    "<=": lambda one, other: _order(other, one, holds_at_zero=True),
    ">": partial(_order, holds_at_zero=False),
    ">=": partial(_order, holds_at_zero=True),
    "==": partial(_equality, equal=True),
    "!=": partial(_equality, equal=False),
}


def _margin(node: Comparison, functions: Functions | None = None) -> Evaluate:
    """Compile a comparison into its robustness, for vectors element by element; of a chain, the least."""
    operands = [values(each, functions) for each in node.operands]
    calls = [COMPARISONS[sign] for sign in node.operators]
    if len(calls) == 1:
        (compare,), (one, other) = calls, operands
        sign, (first, second) = node.operators[0], node.operands
        for value, given, greater in ((one, second, ">"), (other, first, "<")):
            if sign not in ("==", "!=") and _is_fixed(given):
                number = _number(values(given)(dict[str, Any]().__getitem__))
                if math.isfinite(number):
                    return _order_with(value, number, sign.startswith(greater), sign.endswith("="))
        return lambda lookup: compare(one(lookup), other(lookup))

    def margin(lookup: Lookup) -> Any:
        compared = [operand(lookup) for operand in operands]
        total, *others = [call(*pair) for call, pair in zip(calls, pairwise(compared), strict=True)]
        for each in others:
            total = np.minimum(*_aligned(total, each))
        return total

    return margin
