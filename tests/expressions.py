"""Random expressions, and values of their names for several rows."""

import random
from collections.abc import Mapping
from typing import Any

import numpy as np

from symaware_cli.geometry.region import Region

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


class RandomExpression:
    """Draws texts of expressions about the names that `drawn` has values for, and `REGIONS`."""

    def __init__(self, draw: random.Random) -> None:
        self.draw = draw

    def condition(self, depth: int) -> str:
        """Predicates that are joined."""
        if depth == 0:
            return self.predicate()
        one, other = self.condition(depth - 1), self.condition(depth - 1)
        return self.draw.choice(
            (f"({one} and {other})", f"({one} or {other})", f"({one} implies {other})", f"not ({one})", one)
        )

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
