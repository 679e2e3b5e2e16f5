"""Compiles predicates of specifications into conditions on the state whose probabilities have bounds."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from symaware_cli.geometry import Region, RegionShape, region_faces
from symaware_cli.planning.risk.state_conditions import (
    Conjunction,
    HalfSpace,
    InsideDisc,
    Negation,
    Polytope,
    StateCondition,
)
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


class NotLinearError(ValueError):
    """A predicate has no bound; the message says why."""


def predicate_bound(node: Node, varying: Collection[str], regions: Mapping[str, Region]) -> StateCondition:
    """Compile a predicate into a condition on the state.

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


def _compared(operator: str, left: Node, right: Node, varying: Collection[str]) -> StateCondition:
    if operator in ("==", "!="):
        raise NotLinearError(f"`{operator}` has no bound")
    if not (_is_linear(left, varying) and _is_linear(right, varying)):
        raise NotLinearError("it is not linear in the state")
    greater, less = (left, right) if operator in (">", ">=") else (right, left)
    first, second = values(greater), values(less)

    def margin(look_up: Lookup) -> Any:
        return np.asarray(first(look_up), float) - np.asarray(second(look_up), float)

    return HalfSpace(margin)


def _within(shape: RegionShape, point: Node, regions: Mapping[str, Region]) -> StateCondition:
    """Return the condition that a point is in a region."""
    if isinstance(shape, Region) and shape.around is not None:
        raise NotLinearError(f"the region moves with `{shape.around}`")
    if shape.members:
        parts = [_within(regions[each] if isinstance(each, str) else each, point, regions) for each in shape.members]
        if shape.complement is not None:
            return Negation(parts[0])
        return _every(parts) if shape.intersection is not None else Negation(_every([Negation(each) for each in parts]))
    place = values(point)
    if shape.circle is not None:
        return InsideDisc(place, np.array(shape.circle.centre), shape.circle.radius)
    return Polytope(place, region_faces(shape))


def _every(parts: list[StateCondition]) -> StateCondition:
    return parts[0] if len(parts) == 1 else Conjunction(parts)


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
_UNKNOWN = frozenset({"control_input", "link", "nearest", "speed", "velocity", "risk", "uncertainty", "has_intent"})


def _depends(node: Node, varying: Collection[str]) -> bool:
    return any(isinstance(each, Name) and each.name in varying for each in walk(node))
