"""Vectorised evaluation of expressions for many agents at once: values in columns, and the robustness of predicates.

A value is a number that all rows share, or an array with the rows along its first axis: shape (n,) for a number per
row, (n, d) for a vector per row. The result of a row, to the bit, depends neither on the number of rows nor on its
index.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.vectors import lengths
from symaware_cli.specification.formula import Array, encoded, plain
from symaware_cli.specification.node import Arithmetic, Call, Comparison, Constant, Element, Name, Node, Sign, Vector
from symaware_cli.specification.region import PlacedRegion

#: Returns the values of a name for all rows.
Lookup = Callable[[str], Any]
Evaluate = Callable[[Lookup], Any]


class KindError(TypeError):
    """A value has the wrong type for an operation; the message names both."""


def values(node: Node) -> Evaluate:
    """Compile a tree without temporal or logical operators into a function that evaluates it."""
    match node:
        case Constant(value=value):
            return lambda lookup: value
        case Name(name=name):
            return lambda lookup: lookup(name)
        case Sign(operator=sign, operand=operand):
            inner = values(operand)
            return inner if sign == "+" else lambda lookup: -_number(inner(lookup))
        case Arithmetic():
            call, left, right = _ARITHMETIC[node.operator], values(node.left), values(node.right)
            return lambda lookup: call(*_aligned(_number(left(lookup)), _number(right(lookup))))
        case Comparison():
            return _comparison(node)
        case Call():
            function, parts = COLUMN_FUNCTIONS[node.function], [values(each) for each in node.arguments]
            return lambda lookup: function(*[part(lookup) for part in parts])
        case Element(operand=operand, key=key):
            inner = values(operand)
            return lambda lookup: _element(inner(lookup), key)
        case Vector():
            parts = [values(each) for each in node.items]
            return lambda lookup: _vector([_number(part(lookup)) for part in parts])
    raise KindError("a condition stands where a value is needed")


def robustness(node: Node) -> Callable[[Lookup], Any]:
    """Compile a predicate into a function that returns its robustness, encoded as by `formula.encoded`.

    Args:
        node: A comparison, ``inside(...)``, ``all(...)`` or ``any(...)`` of a comparison, or a Boolean value.
    """
    match node:
        case Comparison():
            return _margin(node)
        case Call(function="inside"):
            point, region = (values(each) for each in node.arguments)
            return lambda lookup: _inside(point(lookup), region(lookup))
        case Call(function="all" | "any") if isinstance(node.arguments[0], Comparison):
            margin, least = _margin(node.arguments[0], whole=False), node.function == "all"
            return lambda lookup: _reduced(np.minimum if least else np.maximum, margin(lookup))
        case _:
            truth = values(node)
            return lambda lookup: _infinite(truth(lookup))


def _number(value: Any) -> Any:
    if isinstance(value, bool):
        return float(value)
    if isinstance(value, float | int):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "fbiu":
        return value if value.dtype == np.float64 else value.astype(float)
    raise KindError(f"{_kind(value)} is not a number")


def _kind(value: Any) -> str:
    if isinstance(value, PlacedRegion):
        return f"the region `{value.name}`"
    if isinstance(value, str) or (isinstance(value, np.ndarray) and value.dtype == object):
        return "a text"
    return "nothing" if value is None else "a table" if isinstance(value, Mapping) else "a value"


def _aligned(one: Any, other: Any) -> tuple[Any, Any]:
    """Give two values the same number of axes, so that a number per row is combined with each element of a vector."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.ndim != other.ndim:
        few, many = (one, other) if one.ndim < other.ndim else (other, one)
        few = few.reshape(few.shape + (1,) * (many.ndim - few.ndim))
        return (few, many) if one.ndim < other.ndim else (many, few)
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        for mine, its in zip(one.shape[1:], other.shape[1:], strict=True):
            if mine != its and 1 not in (mine, its):
                raise KindError(f"a vector of {mine} does not go with one of {its}")
    return one, other


def _vector(items: Sequence[Any]) -> Array:
    rows = max((len(each) for each in items if isinstance(each, np.ndarray)), default=1)
    if any(isinstance(each, np.ndarray) and each.ndim > 1 for each in items):
        raise KindError("the elements of a vector are numbers")
    return np.stack([np.broadcast_to(np.asarray(each, float), (rows,)) for each in items], axis=1)


def _element(value: Any, key: int | str) -> Any:
    if isinstance(key, int) and isinstance(value, np.ndarray) and value.dtype != object:
        if value.ndim < 2:
            raise KindError("a number has no elements")
        if not -value.shape[1] <= key < value.shape[1]:
            raise KindError(f"there is no element {key} in a vector of {value.shape[1]}")
        return value[:, key]
    if isinstance(key, str) and hasattr(value, "__getitem__") and not isinstance(value, str | np.ndarray):
        return value[key]
    raise KindError(f"{_kind(value)} has no element {key!r}")


