"""Predicates evaluated row by row by a second evaluator have the values that a run computes for all rows at once."""

import random
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from expressions import REGIONS, ROWS, RandomExpression, drawn, pose

from symaware_cli.evidence.row_evaluator import RegionHere, row_robustness
from symaware_cli.specification.columns import ARGUMENTS, robustness
from symaware_cli.specification.formula import ZERO
from symaware_cli.specification.parser import parse
from symaware_cli.specification.region import PlacedRegion


@pytest.mark.parametrize("seed", range(20))
def test_random_predicates_have_bitwise_equal_values(seed: int) -> None:
    draw = random.Random(seed)
    formula = RandomExpression(draw)
    compared = 0
    for _ in range(100):
        values, text = drawn(draw), formula.predicate()
        names = {*values, *REGIONS}
        node = parse(text, names, ARGUMENTS)
        placed = {name: PlacedRegion(name, REGIONS, pose) for name in REGIONS}
        here = {name: RegionHere(name, REGIONS, pose) for name in REGIONS}
        with np.errstate(all="ignore"):
            expected = np.broadcast_to(robustness(node)({**values, **placed}.__getitem__), (ROWS,))
            for row in range(ROWS):
                own = {name: each[row] if isinstance(each, np.ndarray) else each for name, each in values.items()}
                found = row_robustness(node, {**own, **here}.__getitem__)
                is_same = found == expected[row] or (np.isnan(found) and np.isnan(expected[row]))
                assert is_same, f"{text} is {found!r}, and {expected[row]!r} in the run, with {own}"
                compared += not np.isnan(found)
    assert compared > 400


@pytest.mark.parametrize(
    ("point", "region", "depth"),
    [
        ([3.0, 4.0], "near", ZERO),
        ([3.0, 0.0], "near", 2.0),
        ([-3.0, 5.0], "wall", -3.0),
        ([4.0, 13.0], "wall", -5.0),
        ([0.25, 5.0], "wall", 0.25),
        ([0.25, 5.0], "free", -0.25),
        ([11.0, 1.0], "either", 1.0),
        ([1.0, 1.0], "hexagon", 2.0),
        ([1.0, 1.0], "both", -2.0),
        ([1.7, 2.8], "beside", 0.5),
        ([0.0, 0.0], "around-nobody", -np.inf),
    ],
)
def test_the_depth_in_a_region_is_the_distance_to_its_boundary(point: list[float], region: str, depth: float) -> None:
    found = RegionHere(region, REGIONS, pose).depth(np.array(point))
    assert found == (depth if abs(depth) in (ZERO, np.inf) else pytest.approx(depth, abs=1e-12))
    assert found == PlacedRegion(region, REGIONS, pose).robustness(np.array([point]))[0]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3 > 1", 2.0),
        ("1 > 1", -ZERO),
        ("1 >= 1", ZERO),
        ("norm([3, 4]) < 6", 1.0),
        ("7 % 4 == 3", ZERO),
        ("distance([1, 1], [4, 5]) != 4", 1.0),
        ("all([1, 5] > 0)", 1.0),
        ("any([1, 5] > 7)", -2.0),
        ("count([1, 5, 7] > 4) == 2", ZERO),
        ("max(2, [1, 9], 3) <= 9", ZERO),
        ("sqrt(16) / 2 > 1", 1.0),
    ],
)
def test_predicates_of_constants_have_hand_computed_values(text: str, value: float) -> None:
    node = parse(text, (), ARGUMENTS)
    nothing: Mapping[str, Any] = {}
    assert row_robustness(node, nothing.__getitem__) == value


@pytest.mark.parametrize("text", ["name > 1", "inside(2, near)", "inside([1, 2], x)", "[1, 2] > 0", "x"])
def test_expressions_without_a_value_raise_errors(text: str) -> None:
    node = parse(text, ("name", "near", "x"), ARGUMENTS)
    values = {"name": "a", "x": 1.0, "near": RegionHere("near", REGIONS, pose)}
    with pytest.raises((TypeError, ValueError)):
        row_robustness(node, values.__getitem__)
