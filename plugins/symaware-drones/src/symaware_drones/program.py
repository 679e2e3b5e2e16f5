"""The smallest control input that satisfies constraints, as a quadratic program."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.optimal_control.qp import solve_qp
from symaware_drones.polygon import Corner, faces, regular, support

#: What a constraint may lack before it counts as relaxed [m/s].
_TOLERANCE = 1e-6
#: Gradients below this cannot be followed.
_FLAT = 1e-9
#: The price of relaxing a constraint, whose slack is as large as its multiplier over it.
_PRICE = 1e6


class Constraint(NamedTuple):
    """x u_x + y u_y >= bound.

    Attributes:
        name: What it is about.
        x: The factor of the first element of the input.
        y: The factor of the second.
        bound: The least value.
    """

    name: str
    x: float
    y: float
    bound: float


class Inputs:
    """The set U of inputs: a regular polygon around 0.

    Attributes:
        corners: Its corners.
    """

    def __init__(self, sides: int, radius: float) -> None:
        self.corners = regular(sides, radius)
        rows = np.array(faces(self.corners))
        self._apothem = radius * math.cos(math.pi / sides)
        self._normals, self._offsets = rows[:, :2], rows[:, 2]

    def most(self, x: float, y: float) -> float:
        """Return the greatest scalar product of a vector with an input."""
        return support(self.corners, x, y)

    def smallest(self, share: float, constraints: Sequence[Constraint]) -> tuple[Corner, list[tuple[str, float]]]:
        """Return the input with the least norm.

        Args:
            share: Which share of U may be used, gamma.
            constraints: What is to hold, the most important first; at most two.

        Returns:
            The input; and the name of each constraint that had to be relaxed, with how much it fails by. The first is
            relaxed only as far as it cannot hold by itself.
        """
        relaxed: dict[str, float] = {}
        wanted = []
        for each in constraints:
            best = share * self.most(each.x, each.y)
            if each.bound > best:
                if each.bound > best + _TOLERANCE:
                    relaxed[each.name] = each.bound - best
                each = each._replace(bound=best)
            if math.hypot(each.x, each.y) > _FLAT:
                wanted.append(each)
        if share <= 0.0 or all(each.bound <= 0.0 for each in wanted):
            return (0.0, 0.0), list(relaxed.items())
        if len(wanted) == 1:
            # The nearest point of the half-plane to 0, where no face of the inputs cuts it off.
            x, y, bound = wanted[0][1:]
            scale = bound / (x * x + y * y)
            if scale * math.hypot(x, y) <= share * self._apothem:
                return (scale * x, scale * y), list(relaxed.items())
        rows = np.concatenate([self._normals, [(each.x, each.y) for each in wanted]])
        lower = np.concatenate([np.full(len(self._normals), -np.inf), [each.bound for each in wanted]])
        upper = np.concatenate([share * self._offsets, np.full(len(wanted), np.inf)])
        solution = solve_qp(_COST, _LINEAR, rows, lower, upper)
        if not solution.solved:
            # Each constraint can hold by itself, so the last one yields.
            prices = np.full(len(rows), np.inf)
            prices[-1] = _PRICE
            solution = solve_qp(_COST, _LINEAR, rows, lower, upper, prices=prices)
            last = wanted[-1].name
            relaxed[last] = relaxed.get(last, 0.0) + float(abs(solution.slacks[-1]))
        if not solution.solved:
            raise ArithmeticError(f"the program of {', '.join(each.name for each in constraints)} is {solution.status}")
        return (float(solution.x[0]), float(solution.x[1])), list(relaxed.items())


_COST, _LINEAR = np.eye(2), np.zeros(2)