def _columns(value: Array) -> list[Array]:
    """Return the elements of each row's value as arrays of shape (n,)."""
    flat = value.reshape(len(value), -1)
    return [flat[:, column] for column in range(flat.shape[1])]


def _reduced(choose: Any, value: Any) -> Any:
    """Return the least or greatest element of each row."""
    if not isinstance(value, np.ndarray):
        return value
    first, *others = _columns(value)
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
    return lengths(value.reshape(len(value), -1))


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


def _remainder(angle: Any) -> Any:
    return np.remainder(angle + np.pi, 2 * np.pi) - np.pi


def _elementwise(call: Callable[..., Any]) -> Callable[..., Any]:
    def function(*given: Any) -> Any:
        numbers = [_number(each) for each in given]
        return call(*(_aligned(*numbers) if len(numbers) == 2 else numbers))

    return function


def _truths(choose: Any) -> Callable[[Any], Any]:
    return lambda value: _reduced(choose, np.asarray(value) != 0)


#: As `expression.FUNCTIONS`, for all rows at once.
COLUMN_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": _elementwise(np.abs),
    "all": _truths(np.logical_and),
    "any": _truths(np.logical_or),
    "atan2": _elementwise(np.arctan2),
    "cos": _elementwise(np.cos),
    "count": lambda value: sum((each != 0).astype(float) for each in _columns(np.asarray(value))),
    "distance": _distance,
    "inside": lambda point, region: _inside(point, region) > 0.0,
    "max": _extreme(np.maximum),
    "min": _extreme(np.minimum),
    "norm": lambda value: _norm(_number(value)),
    "signed_distance": lambda point, region: plain(_inside(point, region)),
    "sin": _elementwise(np.sin),
    "sqrt": _elementwise(np.sqrt),
    "wrap": _elementwise(_remainder),
}

_ARITHMETIC: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": lambda one, other: np.where(np.equal(other, 0.0), np.nan, np.divide(one, other)),  # NaN, never infinity
    "%": np.remainder,
    "**": lambda base, power: np.power(np.asarray(base, float), power),
}


def _comparison(node: Comparison) -> Evaluate:
    margin = _margin(node, whole=False)
    return lambda lookup: np.asarray(margin(lookup)) > 0.0


def _margin(node: Comparison, *, whole: bool = True) -> Evaluate:
    """Compile a comparison into its robustness; of a chain, the least.

    Args:
        node: The comparison.
        whole: Whether the result must be one number per row; otherwise vectors are compared element by element.
    """
    operands = [values(each) for each in node.operands]

    def margin(lookup: Lookup) -> Any:
        compared = [operand(lookup) for operand in operands]
        margins = [_pair(sign, *pair) for sign, pair in zip(node.operators, pairwise(compared), strict=True)]
        total = margins[0]
        for each in margins[1:]:
            total = np.minimum(*_aligned(total, each))
        if whole and total.ndim > 1:
            raise KindError(f"this compares {total.shape[1]} values of each; say all(...) or any(...)")
        return total

    return margin


def _pair(sign: str, one: Any, other: Any) -> Array:
    """Return the robustness of a comparison of two values."""
    if sign in ("==", "!="):
        return _equality(one, other, equal=sign == "==")
    one, other = _aligned(_number(one), _number(other))
    difference = np.asarray(other - one if sign in ("<", "<=") else one - other, float)
    return encoded(difference, sign in ("<=", ">="))


def _equality(one: Any, other: Any, *, equal: bool) -> Array:
    """Return the distance of values from being equal, or different; infinite for non-numeric values."""
    try:
        one, other = _aligned(_number(one), _number(other))
        apart = _reduced(np.maximum, np.abs(np.asarray(one - other, float)))
    except KindError:
        same = np.asarray(one == other)
        return np.where(same if equal else ~same, np.inf, -np.inf)
    return encoded(np.asarray(-apart if equal else apart), equal)


def _infinite(truth: Any) -> Array:
    """Return the robustness of a Boolean value: plus or minus infinity."""
    found: NDArray[Any] = np.asarray(truth)
    if found.dtype != bool:
        raise KindError(f"{'a number' if found.dtype.kind in 'fiu' else _kind(truth)} is not a condition; compare it")
    if found.ndim > 1:
        raise KindError(f"there are {found.shape[1]} values of each; say all(...) or any(...)")
    return np.where(found, np.inf, -np.inf)
