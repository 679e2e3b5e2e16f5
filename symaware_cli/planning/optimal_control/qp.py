"""Small dense convex quadratic programs, such as the filters of control barrier functions solve at each sample.

    minimise  1/2 x' H x + f' x   subject to   lower <= A x <= upper   and   bounds[0] <= x <= bounds[1]

DAQP solves them: a dual active-set method (D. Arnström, A. Bemporad, D. Axehill, "A dual active-set solver for embedded
quadratic programming using recursive LDL' updates", IEEE Transactions on Automatic Control 67, 2022). It is exact up to
rounding, takes microseconds for a few variables, and finds the solution also where a single point is feasible. It needs
the extra ``qp``, and not CasADi.

A program is solved by a function of its data: nothing is kept between two calls, so results do not depend on earlier
ones, except through the guess that is passed.

Reasons: docs/decisions/0038-quadratic-programs.md
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import daqp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.geometry import Array, Indices

#: The tolerance of constraints by default, and the one that is tried first; see `solve_qp`.
TOLERANCE, FINE = 1e-6, 1e-9
#: Below which square of the sine of their angle DAQP takes two constraints for parallel.
_PARALLEL = 1e-13
#: Flags of constraints in DAQP: initially active, and so at the lower limit.
_ACTIVE, _AT_LOWER = 1, 2
#: DAQP's results.
_SOLVED, _NOT_CONVEX = 1, -5
#: No point is feasible; equations contradict each other.
_INFEASIBLE = -1, -6

Status = Literal["solved", "infeasible", "failed"]


@dataclass(frozen=True, slots=True)
class QPSolution:
    """The result of a quadratic program.

    Attributes:
        x: The solution; shape (n,). It has no meaning unless ``solved``.
        status: ``solved``; ``infeasible``: no x satisfies all constraints without a price; or ``failed``: the solver
            found neither.
        multipliers: The multiplier of each constraint, of the rows of A and then of the bounds; shape (m,) or (m + n,).
            It is positive at the upper limit, negative at the lower one, and 0 elsewhere, so that H x + f + A'
            multipliers = 0. Zero unless ``solved``. It is also the guess for the next program.
        slacks: By how much each row of A was relaxed, lower <= A x + slack <= upper; shape (m,), zero for rows without
            a price.
        iterations: The number of iterations.
    """

    x: Array
    status: Status
    multipliers: Array
    slacks: Array
    iterations: int

    @property
    def solved(self) -> bool:
        """Whether `x` is the solution."""
        return self.status == "solved"


def solve_qp(
    H: ArrayLike,
    f: ArrayLike,
    A: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    prices: ArrayLike | None = None,
    guess: QPSolution | None = None,
    tolerance: float = TOLERANCE,
    iterations: int = 1000,
) -> QPSolution:
    """Solve a quadratic program.

    Args:
        H: The quadratic cost, symmetric and positive definite; shape (n, n).
        f: The linear cost; shape (n,).
        A: The constraints, in rows; shape (m, n).
        lower: The lower limit of each row, -inf for none; shape (m,).
        upper: The upper limit of each row, inf for none; shape (m,). An equation has equal limits.
        bounds: The least and the greatest value of each variable; both of shape (n,).
        prices: If given, rows of A with a finite price p yield: they are relaxed by a slack s at the cost of p s^2 / 2.
            So a row that is active is relaxed a little even if the program is feasible, by its multiplier over its
            price. Those with infinite prices do not yield. Shape (m,), above 0.
        guess: The result of a similar program of the same shape, whose active constraints are tried first. It saves
            iterations; the solution is the same except for rounding.
        tolerance: By how much a constraint may be violated by a solution, as a distance in units of x (for H = I; else
            in the metric of H over the mean of its diagonal). First a solution within 1e-9 is sought. If there is
            none, as where the feasible set is a point and rounding moves its constraints apart, one within this
            tolerance also counts as solved.
        iterations: The greatest number of iterations.

    Returns:
        The result; see `QPSolution`.

    Raises:
        ValueError: The shapes do not match, a number is not finite (limits may be infinite), or H is not positive
            definite.
    """
    cost, linear, rows, least, most = _array(H), _array(f), _array(A), _array(lower), _array(upper)
    size, count = linear.size, most.size
    if cost.shape != (size, size) or rows.shape != (count, size) or least.shape != most.shape:
        shapes = f"H {cost.shape}, f {linear.shape}, A {rows.shape}, lower {least.shape} and upper {most.shape}"
        raise ValueError(f"the shapes of {shapes} do not match")
    # DAQP ignores rows that are short in the metric of H, and its tolerance is for rows of length one in places.
    length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    length[length == 0.0] = 1.0
    scale = float(cost.trace()) / size
    if not math.isfinite(scale + float(length @ length) + float(linear @ linear)):
        raise ValueError("H, f or A is not finite")
    if scale <= 0.0:
        raise ValueError("H is not positive definite")
    cost, linear, rows = cost / scale, linear / scale, rows / length[:, None]
    least, most = least / length, most / length
    soft = np.empty(0, np.intp)
    if prices is not None:
        cost, linear, rows, soft = _with_slacks(cost, linear, rows, _array(prices) * (length * length / scale))
    if bounds is not None:
        # DAQP takes the limits that exceed the rows for bounds of the first variables.
        least, most = np.concatenate([_array(bounds[0]), least]), np.concatenate([_array(bounds[1]), most])
        if least.shape != (size + count,) or most.shape != least.shape:
            raise ValueError(f"each of the bounds must have {size} values")
    status: Status = "failed"
    if (least <= most).all():
        initial = None if guess is None else _active(guess, least, most, count)
        for sense, violation in ((initial, min(FINE, tolerance)), (None, tolerance)):
            x, _, flag, details = daqp.solve(
                cost,
                linear,
                rows,
                most,
                least,
                sense,
                primal_tol=violation,
                sing_tol=_PARALLEL,
                iter_limit=iterations,
                eps_prox=0.0,
            )
            if flag == _SOLVED:
                status = "solved"
                break
            status = "infeasible" if flag in _INFEASIBLE else "failed"
        if flag == _NOT_CONVEX:
            raise ValueError("H is not positive definite")
    elif np.isnan(least).any() or np.isnan(most).any():
        raise ValueError("a limit is NaN")
    else:
        status = "infeasible"
    if status != "solved":
        return QPSolution(np.full(size, np.nan), status, np.zeros(len(most)), np.zeros(count), 0)
    multipliers = details["lam"] * scale
    multipliers[len(most) - count :] /= length
    if bounds is not None:
        multipliers = np.concatenate([multipliers[size:], multipliers[:size]])
    slacks = np.zeros(count)
    slacks[soft] = x[size:] * length[soft]
    return QPSolution(x[:size], status, multipliers, slacks, int(details["iterations"]))


def conflict(
    A: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[int, ...]:
    """Find out which constraints of an infeasible program contradict each other.

    Solves a program for each constraint, without those that are not needed for the contradiction.

    Args:
        A: As for `solve_qp`, as are all others.
        lower: Shape (m,).
        upper: Shape (m,).
        bounds: Both of shape (n,).
        tolerance: As for `solve_qp`.

    Returns:
        Constraints that no x satisfies together, while some x satisfies them if any one is left out: rows of A in
        ascending order, then m + i for the bounds of the variable i. Empty if all can be satisfied.
    """
    every, least, most = _array(A), _array(lower), _array(upper)
    size = every.shape[1]
    if bounds is not None:
        every = np.concatenate([every, np.eye(size)])
        least, most = np.concatenate([least, _array(bounds[0])]), np.concatenate([most, _array(bounds[1])])
    cost, linear = np.eye(size), np.zeros(size)

    def infeasible(rows: list[int]) -> bool:
        solution = solve_qp(cost, linear, every[rows], least[rows], most[rows], tolerance=tolerance)
        return solution.status == "infeasible"

    needed = list(range(len(every)))
    if not infeasible(needed):
        return ()
    for row in range(len(every)):
        others = [other for other in needed if other != row]
        if infeasible(others):
            needed = others
    return tuple(needed)


def _array(values: ArrayLike) -> Array:
    return np.ascontiguousarray(values, np.float64)


def _with_slacks(H: Array, f: Array, A: Array, prices: Array) -> tuple[Array, Array, Array, Indices]:
    """Add a variable for the slack of each row with a finite price; return these rows as well."""
    if prices.shape != (len(A),) or not (prices > 0.0).all():
        raise ValueError(f"each of the {len(A)} constraints must have a price above 0")
    soft = np.flatnonzero(np.isfinite(prices))
    size, more = len(f), len(soft)
    cost = np.zeros((size + more, size + more))
    cost[:size, :size] = H
    cost[np.arange(size, size + more), np.arange(size, size + more)] = prices[soft]
    rows = np.zeros((len(A), size + more))
    rows[:, :size] = A
    rows[soft, np.arange(size, size + more)] = 1.0
    return cost, np.concatenate([f, np.zeros(more)]), rows, soft


def _active(guess: QPSolution, lower: Array, upper: Array, count: int) -> NDArray[np.intc]:
    """Return the flags of the constraints that are active in another solution, in the order of DAQP."""
    multipliers = np.concatenate([guess.multipliers[count:], guess.multipliers[:count]])
    if multipliers.shape != upper.shape:
        raise ValueError(f"the guess has {len(multipliers)} constraints, and the program {len(upper)}")
    at_upper = (multipliers > 0.0) & np.isfinite(upper)
    at_lower = (multipliers < 0.0) & np.isfinite(lower)
    return (_ACTIVE * at_upper + (_ACTIVE | _AT_LOWER) * at_lower).astype(np.intc)
