"""Formats syntax trees as text, with the fewest brackets."""

from __future__ import annotations

import math

from symaware_cli.specification.node import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Element,
    Junction,
    Name,
    Node,
    Not,
    Sign,
    Temporal,
    Vector,
)
from symaware_cli.specification.parser import LEVEL, PRECEDENCE

_HIGHEST = len(PRECEDENCE)


def printed(node: Node) -> str:
    """Format a tree as text that parses to the same tree."""
    return _printed(node)[0]


def _printed(node: Node) -> tuple[str, int]:
    """Return the text of a tree and its level in `PRECEDENCE`."""
    match node:
        case Constant(value=value):
            return _constant(value), _HIGHEST
        case Name(name=name):
            return name, _HIGHEST
        case Element(operand=operand, key=key):
            return f"{_inner(operand, _HIGHEST)}[{_constant(key)}]", _HIGHEST
        case Vector(items=items):
            return f"[{', '.join(map(printed, items))}]", _HIGHEST
        case Call(function=function, arguments=arguments):
            return f"{function}({', '.join(map(printed, arguments))})", _HIGHEST
        case Sign(operator=sign, operand=operand):
            level = LEVEL["sign"]
            return sign + _inner(operand, level), level
        case Arithmetic(operator=sign, left=left, right=right):
            level = LEVEL[sign]
            if sign == "**":  # right-associative
                return f"{_inner(left, level + 1)} ** {_inner(right, level - 1)}", level
            return f"{_inner(left, level)} {sign} {_inner(right, level + 1)}", level
        case Comparison(operators=operators, operands=operands):
            level = LEVEL["<"]
            first, *others = (_inner(each, level + 1) for each in operands)
            return " ".join([first, *(f"{sign} {each}" for sign, each in zip(operators, others, strict=True))]), level
        case Not(operand=operand):
            level = LEVEL["not"]
            return f"not {_inner(operand, level)}", level
        case Junction(operator=word, operands=operands):
            level = LEVEL[word]
            if word == "implies":  # right-associative
                return f"{_inner(operands[0], level + 1)} implies {_inner(operands[1], level)}", level
            return f" {word} ".join(_inner(each, level + 1) for each in operands), level
        case Temporal(operator=word, window=window, operands=operands):
            level, said = LEVEL[word], word + ("" if window is None else f"[{_time(window[0])}, {_time(window[1])}]")
            if len(operands) == 1:
                text = _inner(operands[0], level)
                # A bracket directly after the operator would be parsed as a window.
                return f"{said} ({text})" if text.startswith("[") and window is None else f"{said} {text}", level
            before, after = _inner(operands[0], level + 1), _inner(operands[1], level)
            after = f"({after})" if after.startswith("[") and window is None else after
            return f"{before} {said} {after}", level
    raise TypeError(f"{type(node).__name__} has no text")


def _inner(node: Node, level: int) -> str:
    """Return the text of an operand, in brackets if it binds less tightly than a level."""
    text, own = _printed(node)
    return f"({text})" if own < level else text


def _constant(value: float | str | bool | None) -> str:
    if isinstance(value, str):
        return f"'{value}'" if '"' in value else f'"{value}"'
    if isinstance(value, bool):
        return str(value).lower()
    return "None" if value is None else _time(value)


def _time(value: float) -> str:
    return "inf" if math.isinf(value) else str(int(value)) if value == int(value) else repr(value)
