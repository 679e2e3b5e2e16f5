"""The syntax tree of expressions and formulas.

Every node knows its span: the characters of the text that it was made from.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Literal, TypeAlias

#: Start and end in characters.
Span: TypeAlias = tuple[int, int]

#: Operators about the future, and about the past.
FUTURE = ("always", "eventually", "next", "until")
PAST = ("historically", "once", "since")


@dataclass(frozen=True, slots=True)
class Node:
    """A part of an expression.

    Attributes:
        span: Where it stands in the text. Nodes that differ in this alone are equal.
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
    """An element of a value: ``state[0]`` or ``knowledge["goal"]``."""

    operand: Node
    key: int | str


@dataclass(frozen=True, slots=True)
class Vector(Node):
    """Several numbers in brackets."""

    items: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Call(Node):
    """A function of values."""

    function: str
    arguments: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Sign(Node):
    """A number with a sign before it."""

    operator: Literal["+", "-"]
    operand: Node


@dataclass(frozen=True, slots=True)
class Arithmetic(Node):
    """Two numbers, combined."""

    operator: Literal["+", "-", "*", "/", "%", "**"]
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Comparison(Node):
    """Values compared, each with the next: ``0 < risk < 0.2``."""

    operators: tuple[str, ...]
    operands: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Not(Node):
    """Negation."""

    operand: Node


@dataclass(frozen=True, slots=True)
class Junction(Node):
    """Several conditions joined by ``and``, ``or`` or ``implies``; of the last there are two."""

    operator: Literal["and", "or", "implies"]
    operands: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Temporal(Node):
    """An operator over time, with one operand or, for ``until`` and ``since``, two.

    Attributes:
        operator: One of `FUTURE` and `PAST`.
        window: From when until when it ranges, as distances from the instant in question [s], both included; infinite
            where it is not limited, None where none is given.
        operands: What it is said of.
    """

    operator: str
    window: tuple[float, float] | None
    operands: tuple[Node, ...]


def walk(node: Node) -> Iterator[Node]:
    """Yield a node and all below it, each before those it is made of."""
    yield node
    for each in fields(node):
        value = getattr(node, each.name)
        for child in value if isinstance(value, tuple) else (value,):
            if isinstance(child, Node):
                yield from walk(child)
