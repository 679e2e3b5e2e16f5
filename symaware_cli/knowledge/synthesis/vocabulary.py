"""The variables of a game between an agent and its environment, and formulas about them, evaluated for many states."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.specification import ExpressionError
from symaware_cli.specification.node import (
    NEXT,
    Comparison,
    Constant,
    Element,
    Junction,
    Name,
    Node,
    Not,
    Temporal,
    walk,
)

Truth = NDArray[np.bool_]
#: The values of each variable, in as many states as are considered at once.
Values = Mapping[str, NDArray[np.intp]]
#: Evaluates a formula for the present values and, if it says `next`, those of the step after.
Evaluate = Callable[[Values, Values | None], Any]

#: The name of the variable of the agent's own cell.
CELL = "cell"


@dataclass(frozen=True)
class Variable:
    """A variable with finitely many values.

    Attributes:
        name: Its name in formulas.
        system: Its values and how they may change, for the cell of an agent; None for a proposition, which is true or
            false and may change at each step.
    """

    name: str
    system: TransitionSystem | None = None

    @property
    def size(self) -> int:
        """How many values it has."""
        return 2 if self.system is None else len(self.system.states)

    @property
    def following(self) -> Sequence[Sequence[int]]:
        """The values that may follow each value."""
        return ((0, 1), (0, 1)) if self.system is None else self.system.successors

    def described(self, value: int) -> str:
        """Return a value in words, such as ``c0_1`` or ``false``."""
        return ("false", "true")[value] if self.system is None else self.system.states[value]


class Vocabulary:
    """What formulas may refer to: propositions, cells, and the labels of the agent's own cell.

    Attributes:
        cell: The variable of the agent's own cell.
        environment: The variables of the environment.
    """

    def __init__(self, system: TransitionSystem, environment: Sequence[Variable]) -> None:
        """Collect the names.

        Args:
            system: Where the agent may be, and how it may move.
            environment: The variables that the agent does not choose.

        Raises:
            ValueError: Two things have the same name.
        """
        self.cell = Variable(CELL, system)
        self.environment = tuple(environment)
        self._variables = {each.name: each for each in (self.cell, *self.environment)}
        for each in self.environment:
            if each.name == CELL or each.name in system.labels:
                what = "the agent's own cell" if each.name == CELL else "a label of cells"
                raise ValueError(f"`{each.name}` is {what}; call the proposition something else")

    @property
    def names(self) -> Collection[str]:
        """All names that a formula may refer to."""
        assert self.cell.system is not None
        return {*self._variables, *self.cell.system.labels}

    def compiled(self, node: Node) -> Evaluate:
        """Compile a formula whose only temporal operator is `next`.

        Raises:
            ExpressionError: Something in it has no meaning here.
        """
        for each in walk(node):
            if isinstance(each, Temporal) and any(
                isinstance(below, Temporal) for operand in each.operands for below in walk(operand)
            ):
                raise ExpressionError(
                    "`next` looks one step ahead, so it cannot stand within another `next`", each.span
                )
        return self._condition(node)

    def _condition(self, node: Node) -> Evaluate:
        match node:
            case Constant(value=bool() as value):
                return lambda now, after: np.bool_(value)
            case Not(operand=operand):
                inner = self._condition(operand)
                return lambda now, after: ~inner(now, after)
            case Junction(operator=operator, operands=operands):
                parts = [self._condition(each) for each in operands]
                return _joined(operator, parts)
            case Temporal(operator="next" | "weak next", operands=(operand,)):  # a game has no last step
                inner = self._condition(operand)
                return lambda now, after: inner(_given(after), None)
            case Comparison():
                return self._comparison(node)
            case Name(name=name):
                variable = self._variables.get(name)
                if variable is None:
                    return self._label(name, CELL, node)
                if variable.system is not None:
                    raise ExpressionError(
                        f"`{name}` is a cell and no condition; compare it, as in `{name} == {_example(variable)}`, or "
                        f"name a label of it",
                        node.span,
                    )
                return lambda now, after: now[name] == 1
            case Element(operand=Name(name=name), key=str() as label):
                variable = self._variables.get(name)
                if variable is None or variable.system is None:
                    raise ExpressionError(f"`{name}` is not a cell, so it has no labels", node.span)
                return self._label(label, name, node)
        raise ExpressionError(
            "a strategy is made from propositions and cells only; give the condition a name under `labels`, and write "
            "that name here",
            node.span,
        )

    def _label(self, label: str, variable: str, node: Node) -> Evaluate:
        system = self._variables[variable].system
        assert system is not None
        if label not in system.labels:
            raise ExpressionError(f"there is no label `{label}`", node.span, label, system.labels)
        where = np.zeros(len(system.states), bool)
        where[sorted(system.labels[label])] = True
        return lambda now, after: where[now[variable]]

    def _comparison(self, node: Comparison) -> Evaluate:
        if len(node.operands) != 2 or node.operators[0] not in ("==", "!="):
            raise ExpressionError("cells are compared by == and !=, two at a time", node.span)
        systems = [each for each in map(self._system, node.operands) if each is not None]
        if not systems:
            raise ExpressionError("one side of the comparison is a cell", node.span)
        if any(each.states != systems[0].states for each in systems):
            raise ExpressionError("the two are cells of different models", node.span)
        one, other = (self._cell(each, systems[0]) for each in node.operands)
        if node.operators[0] == "==":
            return lambda now, after: one(now, after) == other(now, after)
        return lambda now, after: one(now, after) != other(now, after)

    def _system(self, node: Node) -> TransitionSystem | None:
        if isinstance(node, Temporal) and node.operator in NEXT:
            node = node.operands[0]
        variable = self._variables.get(node.name) if isinstance(node, Name) else None
        return None if variable is None else variable.system

    def _cell(self, node: Node, system: TransitionSystem) -> Evaluate:
        match node:
            case Constant(value=str() as name):
                if name not in system.states:
                    raise ExpressionError(f"there is no cell `{name}`", node.span, name, system.states)
                state = system.states.index(name)
                return lambda now, after: state
            case Name(name=name) if self._system(node) is not None:
                return lambda now, after: now[name]
            case Temporal(operator="next" | "weak next", operands=(Name(name=name),)) if self._system(node) is not None:
                return lambda now, after: _given(after)[name]
        raise ExpressionError("a cell is compared with a cell, or with the name of one in quotes", node.span)


def says_next(node: Node) -> bool:
    """Whether a formula refers to the step after."""
    return any(isinstance(each, Temporal) and each.operator in NEXT for each in walk(node))


def names_in_formula(node: Node) -> set[str]:
    """Return the names that occur in a formula."""
    return {each.name for each in walk(node) if isinstance(each, Name)}


def _given(values: Values | None) -> Values:
    assert values is not None, "only safety says `next`, and is evaluated for two steps"
    return values


def _joined(operator: str, parts: Sequence[Evaluate]) -> Evaluate:
    def joined(now: Values, after: Values | None) -> Any:
        values = [part(now, after) for part in parts]
        if operator == "implies":
            return ~values[0] | values[1]
        total = values[0]
        for each in values[1:]:
            total = total & each if operator == "and" else total | each
        return total

    return joined


def _example(variable: Variable) -> str:
    assert variable.system is not None
    return f'"{variable.system.states[0]}"'
