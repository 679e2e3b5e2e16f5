"""The values of expressions and the robustness of predicates for one row: one agent, one pair, or the world.

It shares only the parser with the evaluation during a run: it walks the syntax tree row by row, and applies NumPy's
functions to single numbers and vectors as docs/specifications.md defines them, as an independent check of `columns`,
which computes all rows at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Region, RegionShape
from symaware_cli.specification import AbsentError
from symaware_cli.specification.formula import ZERO
from symaware_cli.specification.node import Arithmetic, Call, Comparison, Constant, Element, Name, Node, Sign, Vector

Array = NDArray[np.float64]
#: Returns the value of a name for the row: a number, a vector, a `RegionHere`, a mapping, or anything else.
RowLookup = Callable[[str], Any]
#: Returns the position of an agent, NaN if it is absent, and its heading, None if it has none.
Pose = Callable[[str], tuple[Array, float | None]]


class RegionHere:
    """A region at the present instant."""

    def __init__(self, name: str, regions: Mapping[str, Region], pose: Pose) -> None:
        self._region = regions[name]
        self._regions = regions
        self._pose = pose

    def depth(self, point: Array) -> float:
        """Return the depth of a point in the region [m], negative outside; points at depth 0 belong to a primitive."""
        if self._region.around is None:
            return self._depth(self._region, point)
        position, heading = self._pose(self._region.around)
        if np.isnan(position).any():
            return -np.inf
        moved = point.copy()
        shared = min(len(point), len(position))
        moved[:shared] -= position[:shared]
        if heading is not None and self._region.turns:
            cosine, sine, (x, y) = np.cos(heading), np.sin(heading), moved[:2].tolist()
            moved[0], moved[1] = cosine * x + sine * y, cosine * y - sine * x
        return self._depth(self._region, moved)

    def _depth(self, region: RegionShape, point: Array) -> float:
        members = [
            self._depth(self._regions[each] if isinstance(each, str) else each, point) for each in region.members
        ]
        if region.complement is not None:
            return -members[0]
        if members:
            return float(np.max(members) if region.union is not None else np.min(members))
        if np.isnan(point[: region.dimensions]).any():
            return np.nan
        if region.circle is not None:
            return _signed(region.circle.radius - norm(point[: region.dimensions] - region.circle.centre), True)
        if region.box is not None:
            return _signed(_box_depth(region.box, point), True)
        assert region.polygon is not None
        return _signed(_polygon_depth(region.polygon, point), True)


def _box_depth(bounds: Sequence[float], point: Array) -> float:
    sides = zip(point.tolist(), bounds[::2], bounds[1::2], strict=False)
    beyond = [abs(x - (low + high) / 2) - 0.5 * (high - low) for x, low, high in sides]
    return -max(beyond) if max(beyond) <= 0.0 else -norm(np.maximum(beyond, 0.0))


def _polygon_depth(corners: Sequence[Sequence[float]], point: Array) -> float:
    """Return the depth in a convex polygon: the distance to the lines of the edges inside, to the edges outside."""
    depths, distances = [], []
    for one, other in zip(corners, [*corners[1:], corners[0]], strict=True):
        along, x = np.subtract(other, one), point[:2] - one
        squared = along[0] * along[0] + along[1] * along[1]
        depths.append((along[0] * x[1] - along[1] * x[0]) / np.sqrt(squared))
        share = min(max((along[0] * x[0] + along[1] * x[1]) / squared, 0.0), 1.0)
        distances.append(norm(x - share * along))
    return float(min(depths)) if min(depths) >= 0.0 else -min(distances)


def norm(vector: Array) -> float:
    """Return the Euclidean length of a vector."""
    total = 0.0
    for each in np.ravel(vector).tolist():
        total += each * each
    return float(np.sqrt(total))


def _signed(margin: float, holds_at_zero: bool) -> float:
    """Return a robustness whose sign is the truth value: 0 is replaced by a tiny number, as `formula` describes."""
    return margin if margin != 0.0 else ZERO if holds_at_zero else -ZERO


def row_robustness(node: Node, look_up: RowLookup) -> float:
    """Return the robustness of a predicate; its sign is the truth value.

    Args:
        node: A comparison, `inside(...)`, `all(...)` or `any(...)` of a comparison, or a Boolean value.
        look_up: Returns the values of names for the row.

    Raises:
        TypeError, ValueError, LookupError, ArithmeticError: The predicate has no value; `AbsentError` if an agent is
            absent.
    """
    match node:
        case Comparison():
            margins = _margins(node, look_up)
            if margins.size != 1:
                raise TypeError("this compares several values; use all(...) or any(...)")
            return float(margins.ravel()[0])
        case Call(function="inside", arguments=(point, region)):
            return _depth(row_value(point, look_up), row_value(region, look_up))
        case Call(function="all" | "any", arguments=(Comparison() as compared,)):
            margins = _margins(compared, look_up)
            return float(margins.min(initial=np.inf) if node.function == "all" else margins.max(initial=-np.inf))
    truth = np.asarray(row_value(node, look_up))
    if truth.dtype != bool or truth.ndim:
        raise TypeError("this is no condition; compare it")
    return np.inf if truth else -np.inf


def row_value(node: Node, look_up: RowLookup) -> Any:
    """Return the value of an expression, with `look_up` and errors as for `row_robustness`."""
    match node:
        case Constant(value=value):
            return value
        case Name(name=name):
            return look_up(name)
        case Sign(operator=sign, operand=operand):
            number = _number(row_value(operand, look_up))
            return number if sign == "+" else -number
        case Arithmetic():
            one, other = (_number(row_value(each, look_up)) for each in (node.left, node.right))
            return _ARITHMETIC[node.operator](one, other)
        case Comparison():
            return _margins(node, look_up) > 0.0
        case Call():
            return _FUNCTIONS[node.function](*(row_value(each, look_up) for each in node.arguments))
        case Element(operand=operand, key=key):
            value = row_value(operand, look_up)
            if isinstance(value, np.ndarray) and value.ndim and not len(value):
                raise AbsentError("there are no agents")
            return value[key]
        case Vector(items=items):
            return np.array([float(_number(row_value(each, look_up))) for each in items])
    raise TypeError("this is a condition, but a value is needed")


def _number(value: Any) -> Array:
    """Convert a number, a truth value (1 or 0), or a sequence of them to an array of floats."""
    found = np.asarray(value)
    if found.dtype.kind not in "fbiu":
        raise TypeError(f"{value!r:.50} is no number")
    return found.astype(float)


def _margins(node: Comparison, look_up: RowLookup) -> Array:
    """Return the elementwise robustness of a comparison; for a chain, the least of its comparisons."""
    operands = [row_value(each, look_up) for each in node.operands]
    least: Array | None = None
    for sign, (one, other) in zip(node.operators, itertools.pairwise(operands), strict=True):
        margin = _equality(one, other, sign == "==") if sign in ("==", "!=") else _order(one, other, sign)
        least = margin if least is None else np.minimum(least, margin)
    assert least is not None
    return least


def _order(one: Any, other: Any, sign: str) -> Array:
    first, second = _number(one), _number(other)
    margin = second - first if sign[0] == "<" else first - second
    return np.where(first == second, ZERO if "=" in sign else -ZERO, margin)


def _equality(one: Any, other: Any, equal: bool) -> Array:
    """Return the robustness of the equality or inequality of two values; infinite for non-numeric values."""
    try:
        first, second = _number(one), _number(other)
    except TypeError:
        same = bool(one == other)
        return np.asarray(np.inf if same == equal else -np.inf)
    apart = float(np.where(first == second, 0.0, np.abs(first - second)).max())
    return np.asarray(_signed(-apart if equal else apart, equal))


def _depth(point: Any, region: Any) -> float:
    coordinates = _number(point)
    if not isinstance(region, RegionHere) or coordinates.ndim != 1:
        raise TypeError("`inside` takes a point and a region")
    return region.depth(coordinates)


def _distance(one: Any, other: Any) -> float:
    first, second = _number(one), _number(other)
    return norm(first - second)


def _divided(one: Array, other: Array) -> Array:
    return np.where(other == 0.0, np.nan, one / other)


def _ravelled(values: Sequence[Any]) -> Array:
    return np.concatenate([_number(each).ravel() for each in values])


_ARITHMETIC: Mapping[str, Callable[[Array, Array], Any]] = {
    "+": lambda one, other: one + other,
    "-": lambda one, other: one - other,
    "*": lambda one, other: one * other,
    "/": _divided,
    "%": lambda one, other: one % other,
    "**": lambda one, other: one**other,
}

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": lambda value: np.abs(_number(value)),
    "all": lambda value: bool(np.all(_number(value))),
    "any": lambda value: bool(np.any(_number(value))),
    "atan2": lambda one, other: np.arctan2(_number(one), _number(other)),
    "cos": lambda value: np.cos(_number(value)),
    "count": lambda value: float(np.count_nonzero(_number(value))),
    "distance": _distance,
    "inside": lambda point, region: _depth(point, region) > 0.0,
    "max": lambda *values: float(_ravelled(values).max(initial=-np.inf)),
    "min": lambda *values: float(_ravelled(values).min(initial=np.inf)),
    "norm": lambda value: norm(_number(value)),
    "signed_distance": lambda point, region: 0.0 if abs(depth := _depth(point, region)) == ZERO else depth,
    "sin": lambda value: np.sin(_number(value)),
    "sqrt": lambda value: np.sqrt(_number(value)),
    "wrap": lambda value: (_number(value) + np.pi) % (2 * np.pi) - np.pi,
}
