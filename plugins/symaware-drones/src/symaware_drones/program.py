"""The smallest control input that satisfies constraints, as a quadratic program."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.planning.optimal_control.qp import solve_qp
from symaware_drones.polygon import Corner, faces, regular, support

Array = NDArray[np.float64]

#: What a constraint may lack before it counts as relaxed [m/s].
_TOLERANCE = 1e-6
#: Gradients below this cannot be followed.
_FLAT = 1e-9
#: The price of relaxing a constraint, whose slack is as large as its multiplier over it.
_PRICE = 1e6
#: How much cheaper it is to relax a constraint that is less important.
_RANK = 1e3


class Constraint(NamedTuple):
    """x u_x + y u_y >= bound.

    Attributes:
        name: The name of its subject.
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

    def smallest(
        self, share: float, constraints: Sequence[Constraint], apart: Sequence[Constraint] = ()
    ) -> tuple[Corner, list[tuple[str, float]]]:
        """Return the input with the least norm.

        Args:
            share: The share of U that may be used, gamma.
            constraints: The constraints, the most important first; at most two.
            apart: Constraints with precedence over these; 0 satisfies them. Those that it violates are left out.

        Returns:
            The input; and the name of each constraint that had to be relaxed, with its violation. The first is relaxed
            only as far as it cannot hold by itself, or besides `apart`.
        """
        relaxed: dict[str, float] = {}
        wanted = []
        apart = [each for each in apart if each.bound <= 0.0]
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
        if len(wanted) == 1 and not apart:
            # The nearest point of the half-plane to 0, where no face of the inputs cuts it off.
            x, y, bound = wanted[0][1:]
            scale = bound / (x * x + y * y)
            if scale * math.hypot(x, y) <= share * self._apothem:
                return (scale * x, scale * y), list(relaxed.items())
        every = [*apart, *wanted]
        rows = np.array([(each.x, each.y) for each in every])
        bounds = np.array([each.bound for each in every])
        lengths = np.hypot(rows[:, 0], rows[:, 1])
        # The solver may take a row that is much smaller than the others for a contradiction: then all get the length 1.
        for unit in (np.ones(len(every)), lengths):
            try:
                found = self._solve(share, rows / unit.reshape(-1, 1), bounds / unit, len(wanted), bool(apart))
            except ValueError:  # for the solver the program is not convex, since the row is so small
                continue
            if found is not None:
                point, slacks = found
                for each, slack in zip(wanted, (slacks * unit[-len(wanted) :]).tolist(), strict=True):
                    if slack > _TOLERANCE:
                        relaxed[each.name] = relaxed.get(each.name, 0.0) + slack
                return point, list(relaxed.items())
        # Where the solver fails, 0 keeps drones apart, and all that is wanted yields.
        for each in wanted:
            if each.bound > _TOLERANCE:
                relaxed[each.name] = relaxed.get(each.name, 0.0) + each.bound
        return (0.0, 0.0), list(relaxed.items())

    def _solve(
        self, share: float, gradients: Array, bounds: Array, wanted: int, may_all_yield: bool
    ) -> tuple[Corner, Array] | None:
        """Return the smallest input, and the violation of each of the last constraints; None if there is none.

        Args:
            share: The share of U that may be used.
            gradients: The constraints; shape (n, 2).
            bounds: Their bounds; shape (n,).
            wanted: The number of constraints, the last ones, that may be violated.
            may_all_yield: Whether all of these may, or only the last one.
        """
        rows = np.concatenate([self._normals, gradients])
        lower = np.concatenate([np.full(len(self._normals), -np.inf), bounds])
        upper = np.concatenate([share * self._offsets, np.full(len(bounds), np.inf)])
        slacks = np.zeros(wanted)
        solution = solve_qp(_COST, _LINEAR, rows, lower, upper)
        # Each constraint can hold by itself, so the last one yields; besides `apart`, all of them may have to.
        for yielding in range(1, wanted + 1 if may_all_yield else 2):
            if solution.solved:
                break
            prices = np.full(len(rows), np.inf)
            prices[-yielding:] = _PRICE
            prices[-1] = _PRICE / (1.0 if yielding == 1 else _RANK)
            solution = solve_qp(_COST, _LINEAR, rows, lower, upper, prices=prices)
            if solution.solved:
                slacks[-yielding:] = np.abs(solution.slacks[-yielding:])
        if not solution.solved:
            return None
        return (float(solution.x[0]), float(solution.x[1])), slacks


_COST, _LINEAR = np.eye(2), np.zeros(2)
