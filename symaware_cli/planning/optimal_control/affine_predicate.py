"""Predicates of formulas as unions and intersections of half spaces of the state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.core import Model
from symaware_cli.geometry import Array, Faces, Region, RegionShape, ball_faces, region_faces
from symaware_cli.specification import ExpressionError, Formulation, printed
from symaware_cli.specification.node import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Element,
    Name,
    Node,
    Sign,
    Vector,
)


@dataclass(frozen=True, slots=True)
class Face:
    """States x with a margin of at least zero; the margin is ``normal @ x + offset``.

    Attributes:
        normal: The normal; shape (nx,).
        offset: The offset.
        around: The other agent with whose position it moves; empty if it stays.
        variance: The variance of the offset, as far as that position is uncertain.
    """

    normal: tuple[float, ...]
    offset: float
    around: str = ""
    variance: float = 0.0


@dataclass(frozen=True, slots=True)
class Intersection:
    """What lies in all of several sets.

    Attributes:
        parts: The sets.
        deepest: An upper bound of the least margin of a state in them; infinite if it is not known.
    """

    parts: tuple[StateSet, ...]
    deepest: float = np.inf


@dataclass(frozen=True, slots=True)
class Union:
    """What lies in any of several sets."""

    parts: tuple[StateSet, ...]


#: A set of states; a Boolean value is all of them, or none.
StateSet: TypeAlias = Face | Intersection | Union | bool


class Affine:
    """A value that is affine in the state: ``matrix @ x + offset``.

    Attributes:
        matrix: Shape (k, nx); k is 1 for a number.
        offset: Shape (k,).
        is_vector: Whether it is a vector, and not a number.
    """

    __slots__ = ("is_vector", "matrix", "offset")

    def __init__(self, matrix: ArrayLike, offset: ArrayLike = 0.0) -> None:
        """Create a number from one row (nx,), or a vector from several (k, nx)."""
        rows = np.asarray(matrix, float)
        self.is_vector = rows.ndim == 2
        self.matrix: Array = np.atleast_2d(rows)
        self.offset: Array = np.array(np.broadcast_to(np.asarray(offset, float), (len(self.matrix),)))

    @classmethod
    def constant(cls, value: ArrayLike, size: int) -> Affine:
        """Return a number or a vector that does not depend on a state of some size."""
        values = np.asarray(value, float)
        return cls(np.zeros((*values.shape, size)), values)

    @property
    def is_constant(self) -> bool:
        """Whether it does not depend on the state."""
        return not self.matrix.any()

    def scaled(self, factor: float) -> Affine:
        """Return a multiple of it."""
        return self._made(self.matrix * factor, self.offset * factor, self.is_vector)

    def plus(self, other: Affine) -> Affine:
        """Return the sum; a number is added to each element of a vector."""
        is_vector = self.is_vector or other.is_vector
        return self._made(self.matrix + other.matrix, self.offset + other.offset, is_vector)

    def element(self, place: int) -> Affine:
        """Return an element of a vector."""
        return self._made(self.matrix[place][None], self.offset[place][None], False)

    @staticmethod
    def _made(matrix: Array, offset: Array, is_vector: bool) -> Affine:
        found = Affine(matrix, offset)
        found.is_vector = is_vector
        return found


def predicate_sets(
    formulation: Formulation, names: Mapping[str, Affine], regions: Mapping[str, Region]
) -> list[tuple[StateSet, StateSet]]:
    """Return of each predicate of a formula the states in which it holds, and those in which its negation does.

    Predicates are comparisons of affine values, ``all(...)`` or ``any(...)`` of one, comparisons of a distance or norm
    with a number, and ``inside(...)``. The margin of a state in the set is the robustness of the predicate, or a lower
    bound of it where that is positive: outside the corners of a region, and for discs, which are replaced by polygons
    of 16 sides within them and of 8 sides around them.

    Args:
        formulation: The formula.
        names: The values of names, affine in the state: those of a model are `state_names`.
        regions: The regions by name.

    Raises:
        ExpressionError: A predicate is not linear; the error has the position.
    """
    compiler = _Compiler(names, regions)
    return [(compiler.predicate(atom.node, True), compiler.predicate(atom.node, False)) for atom in formulation.atoms]


def pair_sets(
    formulation: Formulation, model: Model, other: str, position: Array, covariance: Array
) -> list[tuple[StateSet, StateSet]]:
    """Return of each predicate about a pair the own states in which it holds, and those in which its negation does.

    Predicates are comparisons of ``distance`` with numbers; see `predicate_sets`.

    Args:
        formulation: The formula.
        model: The model of the own state.
        other: The id of the other agent.
        position: Its position [m]; shape (d,).
        covariance: The covariance of that; shape (d, d).

    Raises:
        ExpressionError: A predicate is about anything else.
    """
    places = list(model.position)
    apart = Affine(np.eye(len(model.state))[places], -position)
    compiler = _Compiler({"distance": apart}, {})

    def around(states: StateSet) -> StateSet:
        match states:
            case Face(normal=normal):
                along = np.array(normal)[places]
                return replace(states, around=other, variance=float(along @ covariance @ along))
            case Union(parts=parts):
                return Union(tuple(around(each) for each in parts))
            case Intersection(parts=parts):
                return replace(states, parts=tuple(around(each) for each in parts))
        return states

    return [
        (around(compiler.predicate(atom.node, True)), around(compiler.predicate(atom.node, False)))
        for atom in formulation.atoms
    ]


def state_names(model: Model, knowledge: Mapping[str, Any] | None = None) -> dict[str, Affine]:
    """Return the values of names of an agent, as far as they are affine in its state or known numbers.

    Args:
        model: The model.
        knowledge: The knowledge of the agent, by name.
    """
    size = len(model.state)
    units = np.eye(size)
    names = {"state": Affine(units), "position": Affine(units[list(model.position)])}
    if model.velocities:
        names["velocity"] = Affine(units[list(model.velocities)])
    for name, value in (knowledge or {}).items():
        try:
            known = Affine.constant(value, size) if np.ndim(value) <= 1 else None
        except (TypeError, ValueError):
            continue
        if known is not None:
            names[f"knowledge.{name}"] = known
            if name not in names:
                names[name] = known
    for quantity, row in zip(model.state, units, strict=True):
        if quantity.name not in ("state", "position", "velocity"):
            names[quantity.name] = Affine(row)
    return names


class _Compiler:
    def __init__(self, names: Mapping[str, Affine], regions: Mapping[str, Region]) -> None:
        self._names = names
        self._regions = regions
        self._size = next((each.matrix.shape[1] for each in names.values()), 0)

    def predicate(self, node: Node, positive: bool) -> StateSet:
        match node:
            case Constant(value=bool() as value):
                return value == positive
            case Comparison(operators=operators, operands=operands):
                pairs = zip(operators, pairwise(operands), strict=True)
                parts = [self._compared(node, sign, *pair, positive) for sign, pair in pairs]
                return joined(parts, every=positive)
            case Call(function="all" | "any", arguments=(Comparison(operators=(sign,), operands=operands),)):
                difference = self._difference(node, sign, *operands)
                rows = [
                    self._half_space(difference.element(k), positive=positive) for k in range(len(difference.matrix))
                ]
                return joined(rows, every=(node.function == "all") == positive)
            case Call(function="inside", arguments=(point, Name(name=name))) if name in self._regions:
                return self._inside(self._regions[name], self._affine(point), point, positive=positive)
        raise ExpressionError(f"`{printed(node)}` is neither a linear comparison nor `inside`", node.span)

    # Comparisons

    def _compared(self, node: Node, sign: str, left: Node, right: Node, positive: bool) -> StateSet:
        if sign in ("==", "!="):
            raise ExpressionError(f"a plan cannot be made for `{sign}`: compare with <, <=, > or >=", node.span)
        for long, short, less in ((left, right, sign in ("<", "<=")), (right, left, sign in (">", ">="))):
            if isinstance(long, Name) and long.name == "distance" and long.name in self._names:
                vector = self._names[long.name]
            elif isinstance(long, Call) and long.function in ("distance", "norm"):
                vector = self._affine(long.arguments[0])
                if long.function == "distance":
                    vector = vector.plus(self._affine(long.arguments[1]).scaled(-1.0))
            else:
                vector = None
            if vector is not None:
                radius = self._affine(short)
                if not radius.is_constant or radius.is_vector or len(vector.matrix) > 3:
                    raise ExpressionError("a distance can be compared with a number only", node.span)
                return _ball(vector, float(radius.offset[0]), positive=less == positive)
        difference = self._difference(node, sign, left, right)
        if difference.is_vector:
            said = f"this compares {len(difference.matrix)} values; use all(...) or any(...)"
            raise ExpressionError(said, node.span)
        return self._half_space(difference, positive=positive)

    def _difference(self, node: Node, sign: str, left: Node, right: Node) -> Affine:
        """Return an affine expression that is positive where a comparison holds."""
        if sign in ("==", "!="):
            raise ExpressionError(f"a plan cannot be made for `{sign}`: compare with <, <=, > or >=", node.span)
        greater, less = (left, right) if sign in (">", ">=") else (right, left)
        return self._sum(node, self._affine(greater), self._affine(less).scaled(-1.0))

    @staticmethod
    def _half_space(value: Affine, *, positive: bool) -> StateSet:
        side = 1.0 if positive else -1.0
        return Face(tuple((side * value.matrix[0]).tolist()), side * float(value.offset[0]))

    # Regions

    def _inside(self, shape: RegionShape, point: Affine, node: Node, *, positive: bool) -> StateSet:
        if isinstance(shape, Region) and shape.around is not None:
            raise ExpressionError(f"the region moves with `{shape.around}`, which is not planned for", node.span)
        if shape.complement is not None:
            return self._inside(self._named(shape.complement), point, node, positive=not positive)
        if shape.members:
            parts = [self._inside(self._named(each), point, node, positive=positive) for each in shape.members]
            return joined(parts, every=(shape.intersection is not None) == positive)
        if not point.is_vector or len(point.matrix) < shape.dimensions:
            raise ExpressionError(f"the region has {shape.dimensions} coordinates", node.span)
        place = Affine(point.matrix[: shape.dimensions], point.offset[: shape.dimensions])
        if shape.circle is not None:
            return _ball(
                place.plus(Affine.constant(-np.array(shape.circle.centre), self._size)),
                shape.circle.radius,
                positive=positive,
            )
        return _convex(place, region_faces(shape), _deepest(shape), positive=positive)

    def _named(self, member: str | RegionShape) -> RegionShape:
        return self._regions[member] if isinstance(member, str) else member

    # Values

    def _affine(self, node: Node) -> Affine:
        match node:
            case Constant(value=float() | int() as value) if not isinstance(value, bool):
                return Affine.constant(float(value), self._size)
            case Name(name=name) if name in self._names:
                return self._names[name]
            case Element(operand=Name(name="knowledge"), key=str(key)) if f"knowledge.{key}" in self._names:
                return self._names[f"knowledge.{key}"]
            case Sign(operator=sign, operand=operand):
                return self._affine(operand).scaled(1.0 if sign == "+" else -1.0)
            case Vector(items=items):
                parts = [self._affine(each) for each in items]
                if not any(each.is_vector for each in parts):
                    return Affine(
                        np.concatenate([each.matrix for each in parts]), np.concatenate([each.offset for each in parts])
                    )
            case Element(operand=operand, key=int(key)):
                vector = self._affine(operand)
                if vector.is_vector and -len(vector.matrix) <= key < len(vector.matrix):
                    return vector.element(key)
            case Arithmetic(operator="+" | "-" as sign):
                right = self._affine(node.right)
                return self._sum(node, self._affine(node.left), right if sign == "+" else right.scaled(-1.0))
            case Arithmetic(operator="*" | "/" as sign):
                left, right = self._affine(node.left), self._affine(node.right)
                if sign == "*" and left.is_constant and not left.is_vector:
                    return right.scaled(float(left.offset[0]))
                if right.is_constant and not right.is_vector and (sign == "*" or right.offset[0] != 0.0):
                    factor = float(right.offset[0])
                    return left.scaled(factor if sign == "*" else 1.0 / factor)
        raise ExpressionError(f"`{printed(node)}` is not linear in the state of the model", node.span)

    @staticmethod
    def _sum(node: Node, one: Affine, other: Affine) -> Affine:
        if one.is_vector and other.is_vector and len(one.matrix) != len(other.matrix):
            said = f"a vector of {len(one.matrix)} does not go with one of {len(other.matrix)}"
            raise ExpressionError(said, node.span)
        return one.plus(other)


def joined(parts: Sequence[StateSet], every: bool) -> StateSet:
    """Return the intersection of several sets, or their union."""
    return parts[0] if len(parts) == 1 else Intersection(tuple(parts)) if every else Union(tuple(parts))


def _convex(place: Affine, faces: Faces, deepest: float, *, positive: bool) -> StateSet:
    """Return the set of states whose place lies within all half spaces, or outside one of them."""
    side = 1.0 if positive else -1.0
    matrix, moved = side * faces.normals @ place.matrix, side * (faces.normals @ place.offset + faces.offsets)
    parts = tuple(Face(tuple(row.tolist()), float(offset)) for row, offset in zip(matrix, moved, strict=True))
    return Intersection(parts, deepest) if positive else Union(parts)


def _ball(place: Affine, radius: float, *, positive: bool) -> StateSet:
    """Return the set of states whose place has at most a distance from the origin, or at least."""
    faces = ball_faces(len(place.matrix), radius, around=not positive)
    return _convex(place, faces, float(faces.offsets[0]), positive=positive)


def _deepest(shape: RegionShape) -> float:
    """Return an upper bound of the distance of a point in a box or polygon from its faces [m]."""
    if shape.box is not None:
        bounds = np.array(shape.box).reshape(-1, 2)
        return float(0.5 * (bounds[:, 1] - bounds[:, 0]).min())
    corners = np.array(shape.polygon)
    along = np.roll(corners, -1, axis=0) - corners
    x, y = corners.T
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    # The inscribed disc of a convex polygon has at most this radius.
    return 2.0 * area / float(np.sqrt((along * along).sum(axis=1)).sum())


def margin(states: StateSet, state: Array) -> float:
    """Return the margin of a state in a set: the least of an intersection, the greatest of a union."""
    match states:
        case bool():
            return np.inf if states else -np.inf
        case Face(normal=normal, offset=offset):
            return float(np.array(normal) @ state) + offset
        case Intersection(parts=parts):
            return min(margin(each, state) for each in parts)
        case Union(parts=parts):
            return max(margin(each, state) for each in parts)
