"""Formulas unrolled over instants: trees of half spaces, "all of" and "any of", without temporal operators."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from symaware_cli.planning.optimal_control.affine_predicate import Face, Intersection, StateSet, Union
from symaware_cli.specification import formula as stl

#: The nodes that always hold, and never.
TRUE, FALSE = 0, 1


@dataclass(frozen=True, slots=True)
class Leaf:
    """A state lies in a half space at an instant."""

    half_space: Face
    instant: int


@dataclass(frozen=True, slots=True)
class KnownMargin:
    """A margin that does not depend on the plan."""

    margin: float


@dataclass(frozen=True, slots=True)
class Combination:
    """All of several nodes, or any of them."""

    every: bool
    parts: tuple[int, ...]


#: The states in which a predicate holds, and those in which its negation does; or a function of the instant.
PredicateSets: TypeAlias = tuple[StateSet, StateSet] | Callable[[int], tuple[StateSet, StateSet]]

TreeNode: TypeAlias = Leaf | KnownMargin | Combination


class FormulaTree:
    """A formula in positive normal form, unrolled over instants from its own instant 0 on.

    Nodes are numbered; equal ones have the same number. Windows end at the last instant. What lies beyond is left out
    or, if the future is open, counts as satisfied.

    Attributes:
        root: The node of the formula at its first instant.
    """

    def __init__(
        self,
        formula: stl.Formula,
        sets: Sequence[PredicateSets],
        first: int,
        last: int,
        leaf: Callable[[Face, int], Leaf | KnownMargin],
        known: Callable[[float], KnownMargin | bool],
        past: Callable[[int, int], float | None],
        open_future: bool = False,
    ) -> None:
        """Unroll a formula.

        Args:
            formula: The formula.
            sets: Of each predicate the states in which it holds, and those in which its negation does, or a function
                of the instant that returns them.
            first: The instant that the formula is about.
            last: The last instant that counts.
            leaf: Returns a half space at an instant, or its margin if that is known.
            known: Returns the node for a known margin: the margin itself, or whether it is sufficient.
            past: Returns the robustness of a predicate at an instant, if that is in the past.
            open_future: Whether requirements beyond the last instant count as satisfied.
        """
        self._sets = sets
        self._first, self._last = first, last
        self._leaf = leaf
        self._known = known
        self._past = past
        self._open = open_future
        self._nodes: list[TreeNode | bool] = [True, False]
        self._numbers: dict[TreeNode, int] = {}
        self._made: dict[tuple[int, int, bool], int] = {}
        self.root = self._formula(formula, first, positive=True)

    def __getitem__(self, number: int) -> TreeNode | bool:
        """Return a node; `TRUE` and `FALSE` are Boolean values."""
        return self._nodes[number]

    def simplified(
        self, number: int, least: float, greatest: float, bounds: Callable[[Leaf], tuple[float, float]]
    ) -> int:
        """Return a node without what cannot, and what must have a margin between two numbers.

        Args:
            number: The node.
            least: A leaf whose margin is less cannot be chosen.
            greatest: A leaf whose margin is never less need not be mentioned.
            bounds: Bounds of the margin of a leaf.
        """
        memory: dict[int, int] = {TRUE: TRUE, FALSE: FALSE}

        def simplify(of: int) -> int:
            if of not in memory:
                match self._nodes[of]:
                    case Leaf() as leaf:
                        low, high = bounds(leaf)
                        memory[of] = FALSE if high < least else TRUE if low >= greatest else of
                    case KnownMargin(margin=value):
                        memory[of] = TRUE if value >= greatest else of
                    case Combination(every=every, parts=parts):
                        memory[of] = self._junction(every, [simplify(each) for each in parts])
            return memory[of]

        return simplify(number)

    def value(self, number: int, margin: Callable[[Leaf], float], memory: dict[int, float] | None = None) -> float:
        """Return the margin of a node, for the margins of leaves; `memory` keeps those of the nodes below."""
        memory = {} if memory is None else memory
        if number not in memory:
            match self._nodes[number]:
                case Leaf() as leaf:
                    memory[number] = margin(leaf)
                case KnownMargin(margin=value):
                    memory[number] = value
                case Combination(every=every, parts=parts):
                    values = [self.value(each, margin, memory) for each in parts]
                    memory[number] = min(values) if every else max(values)
                case truth:
                    memory[number] = np.inf if truth else -np.inf
        return memory[number]

    @property
    def leaves(self) -> list[Leaf]:
        """The half spaces at instants that the tree refers to."""
        return [node for node in self._nodes if isinstance(node, Leaf)]

    def most_required(self, number: int, memory: dict[int, int] | None = None) -> int:
        """Return the greatest number of half spaces that have to hold together for a node, over all alternatives."""
        memory = {} if memory is None else memory
        if number not in memory:
            match self._nodes[number]:
                case Combination(every=every, parts=parts):
                    counts = [self.most_required(each, memory) for each in parts]
                    memory[number] = sum(counts) if every else max(counts)
                case node:
                    memory[number] = int(isinstance(node, Leaf))
        return memory[number]

    def cheapest(self, number: int, costs: Mapping[Leaf, float]) -> list[Leaf]:
        """Return half spaces that make a node hold together, for the alternatives with the least sum of costs.

        Args:
            number: The node; it holds at least if all its leaves do.
            costs: The cost of each leaf.
        """
        memory: dict[int, float] = {}

        def cost(of: int) -> float:
            if of not in memory:
                match self._nodes[of]:
                    case Leaf() as leaf:
                        memory[of] = costs[leaf]
                    case KnownMargin(margin=value):
                        memory[of] = 0.0 if value >= 0.0 else np.inf
                    case Combination(every=every, parts=parts):
                        parts_cost = [cost(each) for each in parts]
                        memory[of] = sum(parts_cost) if every else min(parts_cost)
                    case truth:
                        memory[of] = 0.0 if truth else np.inf
            return memory[of]

        found: dict[Leaf, None] = {}
        waiting = [number]
        while waiting:
            match self._nodes[waiting.pop()]:
                case Leaf() as leaf:
                    found[leaf] = None
                case Combination(every=True, parts=parts):
                    waiting += parts
                case Combination(every=False, parts=parts):
                    waiting.append(min(parts, key=cost))
        return list(found)

    # Construction

    def _formula(self, formula: stl.Formula, at: int, *, positive: bool) -> int:
        if at > self._last:
            return TRUE
        key = (id(formula), at, positive)
        if key not in self._made:
            self._made[key] = self._unrolled(formula, at, positive=positive)
        return self._made[key]

    def _unrolled(self, formula: stl.Formula, at: int, *, positive: bool) -> int:
        match formula:
            case stl.Constant(value=value):
                return TRUE if value == positive else FALSE
            case stl.Predicate(index=index):
                known = self._past(index, at)
                if known is None:
                    sets = self._sets[index]
                    return self._set((sets(at) if callable(sets) else sets)[0 if positive else 1], at)
                return self._of_margin(known if positive else -known)
            case stl.Not(operand=operand):
                return self._formula(operand, at, positive=not positive)
            case stl.And(operands=operands) | stl.Or(operands=operands):
                every = isinstance(formula, stl.And) == positive
                return self._junction(every, [self._formula(each, at, positive=positive) for each in operands])
            case stl.Next(operand=operand, weak=weak):
                if at == self._last and not self._open:
                    return TRUE if weak == positive else FALSE
                return self._formula(operand, at + 1, positive=positive)
            case (
                stl.Until(first=first, last=last, left=left, right=right)
                | stl.Since(first=first, last=last, left=left, right=right)
            ):
                ahead = isinstance(formula, stl.Until)

                def until(u: int) -> int:
                    before = range(at, u) if ahead else range(u + 1, at + 1)
                    lefts = [self._formula(left, v, positive=positive) for v in before]
                    return self._junction(positive, [self._formula(right, u, positive=positive), *lefts])

                return self._of_window(not positive, self._window(at, first, last, ahead), until, beyond=ahead)
            case (
                stl.Always(first=first, last=last, operand=operand)
                | stl.Eventually(first=first, last=last, operand=operand)
                | stl.Historically(first=first, last=last, operand=operand)
                | stl.Once(first=first, last=last, operand=operand)
            ):
                every = isinstance(formula, stl.Always | stl.Historically) == positive
                ahead = isinstance(formula, stl.Always | stl.Eventually)
                window = self._window(at, first, last, ahead)
                return self._of_window(
                    every, window, lambda u: self._formula(operand, u, positive=positive), beyond=ahead
                )

    def _window(self, at: int, first: int, last: int | None, ahead: bool) -> range:
        """Return the instants of a window that lies ahead of an instant, or before it."""
        if ahead:
            beyond = self._last + self._open
            return range(at + first, (beyond if last is None else min(at + last, beyond)) + 1)
        return range(self._first if last is None else max(self._first, at - last), at - first + 1)

    def _of_window(self, every: bool, window: range, part: Callable[[int], int], beyond: bool) -> int:
        """Return a junction over a window; one that lies beyond the last instant holds."""
        if not window:
            return TRUE if every or beyond else FALSE
        return self._junction(every, [part(instant) for instant in window])

    def _set(self, states: StateSet, at: int) -> int:
        match states:
            case bool():
                return TRUE if states else FALSE
            case Face():
                found = self._leaf(states, at)
                return self._of_margin(found.margin) if isinstance(found, KnownMargin) else self._number(found)
            case Union(parts=parts):
                return self._junction(False, [self._set(each, at) for each in parts])
            case Intersection(parts=parts, deepest=deepest):
                every = [self._set(each, at) for each in parts]
                if np.isfinite(deepest) and any(isinstance(self._nodes[each], Leaf) for each in every):
                    every.append(self._number(KnownMargin(deepest)))
                return self._junction(True, every)

    def _of_margin(self, margin: float) -> int:
        found = self._known(margin)
        return (TRUE if found else FALSE) if isinstance(found, bool) else self._number(found)

    def _junction(self, every: bool, parts: Iterable[int]) -> int:
        neutral, absorbing = (TRUE, FALSE) if every else (FALSE, TRUE)
        flat: dict[int, None] = {}
        for part in parts:
            if part == absorbing:
                return absorbing
            node = self._nodes[part]
            if isinstance(node, Combination) and node.every == every:
                flat.update(dict.fromkeys(node.parts))
            elif part != neutral:
                flat[part] = None
        if len(flat) < 2:
            return next(iter(flat), neutral)
        return self._number(Combination(every, tuple(flat)))

    def _number(self, node: TreeNode) -> int:
        if node not in self._numbers:
            self._numbers[node] = len(self._nodes)
            self._nodes.append(node)
        return self._numbers[node]
