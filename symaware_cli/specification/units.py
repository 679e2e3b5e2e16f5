"""Checks that quantities which are compared or added have one unit, as far as units are known.

Units are written as products of powers of SI units: ``m``, ``m/s``, ``m/s^2``, ``rad``, ``1``. A number in a formula
goes with every unit, as does whatever has no known unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import TypeAlias

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
from symaware_cli.specification.token import ExpressionError

#: The power of each base unit.
Unit: TypeAlias = Mapping[str, Fraction]

_FACTOR = re.compile(r"([A-Za-zµ°%]+)(?:\^?(-?\d+))?")
_SAME = ("abs", "max", "min", "norm", "wrap")
#: Functions whose value is a pure number.
_PURE = ("cos", "count", "sin")


def unit_of(text: str) -> Unit | None:
    """Parse a unit; None where it is not known. Angles count as pure numbers."""
    if not text:
        return None
    powers: dict[str, Fraction] = {}
    for number, part in enumerate(text.split("/")):
        for factor in re.split(r"[*·.\s]+", part.strip("() ")):
            if factor in ("1", "rad", ""):
                continue
            match = _FACTOR.fullmatch(factor)
            if match is None:
                return None
            power = Fraction(int(match.group(2) or 1)) * (-1 if number else 1)
            powers[match.group(1)] = powers.get(match.group(1), Fraction(0)) + power
    return {name: power for name, power in sorted(powers.items()) if power}


def written(unit: Unit) -> str:
    """Write a unit, such as ``m/s^2``."""

    def product(powers: Mapping[str, Fraction]) -> str:
        return "·".join(name if power == 1 else f"{name}^{power}" for name, power in powers.items())

    above = product({name: power for name, power in unit.items() if power > 0})
    below = product({name: -power for name, power in unit.items() if power < 0})
    return (above or "1") + (f"/{below}" if below else "")


def check_units(tree: Node, units: Mapping[str, str]) -> None:
    """Look whether what is compared and added in a formula has one unit.

    Args:
        tree: The formula.
        units: The unit of each name; "" where it is not known.

    Raises:
        ExpressionError: Two units do not agree.
    """
    for node in walk(tree):
        if isinstance(node, Comparison | Arithmetic | Call):
            _unit(node, units)


def _unit(node: Node, units: Mapping[str, str]) -> Unit | None:
    """The unit of a value; None where it is not known, or any."""
    match node:
        case Name(name=name):
            return unit_of(units.get(name, ""))
        case Sign(operand=operand) | Element(operand=operand):
            return _unit(operand, units)
        case Vector(items=items):
            return _common([_unit(each, units) for each in items], node, "a vector holds")
        case Comparison(operands=operands):
            _common([_unit(each, units) for each in operands], node, "this compares")
            return None
        case Arithmetic(operator="*" | "/" as sign, left=left, right=right):
            return _product(_unit(left, units), _unit(right, units), 1 if sign == "*" else -1, left, right)
        case Arithmetic(operator="**", left=left, right=Constant(value=int() | float() as power)):
            base = _unit(left, units)
            exact = Fraction(power).limit_denominator(12)
            return None if base is None else {name: each * exact for name, each in base.items() if each * exact}
        case Arithmetic(operator="+" | "-" | "%", left=left, right=right):
            return _common([_unit(left, units), _unit(right, units)], node, "this combines")
        case Call(function=function, arguments=arguments):
            given = [_unit(each, units) for each in arguments]
            if function in _SAME or function == "distance":
                return _common(given, node, f"{function}(...) takes")
            if function == "signed_distance":
                return unit_of("m")
            if function == "sqrt" and given[0] is not None:
                return {name: each / 2 for name, each in given[0].items()}
            return {} if function in _PURE else None
    return None


def _product(left: Unit | None, right: Unit | None, sign: int, one: Node, other: Node) -> Unit | None:
    """The unit of a product or a quotient; numbers in the formula change no unit."""
    left = {} if left is None and isinstance(one, Constant) else left
    right = {} if right is None and isinstance(other, Constant) else right
    if left is None or right is None:
        return None
    powers = dict(left)
    for name, power in right.items():
        powers[name] = powers.get(name, Fraction(0)) + sign * power
    return {name: power for name, power in sorted(powers.items()) if power}


def _common(given: list[Unit | None], node: Node, what: str) -> Unit | None:
    """The one unit of several values, as far as these have one."""
    known = [unit for unit in given if unit is not None]
    for unit in known[1:]:
        if unit != known[0]:
            raise ExpressionError(f"{what} {written(known[0])} with {written(unit)}", node.span)
    return known[0] if known else None
