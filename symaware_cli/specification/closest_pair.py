"""Specifications about too many pairs for a monitor each: the closest pair stands for all of them.

The least robustness over all pairs is the robustness of the closest one at each instant, provided that the formula
takes minima only (``always``, ``and``, ...) and its predicates increase with the distance. `check_least` verifies this.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import EntityGroup
from symaware_cli.geometry import ClosestPair, Region, closest_pair
from symaware_cli.specification.formula import Array
from symaware_cli.specification.node import (
    NEXT,
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Junction,
    Name,
    Node,
    Not,
    Sign,
    Temporal,
    walk,
)
from symaware_cli.specification.scope import PAIR_UNITS, Scope, World
from symaware_cli.specification.token import ExpressionError

#: Operators that take a minimum over instants, and those that do so below a negation.
_MINIMA = ("always", "historically", *NEXT)
_MAXIMA = ("eventually", "once", *NEXT)


class ClosestPairScope(Scope):
    """The closest of many pairs of agents; one row.

    Attributes:
        pairs: As in `__init__`.
    """

    units = PAIR_UNITS

    def __init__(
        self,
        pairs: Sequence[tuple[Sequence[str], Sequence[str]]],
        world: World,
        groups: Sequence[EntityGroup],
        regions: Mapping[str, Region],
    ) -> None:
        """Create the scope.

        Args:
            pairs: Ids of agents; every agent of the first sequence is paired with every other agent of the second.
            world: The world.
            groups: All groups.
            regions: The regions by name.
        """
        super().__init__(1, world, groups, regions)
        self.pairs = pairs
        self._indices: list[tuple[NDArray[np.intp], NDArray[np.intp]]] = []
        #: For each set that is paired with itself.
        self._within: list[ClosestPair] = []
        self._closest: tuple[str, ...] = ()

    def agents(self, row: int) -> tuple[str, ...]:
        """No ids: the pair changes from instant to instant."""
        return ()

    @property
    def momentary_agents(self) -> tuple[str, ...]:
        """The pair that was the closest when `look_up` was called last."""
        return self._closest

    def _look_up(self, name: str) -> Any:
        if name != "distance":
            raise KeyError(name)
        snapshot = self._world.snapshot()
        if not self._indices:
            index = snapshot.roster.indices
            self._indices = [
                (np.array([index[id] for id in first], np.intp), np.array([index[id] for id in second], np.intp))
                for first, second in self.pairs
            ]
            everybody = np.arange(len(index))
            self._within = [
                ClosestPair(self._world.proximity if np.array_equal(first, everybody) else None)
                for first, _ in self._indices
            ]
        found = (self._closest_of(number, snapshot.positions) for number in range(len(self._indices)))
        distance, *pair = min(found)
        self._closest = tuple(snapshot.roster.ids[each] for each in pair) if np.isfinite(distance) else ()
        return np.array([distance])

    def _closest_of(self, number: int, positions: Array) -> tuple[float, int, int]:
        first, second = self._indices[number]
        if not np.array_equal(first, second):
            return closest_pair(positions, first, second)
        closest = self._within[number]
        # The very array by which the world shares its results.
        distance, one, other = closest(positions if closest.is_shared else positions[first])
        return distance, int(first[one]), int(first[other])


def check_least(tree: Node) -> None:
    """Verify that the least robustness of a formula over all pairs is that of the closest pair.

    Raises:
        ExpressionError: It is not: the span is that of the operator or predicate in question.
    """
    _check(tree, positive=True)


def _check(node: Node, *, positive: bool) -> None:
    if not _is_about_pairs(node):
        return
    match node:
        case Not(operand=operand):
            _check(operand, positive=not positive)
        case Temporal(operator=operator) if operator in (_MINIMA if positive else _MAXIMA):
            _check(node.operands[0], positive=positive)
        case Junction(operator="implies") if not positive:
            raise _refusal(node)
        case Junction(operator=operator):
            # A maximum of one robustness of pairs and of what is the same for all pairs is taken pair by pair.
            if positive == (operator != "and") and sum(map(_is_about_pairs, node.operands)) > 1:
                raise _refusal(node)
            for place, operand in enumerate(node.operands):
                _check(operand, positive=positive != (operator == "implies" and place == 0))
        case Comparison():
            sides = list(zip(node.operators, map(_slope, node.operands), map(_slope, node.operands[1:]), strict=False))
            for operator, left, right in sides:
                greater, less = (left, right) if operator in (">", ">=") else (right, left)
                wanted = 1 if positive else -1
                if operator in ("==", "!=") or greater not in (0, wanted) or less not in (0, -wanted):
                    raise _refusal(node)
            if not positive and len(sides) > 1:
                raise _refusal(node)
        case _:
            raise _refusal(node)


def _is_about_pairs(node: Node) -> bool:
    return any(isinstance(each, Name) and each.name in PAIR_UNITS and each.name != "time" for each in walk(node))


def _slope(node: Node) -> int | None:
    """1 for a value that increases with the distance, -1 for one that decreases, 0 for neither; None if unknown."""
    if not _is_about_pairs(node):
        return 0
    match node:
        case Name(name="distance"):
            return 1
        case Sign(operator=operator, operand=operand):
            return _scaled(_slope(operand), 1.0 if operator == "+" else -1.0)
        case Arithmetic(operator="+" | "-" as operator):
            slopes = {_slope(node.left), _scaled(_slope(node.right), 1.0 if operator == "+" else -1.0)} - {0}
            return slopes.pop() if len(slopes) == 1 else None
        case Arithmetic(operator="*", left=Constant(value=float() as factor), right=operand):
            return _scaled(_slope(operand), factor)
        case Arithmetic(operator="*" | "/", left=operand, right=Constant(value=float() as factor)):
            return _scaled(_slope(operand), factor)
        case Call(function="min" | "max" | "sqrt"):
            slopes = {_slope(each) for each in node.arguments} - {0}
            return slopes.pop() if len(slopes) == 1 else None
    return None


def _scaled(slope: int | None, factor: float) -> int | None:
    return None if slope is None or factor == 0.0 else slope if factor > 0.0 else -slope


def _refusal(node: Node) -> ExpressionError:
    return ExpressionError(
        "of so many pairs only the closest is monitored, which takes a formula of `always`, `historically`, `next` and"
        " `and` over comparisons such as `distance > 0.6`",
        node.span,
    )
