"""Predicates are evaluated for all agents at once; their robustness is in their own unit, its sign the truth."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from symaware_cli.geometry.region import Region
from symaware_cli.specification.columns import ARGUMENTS, FUNCTIONS, KindError, robustness, values
from symaware_cli.specification.expression import Expression
from symaware_cli.specification.formula import ZERO, plain
from symaware_cli.specification.node import Node
from symaware_cli.specification.parser import parse
from symaware_cli.specification.region import PlacedRegion

REGIONS = {
    "near": Region.model_validate({"circle": {"centre": [0, 0], "radius": 5}}),
    "wall": Region.model_validate({"box": [0, 1, 0, 9]}),
    "free": Region.model_validate({"complement": "wall"}),
    "either": Region.model_validate({"union": ["near", {"box": [10, 12, 0, 2]}]}),
    "both": Region.model_validate({"intersection": ["near", "wall"]}),
    "behind": Region.model_validate({"circle": {"centre": [-2, 0], "radius": 1}, "around": "leader"}),
}


def anchor(agent: str) -> tuple[np.ndarray, float | None]:
    return np.array([10.0, 0.0]), np.pi / 2


VALUES: Mapping[str, Any] = {
    "speed": np.array([1.0, 2.0, 4.0]),
    "position": np.array([[3.0, 4.0], [0.0, 0.0], [10.0, -2.0]]),
    "goal": np.array([[3.0, 0.0], [0.0, 0.0], [1.0, -2.0]]),
    "ready": np.array([True, False, True]),
    "name": np.array(["a", "b", "a"], object),
    "nothing": np.array([None, None, None], object),
    "time": 2.5,
    "table": {"limit": np.array([1.0, 2.0, 3.0])},
    **{name: PlacedRegion(name, REGIONS, anchor) for name in REGIONS},
}


def tree(text: str) -> Node:
    return parse(text, VALUES, ARGUMENTS)


def tree_of(text: str) -> Node:
    return parse(text, ("x", "limit"), ARGUMENTS)


def margin(text: str) -> list[float]:
    found: list[float] = np.broadcast_to(plain(robustness(tree(text))(VALUES.__getitem__)), (3,)).tolist()
    return found


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("speed > 2", [-1, 0, 2]),
        ("speed <= 2", [1, 0, -2]),
        ("speed == 2", [-1, 0, -2]),
        ("speed != 2", [1, 0, 2]),
        ("1 < speed < 3", [0, 1, -1]),
        ("time > 1", [1.5, 1.5, 1.5]),
        ("distance(position, goal) < 5", [1, 5, -4]),
        ("norm(position) < 6", [1, 6, 6 - np.sqrt(104)]),
        ("position[0] > position[-1]", [-1, 0, 12]),
        ("all(position > -1)", [4, 1, -1]),
        ("any(position > 3)", [1, -3, 7]),
        ("position * speed + 1 == goal * 2", [-5, -1, -39]),
        ("max(speed, position) >= 4", [0, -2, 6]),
        ('table["limit"] >= speed', [0, 0, -1]),
        ("ready", [np.inf, -np.inf, np.inf]),
        ('name == "a"', [np.inf, -np.inf, np.inf]),
        ("inside(position, near)", [0, 5, 5 - np.sqrt(104)]),
        ("inside(position, wall)", [-2, 0, -np.hypot(9, 2)]),
        ("inside(position, free)", [2, 0, np.hypot(9, 2)]),
        ("inside(position, either)", [0, 5, -2]),
        ("inside(position, both)", [-2, 0, -np.hypot(9, 2)]),
        ("inside(position, behind)", [1 - np.hypot(7, 6), 1 - np.hypot(10, 2), 1]),
        ("signed_distance(position, near) > 1", [-1, 4, 4 - np.sqrt(104)]),
    ],
)
def test_the_robustness_of_a_predicate(text: str, expected: list[float]) -> None:
    assert margin(text) == pytest.approx(expected)


@pytest.mark.parametrize("number", ["0.5", "0", "-0.0", "-1.5", "1e308"])
@pytest.mark.parametrize("order", ["<", "<=", ">", ">="])
def test_an_order_with_a_number_is_that_with_values_to_the_bit(order: str, number: str) -> None:
    every = np.array([1.5, -1.5, 0.5, 0.0, -0.0, 5e-324, -1e308, np.inf, -np.inf, np.nan])
    for x in (every, every[every > 0.5], every[every < -0.5], *every.tolist(), every.reshape(2, 5)):
        known = {"x": x, "limit": np.full(np.shape(x), float(number))[()]}
        for written in ("x {} {}", "{1} {0} x"):
            found, expected = (tree_of(written.format(order, each)) for each in (number, "limit"))
            with np.errstate(all="ignore"):
                results = [values(each)(known.__getitem__) for each in (found, expected)]
                assert np.array_equal(*results)
                if np.ndim(x) < 2:
                    margins = [robustness(each)(known.__getitem__) for each in (found, expected)]
                    assert margins[0].tobytes() == margins[1].tobytes()


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("speed > 2", False),
        ("speed >= 2", True),
        ("speed < 2", False),
        ("speed <= 2", True),
        ("speed == 2", True),
        ("speed != 2", False),
        ("inside(position, wall)", True),
        ("inside(position, free)", False),
    ],
)
def test_the_sign_says_whether_a_predicate_with_robustness_zero_holds(text: str, holds: bool) -> None:
    assert robustness(tree(text))(VALUES.__getitem__)[1] == (ZERO if holds else -ZERO)


@pytest.mark.parametrize(
    "text",
    [
        text
        for text in FUNCTIONS
        if text not in ("inside", "signed_distance", "distance", "atan2", "count", "all", "any")
    ],
)
def test_functions_give_the_same_for_one_agent_and_for_many(text: str) -> None:
    for argument in ("speed", "position[0] + 3"):
        whole = values(tree(f"{text}({argument})"))(VALUES.__getitem__)
        for row in range(3):
            one = {"speed": VALUES["speed"][row], "position": VALUES["position"][row]}
            single = Expression(f"{text}({argument})", one).value(one.__getitem__)
            assert single == pytest.approx(whole[row], nan_ok=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("speed", "a number is not a condition; compare it"),
        ("position > 1", r"there are 2 values of each; use all\(...\) or any\(...\)"),
        ("speed[0] > 1", "a number has no elements"),
        ("position[2] > 1", "there is no element 2 in a vector of 2"),
        ("name > 1", "a text is not a number"),
        ("nothing > 1", "a text is not a number|nothing is not a number"),
        ("inside(speed, near)", "a point has coordinates"),
        ("inside(position, goal)", "is not a region"),
        ("near > 1", "the region `near` is not a number"),
        ("distance(position, [1, 2, 3]) > 1", "a vector of 2 does not go with one of 3"),
        ('table["limits"] > 1', "limits"),
        ('speed["x"] > 1', "has no element 'x'"),
    ],
)
def test_a_missing_robustness_has_a_reason(text: str, said: str) -> None:
    with pytest.raises((KindError, KeyError), match=said):
        robustness(tree(text))(VALUES.__getitem__)


def test_a_region_around_an_agent_that_is_not_there_holds_nobody() -> None:
    gone = PlacedRegion("behind", REGIONS, lambda agent: (np.array([np.nan, np.nan]), None))
    assert gone.robustness(VALUES["position"]).tolist() == [-np.inf] * 3
