"""Expressions with a value at one instant, such as ``risk > 0.2 and distance(position, goal) > 1``.

Conditions of components, triggers, ``run.until`` and ``present`` use them. An expression has access only to the names
it is given and to the functions of `columns`, never to Python.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from symaware_cli.core import TimeSeries
from symaware_cli.specification.absence import AbsentError
from symaware_cli.specification.columns import (
    FUNCTIONS,
    NO_VALUE,
    Evaluate,
    Functions,
    Lookup,
    check_momentary,
    truth,
    values,
)
from symaware_cli.specification.node import Name, walk
from symaware_cli.specification.parser import Names, parse
from symaware_cli.specification.token import ExpressionError

__all__ = ["EvaluationError", "Expression", "ExpressionError", "Lookup", "one_row"]

#: Maximum length of a condition, in characters.
_LONGEST = 500


class EvaluationError(Exception):
    """An expression has no value at present; the message gives the reason."""


class Expression:
    """A parsed expression about one agent, or the world.

    Attributes:
        text: The text.
        tree: Its syntax tree.
        names: The names it refers to, sorted.
    """

    __slots__ = ("_evaluate", "_holds", "names", "text", "tree")

    def __init__(self, text: str, names: Collection[str] | Names, functions: Functions = FUNCTIONS) -> None:
        """Parse an expression.

        Args:
            text: The text.
            names: The names it may refer to; see `parser.parse`.
            functions: The functions it may call.

        Raises:
            ExpressionError: The text is not a valid expression.
        """
        arguments = {name: function.arguments for name, function in functions.items()}
        tree = parse(text, names, arguments, longest=_LONGEST)
        check_momentary(tree, "a specification: a condition is about one instant")
        self.text = text
        self.tree = tree
        self._evaluate = values(tree, functions)
        self._holds = truth(tree, functions)
        self.names = tuple(sorted({node.name for node in walk(tree) if isinstance(node, Name)}))

    def value(self, lookup: Lookup) -> Any:
        """Evaluate the expression.

        Args:
            lookup: Returns the value of a name.

        Raises:
            EvaluationError: The expression has no value, for example because of a division by zero.
            AbsentError: It has none at present, because an agent that it names is not in the world.
        """
        found = self._evaluated(self._evaluate, lookup)
        return found[0] if isinstance(found, np.ndarray) else found

    def holds(self, lookup: Lookup) -> bool:
        """Evaluate a condition.

        Raises:
            EvaluationError: The expression has no value, or one that is neither true nor false.
        """
        return bool(self._evaluated(self._holds, lookup))

    def _evaluated(self, evaluate: Evaluate, lookup: Lookup) -> Any:
        try:
            with np.errstate(divide="raise", over="raise", invalid="ignore"):
                return evaluate(lambda name: one_row(lookup(name)))
        except AbsentError:
            raise
        except NO_VALUE as error:
            said = " ".join(str(error).split()).strip("\"'") or type(error).__name__
            raise EvaluationError(f"`{self.text}` has no value: {said}") from error


def one_row(value: Any) -> Any:
    """Return a value of one agent, or of the world, as that of one row; see `columns`."""
    if isinstance(value, float | bool | str | np.generic):
        return value
    if isinstance(value, np.ndarray):
        return value[None]
    if isinstance(value, TimeSeries):
        return value.values[None]
    if isinstance(value, list | tuple):
        try:
            numbers = np.array(value)
        except ValueError:  # of different lengths
            return _Keyed(value)
        return numbers[None] if numbers.dtype.kind in "fbiu" else _Keyed(value)
    return _Keyed(value) if hasattr(value, "__getitem__") else value


class _Keyed:
    """A value with elements that are looked up one at a time."""

    def __init__(self, elements: Any) -> None:
        self._elements = elements

    def __getitem__(self, key: int | str) -> Any:
        return one_row(self._elements[key])
