"""Syntax tree of expressions and formulas.

Every node has a span: the characters of the text that it was parsed from.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, TypeAlias

#: Start and end in characters.
Span: TypeAlias = tuple[int, int]

#: Temporal operators about the future, those about the next instant, and those about the past.
FUTURE = ("always", "eventually", "next", "weak next", "until")
NEXT = ("next", "weak next")
PAST = ("historically", "once", "since")


@dataclass(frozen=True, slots=True)
class Node:
    """A part of an expression.

    Attributes:
        span: Its position in the text. It is ignored when nodes are compared.
    """

    span: Span = field(compare=False)


@dataclass(frozen=True, slots=True)
class Constant(Node):
    """A number, a text, true, false or none."""

    value: float | str | bool | None


@dataclass(frozen=True, slots=True)
class Name(Node):
    """A name that stands for a value."""

    name: str


@dataclass(frozen=True, slots=True)
class Element(Node):
    """An element of a value: ``state[0]`` or ``knowledge["goal"]``, which may be written ``knowledge.goal``."""

    operand: Node
    key: int | str


@dataclass(frozen=True, slots=True)
class Vector(Node):
    """A vector: several numbers in brackets."""

    items: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Call(Node):
    """A function call."""

    function: str
    arguments: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Sign(Node):
    """A number with a sign."""

    operator: Literal["+", "-"]
    operand: Node


@dataclass(frozen=True, slots=True)
class Arithmetic(Node):
    """A binary arithmetic operation."""

    operator: Literal["+", "-", "*", "/", "%", "**"]
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Comparison(Node):
    """A chain of comparisons: ``0 < risk < 0.2``."""

    operators: tuple[str, ...]
    operands: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Not(Node):
    """Negation."""

    operand: Node


@dataclass(frozen=True, slots=True)
class Junction(Node):
    """Conditions joined by ``and``, ``or`` or ``implies``; ``implies`` has two operands."""

    operator: Literal["and", "or", "implies"]
    operands: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Temporal(Node):
    """A temporal operator, with one operand, or two for ``until`` and ``since``.

    Attributes:
        operator: One of `FUTURE` and `PAST`.
        window: Start and end relative to the current instant [s], both included; infinite where unbounded, None where
            no window is given.
        operands: The operands.
    """

    operator: str
    window: tuple[float, float] | None
    operands: tuple[Node, ...]


def walk(node: Node) -> Iterator[Node]:
    """Yield a node and all its descendants, parents first."""
    yield node
    for each in fields(node):
        value = getattr(node, each.name)
        for child in value if isinstance(value, tuple) else (value,):
            if isinstance(child, Node):
                yield from walk(child)


def with_children(node: Node, change: Callable[[Node], Node]) -> Node:
    """Return a node with its direct children changed."""
    changes: dict[str, Any] = {}
    for each in fields(node):
        value = getattr(node, each.name)
        if isinstance(value, Node):
            changes[each.name] = change(value)
        elif isinstance(value, tuple) and each.name != "span":
            changes[each.name] = tuple(change(item) if isinstance(item, Node) else item for item in value)
    return replace(node, **changes)


def moved(node: Node, span: Span) -> Node:
    """A copy of a tree whose nodes all have one span: that of the name that is replaced by the tree in a text."""
    return replace(with_children(node, lambda child: moved(child, span)), span=span)
