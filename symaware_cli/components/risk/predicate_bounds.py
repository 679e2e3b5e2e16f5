"""Bounds of the probability that a predicate fails, for states with a known mean and covariance."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from symaware_cli.geometry.region import Region, RegionShape
from symaware_cli.specification.columns import Lookup, values
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
    walk,
)

Array = NDArray[np.float64]

#: What is assumed about the states: that they are normal, or nothing but their mean and covariance.
Tail = Literal["normal", "chebyshev"]

#: The number of sides of the polygon that stands for a disc.
_SIDES = 16


class Moments(NamedTuple):
    """The states at an instant.

    Attributes:
        mean: Shape (n, nx).
        covariance: Shape (n, nx, nx).
        look_up: Returns the values of a name for states, shape (n, nx).
    """

    mean: Array
    covariance: Array
    look_up: Callable[[Array], Lookup]


#: Bounds of the probabilities that a predicate fails and that it holds; each of shape (n,).
PredicateBound = Callable[[Moments, Tail], tuple[Array, Array]]


class NotLinearError(ValueError):
    """A predicate has no bound; the message says why."""


def predicate_bound(node: Node, varying: Collection[str], regions: Mapping[str, Region]) -> PredicateBound:
    """Compile a predicate into bounds of its probabilities.

    Args:
        node: A comparison of linear expressions, or ``inside(...)`` of a point and a region that does not move.
        varying: The names whose values are linear in the state; all others must not depend on it.
        regions: The regions by name.

    Raises:
        NotLinearError: It is neither.
    """
    match node:
        case Comparison(operators=operators, operands=operands):
            pairs = zip(operators, operands, operands[1:], strict=False)
            return _every([_compared(operator, left, right, varying) for operator, left, right in pairs])
        case Call(function="inside", arguments=(point, Name(name=name))) if name in regions:
            if not _is_linear(point, varying):
                raise NotLinearError("the point is not linear in the state")
            return _within(regions[name], point, regions)
    raise NotLinearError("it is neither a comparison nor `inside`")


def _compared(operator: str, left: Node, right: Node, varying: Collection[str]) -> PredicateBound:
    if operator in ("==", "!="):
        raise NotLinearError(f"`{operator}` has no bound")
    if not (_is_linear(left, varying) and _is_linear(right, varying)):
        raise NotLinearError("it is not linear in the state")
    greater, less = (left, right) if operator in (">", ">=") else (right, left)
    first, second = values(greater), values(less)

    def margin(look_up: Lookup) -> Any:
        return np.asarray(first(look_up), float) - np.asarray(second(look_up), float)

    return lambda moments, tail: _half_space(margin, moments, tail)


def _within(shape: RegionShape, point: Node, regions: Mapping[str, Region]) -> PredicateBound:
    """Return the bounds of a point being in a region."""
    if isinstance(shape, Region) and shape.around is not None:
        raise NotLinearError(f"the region moves with `{shape.around}`")
    if shape.members:
        parts = [_within(regions[each] if isinstance(each, str) else each, point, regions) for each in shape.members]
        if shape.complement is not None:
            return _not(parts[0])
        return _every(parts) if shape.intersection is not None else _not(_every([_not(each) for each in parts]))
    place = values(point)
    if shape.circle is not None:
        centre, radius = np.array(shape.circle.centre), shape.circle.radius
        inner = _every(
            [_face(place, -normal, radius * scale + normal @ centre) for normal, scale in _inscribed(len(centre))]
        )

        def of_disc(moments: Moments, tail: Tail) -> tuple[Array, Array]:
            # It holds with at most the probability of the half space that touches the disc towards the mean.
            away = _points(place, moments)[:, : len(centre)] - centre
            length = np.sqrt((away * away).sum(axis=1))
            normal = np.where(length[:, None] > 0.0, away / np.where(length > 0.0, length, 1.0)[:, None], 0.0)

            def margin(look_up: Lookup) -> Any:
                return radius - (normal * (place(look_up)[:, : len(centre)] - centre)).sum(axis=1)

            return inner(moments, tail)[0], _half_space(margin, moments, tail)[1]

        return of_disc
    if shape.box is not None:
        bounds = np.array(shape.box).reshape(-1, 2)
        axes = np.eye(len(bounds))
        low = [_face(place, axis, -bound[0]) for axis, bound in zip(axes, bounds, strict=True)]
        high = [_face(place, -axis, bound[1]) for axis, bound in zip(axes, bounds, strict=True)]
        return _every([*low, *high])
    assert shape.polygon is not None
    corners = np.array(shape.polygon)
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return _every(
        [_face(place, normal, -float(normal @ corner)) for normal, corner in zip(inward, corners, strict=True)]
    )


def _inscribed(dimensions: int) -> list[tuple[Array, float]]:
    """Return outward normals of a polytope within a disc or ball of radius 1, and the distances of its faces."""
    if dimensions == 1:
        return [(np.array([sign]), 1.0) for sign in (1.0, -1.0)]
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    near = float(np.cos(np.pi / _SIDES))
    if dimensions == 2:
        return [(normal, near) for normal in circle]
    # The corners of a cube are at a distance of at most 1 if its faces are at one over the root of 3.
    return [(sign * axis, 1.0 / np.sqrt(3.0)) for axis in np.eye(3) for sign in (1.0, -1.0)]


def _face(place: Callable[[Lookup], Any], normal: Array, offset: float) -> PredicateBound:
    """Return the bounds of a point lying on the side of a plane that its normal points to."""

    def margin(look_up: Lookup) -> Any:
        return (place(look_up)[:, : len(normal)] * normal).sum(axis=1) + offset

    return lambda moments, tail: _half_space(margin, moments, tail)


def _points(place: Callable[[Lookup], Any], moments: Moments) -> Array:
    found: Array = place(moments.look_up(moments.mean))
    return found


def _half_space(margin: Callable[[Lookup], Any], moments: Moments, tail: Tail) -> tuple[Array, Array]:
    """Return the probabilities that a linear margin is negative and that it is positive, or bounds of them.

    Without an assumption about the distribution, by Cantelli's inequality (F. P. Cantelli, "Sui confini della
    probabilita", 1929): a deviation of at least d has a probability of at most v / (v + d^2).
    """
    count, size = moments.mean.shape

    def at(states: Array) -> Array:
        return np.broadcast_to(np.asarray(margin(moments.look_up(states)), float), (count,))

    mean = at(moments.mean)
    origin = at(np.zeros((count, size)))
    slope = np.stack([at(np.broadcast_to(unit, (count, size))) - origin for unit in np.eye(size)], axis=1)
    variance = np.zeros(count)
    for row in range(size):
        for column in range(size):
            variance = variance + slope[:, row] * moments.covariance[:, row, column] * slope[:, column]
    variance = np.maximum(variance, 0.0)
    spread = np.sqrt(variance)
    known = spread <= 1e-12 * (1.0 + np.abs(mean))
    scaled = mean / np.where(known, 1.0, spread)
    if tail == "normal":
        fails, holds = ndtr(-scaled), ndtr(scaled)
    else:
        square = scaled * scaled
        fails = np.where(scaled > 0.0, 1.0 / (1.0 + square), 1.0)
        holds = np.where(scaled < 0.0, 1.0 / (1.0 + square), 1.0)
    # At a margin of 0 both may be: whether the predicate is strict does not count here.
    return np.where(known, (mean <= 0.0).astype(float), fails), np.where(known, (mean >= 0.0).astype(float), holds)


def _every(parts: list[PredicateBound]) -> PredicateBound:
    def bound(moments: Moments, tail: Tail) -> tuple[Array, Array]:
        found = [each(moments, tail) for each in parts]
        fails = found[0][0]
        for each, _ in found[1:]:
            fails = fails + each
        return np.minimum(fails, 1.0), np.minimum.reduce([holds for _, holds in found])

    return bound


def _not(part: PredicateBound) -> PredicateBound:
    def bound(moments: Moments, tail: Tail) -> tuple[Array, Array]:
        fails, holds = part(moments, tail)
        return holds, fails

    return bound


def _is_linear(node: Node, varying: Collection[str]) -> bool:
    """Return whether an expression is linear in the state, with a constant part."""
    if not _depends(node, varying):
        return not any(isinstance(each, Name) and each.name in _UNKNOWN for each in walk(node))
    match node:
        case Name():
            return True
        case Sign(operand=operand) | Element(operand=operand):
            return _is_linear(operand, varying)
        case Vector(items=items):
            return all(_is_linear(each, varying) for each in items)
        case Arithmetic(operator="+" | "-"):
            return _is_linear(node.left, varying) and _is_linear(node.right, varying)
        case Arithmetic(operator="*"):
            one, other = node.left, node.right
            if _depends(one, varying):
                one, other = other, one
            return not _depends(one, varying) and _is_linear(one, varying) and _is_linear(other, varying)
        case Arithmetic(operator="/"):
            return not _depends(node.right, varying) and all(
                _is_linear(each, varying) for each in (node.left, node.right)
            )
    return isinstance(node, Constant)


#: Names whose values depend on the state, and not linearly, or on others.
_UNKNOWN = frozenset({"control_input", "nearest", "speed", "velocity", "risk", "uncertainty", "has_intent"})


def _depends(node: Node, varying: Collection[str]) -> bool:
    return any(isinstance(each, Name) and each.name in varying for each in walk(node))
