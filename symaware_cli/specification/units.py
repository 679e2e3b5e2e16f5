"""Unit check of formulas: quantities that are compared or added must have the same unit, where units are known.

Units are written as products of powers of SI units: ``m``, ``m/s``, ``m/s^2``, ``rad``, ``1``. Numbers in a formula,
and values without a known unit, are compatible with every unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import TypeAlias

from symaware_cli.specification.columns import FUNCTIONS
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

#: The exponent of each base unit.
Unit: TypeAlias = Mapping[str, Fraction]

_FACTOR = re.compile(r"([A-Za-zµ°%]+)(?:\^?(-?\d+))?")


def unit_of(text: str) -> Unit | None:
    """Parse a unit; None where it is unknown. Angles are dimensionless."""
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
    """Format a unit, such as ``m/s^2``."""

    def product(powers: Mapping[str, Fraction]) -> str:
        return "·".join(name if power == 1 else f"{name}^{power}" for name, power in powers.items())

    above = product({name: power for name, power in unit.items() if power > 0})
    below = product({name: -power for name, power in unit.items() if power < 0})
    return (above or "1") + (f"/{below}" if below else "")


def check_units(tree: Node, units: Mapping[str, str]) -> None:
    """Check that compared and added values have the same unit.

    Args:
        tree: The formula.
        units: The unit of each name; "" where it is unknown.

    Raises:
        ExpressionError: Two units differ.
    """
    for node in walk(tree):
        if isinstance(node, Comparison | Arithmetic | Call):
            _unit(node, units)


def _unit(node: Node, units: Mapping[str, str]) -> Unit | None:
    """Return the unit of a value; None where it is unknown or arbitrary."""
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
            unit = FUNCTIONS[function].unit
            if unit == "same":
                return _common(given, node, f"{function}(...) takes")
            if unit == "root":
                return None if given[0] is None else {name: each / 2 for name, each in given[0].items()}
            return unit_of(unit)
    return None


def _product(left: Unit | None, right: Unit | None, sign: int, one: Node, other: Node) -> Unit | None:
    """Return the unit of a product or a quotient; a numeric constant does not change the unit."""
    left = {} if left is None and isinstance(one, Constant) else left
    right = {} if right is None and isinstance(other, Constant) else right
    if left is None or right is None:
        return None
    powers = dict(left)
    for name, power in right.items():
        powers[name] = powers.get(name, Fraction(0)) + sign * power
    return {name: power for name, power in sorted(powers.items()) if power}


def _common(given: list[Unit | None], node: Node, what: str) -> Unit | None:
    """Return the common unit of several values; those without a known unit are ignored."""
    known = [unit for unit in given if unit is not None]
    for unit in known[1:]:
        if unit != known[0]:
            raise ExpressionError(f"{what} {written(known[0])} with {written(unit)}", node.span)
    return known[0] if known else None
