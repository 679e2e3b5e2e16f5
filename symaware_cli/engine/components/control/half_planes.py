"""Velocities within half-planes: vectorised linear programs of reciprocal collision avoidance.

Each agent has constraints n . v <= c on its velocity v in the plane, and a maximum speed. The first program finds the
velocity closest to a preferred one, by adding one constraint after the other (R. Seidel, "Small-dimensional linear
programming and convex hulls made easy", Discrete Comput. Geom. 6, 1991). If the constraints are infeasible, the second
finds the velocity that violates them least.

Constraints are stored in padded arrays of shape (n, m); padding has the normal (0, 0) and the limit infinity. All
arithmetic is elementwise, so no bit of an agent's result depends on other agents or on padding.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from symaware_cli.geometry import Array, Indices, Mask

#: The tolerance of constraints [m/s], also for parallel lines.
TOLERANCE = 1e-9


class HalfPlanes(NamedTuple):
    """The constraints of each agent of a group.

    Attributes:
        x: First element of the unit normal; shape (n, m).
        y: Second element of it; shape (n, m).
        limit: The greatest velocity along the normal [m/s]; shape (n, m).
        weight: How much a constraint yields, relative to the others, if they are infeasible; above 0, shape (n, m).
    """

    x: Array
    y: Array
    limit: Array
    weight: Array

    def of(self, rows: Indices | tuple[Indices, Indices]) -> HalfPlanes:
        """Return the constraints of some agents, or some constraints of these."""
        return HalfPlanes(*(each[rows] for each in self))

    def excess(self, x: Array, y: Array) -> Array:
        """Return the violation of each constraint over its weight; negative if satisfied; shape (n, m)."""
        return (self.x * x[:, None] + self.y * y[:, None] - self.limit) / self.weight


def nearest_velocity(planes: HalfPlanes, preferred: Array, speed: float) -> tuple[Array, Mask]:
    """Return the feasible velocity closest to the preferred one, or else the one with the least violation.

    Args:
        planes: The constraints.
        preferred: The preferred velocities [m/s]; shape (n, 2).
        speed: The maximum speed [m/s].

    Returns:
        The velocities, shape (n, 2), and whether the constraints are infeasible, shape (n,).
    """
    preferred_speed = np.sqrt(preferred[:, 0] * preferred[:, 0] + preferred[:, 1] * preferred[:, 1])
    shortened = np.where(preferred_speed > speed, speed / np.maximum(preferred_speed, 1e-300), 1.0)
    goal_x, goal_y = preferred[:, 0], preferred[:, 1]
    x, y = goal_x * shortened, goal_y * shortened
    contradictory = np.zeros(len(preferred), bool)
    for column in range(planes.limit.shape[1]):
        violated = planes.x[:, column] * x + planes.y[:, column] * y > planes.limit[:, column] + TOLERANCE
        rows = np.flatnonzero(violated & ~contradictory)
        if len(rows):
            along_x, along_y, possible = _on_border(planes, column, rows, goal_x[rows], goal_y[rows], speed)
            contradictory[rows] = ~possible
            x[rows], y[rows] = along_x, along_y
    rows = np.flatnonzero(contradictory)
    if len(rows):
        x[rows], y[rows] = _least_violation(planes.of(rows), goal_x[rows], goal_y[rows], speed)
    return np.stack([x, y], axis=1), contradictory


def _on_border(
    planes: HalfPlanes, column: int, rows: Indices, goal_x: Array, goal_y: Array, speed: float
) -> tuple[Array, Array, Mask]:
    """Find the closest velocity on the border of one constraint that satisfies those before it, if any.

    On the border v = c n + t d with d perpendicular to n; the speed and the earlier constraints bound t.
    """
    normal_x, normal_y = planes.x[rows, column], planes.y[rows, column]
    limit = planes.limit[rows, column]
    along_x, along_y = -normal_y, normal_x
    room = speed * speed - limit * limit
    possible = room >= 0.0
    high = np.sqrt(np.maximum(room, 0.0))
    low = -high
    if column:
        x, y = planes.x[rows, :column], planes.y[rows, :column]
        slope = x * along_x[:, None] + y * along_y[:, None]
        rest = planes.limit[rows, :column] - limit[:, None] * (x * normal_x[:, None] + y * normal_y[:, None])
        parallel = np.abs(slope) <= TOLERANCE
        possible &= ~(parallel & (rest < -TOLERANCE)).any(axis=1)
        ends = rest / np.where(parallel, 1.0, slope)
        high = np.minimum(high, np.where(slope > TOLERANCE, ends, np.inf).min(axis=1))
        low = np.maximum(low, np.where(slope < -TOLERANCE, ends, -np.inf).max(axis=1))
        possible &= low <= high
    t = np.minimum(np.maximum(goal_x * along_x + goal_y * along_y, low), high)
    return limit * normal_x + t * along_x, limit * normal_y + t * along_y, possible


# The singles, pairs and triples of the four constraints in `_optimum`.
_SINGLES = np.arange(4)
_PAIRS = np.array(list(combinations(range(4), 2)))
_TRIPLES = np.array(list(combinations(range(4), 3)))
#: Constraints that determine each candidate: singles, pairs on one side and on the other, triples; shape (20, 3).
_DECIDING = np.concatenate(
    [np.repeat(_SINGLES[:, None], 3, axis=1), _PAIRS[:, [0, 1, 1]], _PAIRS[:, [0, 1, 1]], _TRIPLES]
)


def _least_violation(planes: HalfPlanes, goal_x: Array, goal_y: Array, speed: float) -> tuple[Array, Array]:
    """Find the velocities whose maximum violation of a constraint is least.

    At most three constraints determine the solution. So the algorithm keeps three, adds the one that their solution
    violates most, and keeps the three that determine the solution of these four, until no other is violated more. The
    maximum violation grows each time, so this terminates (M. Sharir, E. Welzl, "A combinatorial bound for linear
    programming and
    related problems", STACS 1992).

    Returns:
        Both elements of the velocities, each of shape (n,).
    """
    worst = planes.excess(goal_x, goal_y).argmax(axis=1)
    chosen = np.repeat(worst[:, None], 4, axis=1)
    x, y = goal_x.copy(), goal_y.copy()
    rows = np.arange(len(worst))
    for _ in range(4 * planes.limit.shape[1]):
        taken = chosen[rows]
        x[rows], y[rows], violation, deciding = _optimum(planes.of((rows[:, None], taken)), speed)
        chosen[rows, :3] = np.take_along_axis(taken, deciding, axis=1)
        excess = planes.of(rows).excess(x[rows], y[rows])
        worst = excess.argmax(axis=1)
        more = excess[np.arange(len(rows)), worst] > violation + TOLERANCE
        chosen[rows, 3] = worst
        rows = rows[more]
        if not len(rows):
            break
    return x, y


def _optimum(four: HalfPlanes, speed: float) -> tuple[Array, Array, Array, Indices]:
    """Solve the second program for four constraints, by trying all candidates.

    A candidate is determined by one constraint, with the maximum speed against its normal, by two that are violated
    equally at the maximum speed, or by three that are violated equally.

    Returns:
        Both elements of the velocities and their maximum violation, each of shape (n,), and the three of the four
        constraints that determine them, shape (n, 3).
    """
    over = 1.0 / four.weight
    x, y, limit = four.x * over, four.y * over, four.limit * over
    # Velocities that violate two equally: a line a . v = b.
    first, second = _PAIRS[:, 0], _PAIRS[:, 1]
    a_x, a_y, b = x[:, first] - x[:, second], y[:, first] - y[:, second], limit[:, first] - limit[:, second]
    square = a_x * a_x + a_y * a_y
    sound = square > TOLERANCE * TOLERANCE
    square = np.where(sound, square, 1.0)
    foot_x, foot_y = a_x * b / square, a_y * b / square
    room = speed * speed - (foot_x * foot_x + foot_y * foot_y)
    half = np.sqrt(np.maximum(room, 0.0) / square)
    reached = sound & (room >= 0.0)
    # Velocities that violate three equally: the crossing of two such lines, of the pairs (0, 1) and (0, 2).
    one, other = _PAIR_OF[_TRIPLES[:, 0], _TRIPLES[:, 1]], _PAIR_OF[_TRIPLES[:, 0], _TRIPLES[:, 2]]
    determinant = a_x[:, one] * a_y[:, other] - a_y[:, one] * a_x[:, other]
    crossing = np.abs(determinant) > TOLERANCE * TOLERANCE
    determinant = np.where(crossing, determinant, 1.0)
    cross_x = (b[:, one] * a_y[:, other] - b[:, other] * a_y[:, one]) / determinant
    cross_y = (a_x[:, one] * b[:, other] - a_x[:, other] * b[:, one]) / determinant
    crossing &= cross_x * cross_x + cross_y * cross_y <= speed * speed * (1.0 + TOLERANCE)

    candidate_x = np.concatenate([-speed * four.x, foot_x - half * a_y, foot_x + half * a_y, cross_x], axis=1)
    candidate_y = np.concatenate([-speed * four.y, foot_y + half * a_x, foot_y - half * a_x, cross_y], axis=1)
    valid = np.concatenate([np.ones(four.x.shape, bool), reached, reached, crossing], axis=1)
    violations = (
        x[:, None, :] * candidate_x[:, :, None] + y[:, None, :] * candidate_y[:, :, None] - limit[:, None, :]
    )  # of each candidate, by each constraint
    greatest = violations.max(axis=2)
    decided = violations[:, np.arange(len(_DECIDING)), _DECIDING[:, 0]]
    # Among equal candidates prefer one that its own constraints determine: at the others another is violated more.
    ranked = np.where(valid, greatest + 2.0 * TOLERANCE * (decided < greatest - TOLERANCE), np.inf)
    best = ranked.argmin(axis=1)
    rows = np.arange(len(best))
    return candidate_x[rows, best], candidate_y[rows, best], greatest[rows, best], _DECIDING[best]


_PAIR_OF = np.zeros((4, 4), np.intp)
_PAIR_OF[_PAIRS[:, 0], _PAIRS[:, 1]] = np.arange(len(_PAIRS))
