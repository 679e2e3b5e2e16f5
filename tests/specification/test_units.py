"""What is compared or added has one unit, as far as units are known."""

import pytest

from symaware_cli.specification.columns import ARGUMENTS
from symaware_cli.specification.node import Node
from symaware_cli.specification.parser import parse
from symaware_cli.specification.token import ExpressionError
from symaware_cli.specification.units import check_units, unit_of, written

UNITS = {"speed": "m/s", "position": "m", "nearest": "m", "time": "s", "heading": "rad", "level": "", "pull": "m/s^2"}


def tree(text: str) -> Node:
    return parse(text, UNITS, ARGUMENTS)


@pytest.mark.parametrize(
    "text",
    [
        "speed > 2",
        "speed * time < nearest",
        "nearest > speed ** 2 / (2 * pull)",
        "sqrt(2 * pull * nearest) > speed",
        "level > nearest and level > time",
        "nearest / time > 2 * speed",
        "abs(wrap(heading)) < 0.1",
        "distance(position, [0, 0]) < nearest",
        "sin(heading) < 0.5",
        "norm(position) + 1 < max(nearest, 3)",
    ],
)
def test_compatible_units(text: str) -> None:
    check_units(tree(text), UNITS)


@pytest.mark.parametrize(
    ("text", "said", "marked"),
    [
        ("speed > nearest", "this compares m/s with m", "speed > nearest"),
        ("always (time < 3 implies nearest + time > 2)", "this combines m with s", "nearest + time"),
        ("max(speed, nearest) > 1", r"max\(...\) takes m/s with m", "max(speed, nearest)"),
        ("speed ** 2 > pull", r"this compares m\^2/s\^2 with m/s\^2", "speed ** 2 > pull"),
        ("distance(position, heading) > 1", r"distance\(...\) takes m with 1", "distance(position, heading)"),
    ],
)
def test_incompatible_units_are_reported_at_their_place(text: str, said: str, marked: str) -> None:
    with pytest.raises(ExpressionError, match=said) as caught:
        check_units(tree(text), UNITS)
    assert text[caught.value.start : caught.value.end] == marked


@pytest.mark.parametrize(("unit", "same"), [("m/s^2", "m/s^2"), ("rad/s", "1/s"), ("kg m/s^2", "kg·m/s^2"), ("1", "1")])
def test_units_are_read_and_written(unit: str, same: str) -> None:
    found = unit_of(unit)
    assert found is not None
    assert written(found) == same


def test_unknown_units() -> None:
    assert unit_of("") is None
    assert unit_of("§") is None
