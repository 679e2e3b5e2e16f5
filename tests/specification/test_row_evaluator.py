"""Predicates evaluated for one row at a time, by a second evaluator, are worth what a run computes for all at once."""

import random
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from symaware_cli.geometry.region import Region
from symaware_cli.specification.columns import robustness
from symaware_cli.specification.expression import FUNCTIONS
from symaware_cli.specification.formula import ZERO
from symaware_cli.specification.parser import parse
from symaware_cli.specification.region import PlacedRegion
from symaware_cli.specification.row_evaluator import RegionHere, row_robustness

ROWS = 7

REGIONS = {
    "near": Region.model_validate({"circle": {"centre": [0, 0], "radius": 5}}),
    "wall": Region.model_validate({"box": [0, 1, 0, 9]}),
    "slab": Region.model_validate({"polygon": [[0, 0], [4, 0.5], [3, 3], [-1, 2]]}),
    "hexagon": Region.model_validate({"polygon": {"sides": 6, "apothem": 2.0, "centre": [1, 1], "rotation": 0.3}}),
    "free": Region.model_validate({"complement": "wall"}),
    "either": Region.model_validate({"union": ["near", {"box": [10, 12, 0, 2]}, "slab"]}),
    "both": Region.model_validate({"intersection": ["near", {"complement": "hexagon"}]}),
    "behind": Region.model_validate({"circle": {"centre": [-2, 0], "radius": 1}, "around": "leader"}),
    "beside": Region.model_validate({"box": [-1, 1, 2, 3], "around": "leader", "turns": False}),
    "around-nobody": Region.model_validate({"box": [-1, 1, 2, 3], "around": "absent"}),
}


def pose(agent: str) -> tuple[np.ndarray, float | None]:
    return np.array([1.7, 0.3]) if agent == "leader" else np.full(2, np.nan), 2.1


def drawn(draw: random.Random) -> Mapping[str, Any]:
    """Values of every kind for all rows; some of them meet exactly."""

    def numbers(*shape: int) -> np.ndarray:
        found = np.array([draw.choice((draw.uniform(-6, 6), draw.randint(-2, 2))) for _ in range(int(np.prod(shape)))])
        return found.reshape(shape).astype(float)

    return {
        "speed": numbers(ROWS),
        "x": numbers(ROWS),
        "position": numbers(ROWS, 2),
        "goal": numbers(ROWS, 2),
        "place": numbers(ROWS, 3),
        "table": numbers(ROWS, 2, 3),
        "ready": numbers(ROWS) > 0,
        "name": np.array([draw.choice("ab") for _ in range(ROWS)], object),
        "time": draw.uniform(0, 9),
    }


class Formula:
    """Draws predicates."""

    def __init__(self, draw: random.Random) -> None:
        self.draw = draw

    def number(self, depth: int) -> str:
        if depth == 0:
            return self.draw.choice(("speed", "x", "time", "1.5", "0", "2", "position[1]", "place[-1]", "ready"))
        one, other, vector = self.number(depth - 1), self.number(depth - 1), self.vector(depth - 1)
        return self.draw.choice(
            (
                *(f"({one} {sign} {other})" for sign in ("+", "-", "*", "/", "%")),
                f"({one} ** 2)",
                f"-{one}",
                *(f"{name}({one})" for name in ("abs", "sin", "cos", "wrap")),
                f"sqrt(abs({one}))",
                f"atan2({one}, {other})",
                f"max({one}, {other}, {vector})",
                f"min({vector}, {one})",
                f"norm({vector})",
                f"count({vector} > 1)",
                f"distance({vector}, {self.vector(depth - 1)})",
                f"distance({one}, {other})",
                f"signed_distance(position, {self.region()})",
                f"{vector}[0]",
                f"max(table * {one})",
            )
        )

    def vector(self, depth: int) -> str:
        if depth == 0:
            return self.draw.choice(("position", "goal", "[speed, x]", "[1, 2.5]"))
        one, other = self.vector(depth - 1), self.vector(depth - 1)
        sign = self.draw.choice("+-*/")
        return self.draw.choice(
            (f"({one} {sign} {other})", f"({one} * {self.number(depth - 1)})", f"abs({one})", f"sin({one})")
        )

    def region(self) -> str:
        return self.draw.choice([name for name in REGIONS if "-" not in name])

    def predicate(self) -> str:
        depth = self.draw.randint(0, 3)
        one, other, vector = self.number(depth), self.number(depth), self.vector(depth)
        sign = self.draw.choice(("<", "<=", ">", ">=", "==", "!="))
        return self.draw.choice(
            (
                f"{one} {sign} {other}",
                f"{one} {sign} {other}",
                f"{one} < {other} <= {self.number(depth)}",
                f"all({vector} {sign} {other})",
                f"any({vector} {sign} {self.vector(depth)})",
                f"{vector} == {self.vector(depth)}",
                f"{vector} != {self.vector(depth)}",
                f"inside(position, {self.region()})",
                f"inside({vector}, {self.region()})",
                f"inside(place, {self.region()})",
                "ready",
                'name == "a"',
                'name != "b"',
                f"any({vector} > 0) == ready",
            )
        )


@pytest.mark.parametrize("seed", range(20))
def test_random_predicates_are_worth_the_same_to_the_bit(seed: int) -> None:
    draw = random.Random(seed)
    formula = Formula(draw)
    compared = 0
    for _ in range(100):
        values, text = drawn(draw), formula.predicate()
        names = {*values, *REGIONS}
        node = parse(text, names, {name: count for name, (count, _) in FUNCTIONS.items()})
        placed = {name: PlacedRegion(name, REGIONS, pose) for name in REGIONS}
        here = {name: RegionHere(name, REGIONS, pose) for name in REGIONS}
        with np.errstate(all="ignore"):
            try:
                expected = np.broadcast_to(robustness(node)({**values, **placed}.__getitem__), (ROWS,))
            except TypeError:
                continue  # constants alone, which the run refuses in some functions of vectors
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
def test_predicates_of_constants_are_worth_what_one_reckons_by_hand(text: str, value: float) -> None:
    node = parse(text, (), {name: count for name, (count, _) in FUNCTIONS.items()})
    nothing: Mapping[str, Any] = {}
    assert row_robustness(node, nothing.__getitem__) == value


@pytest.mark.parametrize("text", ["name > 1", "inside(2, near)", "inside([1, 2], x)", "[1, 2] > 0", "x"])
def test_what_has_no_value_is_an_error(text: str) -> None:
    node = parse(text, ("name", "near", "x"), {name: count for name, (count, _) in FUNCTIONS.items()})
    values = {"name": "a", "x": 1.0, "near": RegionHere("near", REGIONS, pose)}
    with pytest.raises((TypeError, ValueError)):
        row_robustness(node, values.__getitem__)
