"""Mixed-integer linear programs, built row by row and solved by HiGHS, with the same result on every run.

It needs ``highspy`` (the extra ``milp``), which is imported when a program is solved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.geometry import Array, Indices, Mask

#: How a solver ended: the ``gap`` tells how far from the optimum the best solution may be.
Status = Literal["optimal", "node limit", "infeasible", "unbounded", "failed"]

#: By how much rows may be violated, and integers differ from whole numbers.
_TOLERANCE = 1e-9

#: How often tangents are added at most.
_CUTS = 50


@dataclass(frozen=True, slots=True, eq=False)
class MixedIntegerSolution:
    """The result of a solver.

    Attributes:
        status: ``optimal`` (within the gap that was asked for), ``node limit``, ``infeasible``, ``unbounded`` or
            ``failed``.
        values: The values of the variables of the best solution; None if none was found.
        cost: Its cost; infinity without a solution.
        bound: No solution has a smaller cost.
        nodes: The nodes of the tree that were explored.
    """

    status: Status
    values: Array | None
    cost: float
    bound: float
    nodes: int

    @property
    def gap(self) -> float:
        """How much smaller the cost of the optimum may be, in the unit of the cost; infinite without a solution."""
        return max(0.0, self.cost - self.bound) if self.values is not None else np.inf


class MixedIntegerProgram:
    """Minimises a linear cost, subject to linear constraints, over real and integer variables.

    Squares of variables may be added to the cost. They are approximated from below by tangents, and exact once the
    integers are fixed: see `refined`.
    """

    def __init__(self) -> None:
        """Start without variables."""
        self._lower: list[Array] = []
        self._upper: list[Array] = []
        self._cost: list[Array] = []
        self._integer: list[Mask] = []
        self._count = 0
        self._starts: list[int] = [0]
        self._columns: list[int] = []
        self._coefficients: list[float] = []
        self._row_lower: list[float] = []
        self._row_upper: list[float] = []
        self._extra_cost: list[tuple[int, float]] = []
        #: Of each square: the variable, the weight, and the variable that is at least the square.
        self._squares: list[tuple[int, float, int]] = []

    @property
    def variables(self) -> int:
        """The number of variables."""
        return self._count

    @property
    def rows(self) -> int:
        """The number of rows."""
        return len(self._row_lower)

    @property
    def entries(self) -> int:
        """The number of coefficients in the rows."""
        return len(self._coefficients)

    @property
    def has_squares(self) -> bool:
        """Whether squares are part of the cost."""
        return bool(self._squares)

    @property
    def integers(self) -> Indices:
        """The variables that are whole numbers."""
        return np.flatnonzero(self._joined(self._integer, bool))

    def add_variables(
        self,
        count: int,
        lower: ArrayLike = -np.inf,
        upper: ArrayLike = np.inf,
        cost: ArrayLike = 0.0,
        integer: bool = False,
    ) -> Indices:
        """Add variables with bounds and costs, one for all or one each; return their indices."""
        for store, given in ((self._lower, lower), (self._upper, upper), (self._cost, cost)):
            store.append(np.full(count, given, float))
        self._integer.append(np.full(count, integer))
        self._count += count
        return np.arange(self._count - count, self._count)

    def add_row(
        self, variables: Sequence[int], coefficients: Sequence[float], lower: float = -np.inf, upper: float = np.inf
    ) -> None:
        """Require that a sum of variables, each times a coefficient, lies between two bounds."""
        for variable, coefficient in zip(variables, coefficients, strict=True):
            if coefficient != 0.0:
                self._columns.append(variable)
                self._coefficients.append(coefficient)
        self._starts.append(len(self._columns))
        self._row_lower.append(lower)
        self._row_upper.append(upper)

    def add_cost(self, variables: Sequence[int], coefficients: Sequence[float]) -> None:
        """Add a linear cost."""
        self._extra_cost += zip(map(int, variables), map(float, coefficients), strict=True)

    def add_square(self, variable: int, weight: float, least: float, greatest: float, tangents: int = 9) -> None:
        """Add the square of a variable to the cost.

        Args:
            variable: The variable.
            weight: The weight of its square, not negative.
            least: The least value of the variable; both must be finite.
            greatest: The greatest.
            tangents: The number of tangents, evenly spaced; the error is at most the square of their distance over 4.
        """
        if weight == 0.0:
            return
        if not (np.isfinite(least) and np.isfinite(greatest)):
            raise ValueError("the tangents of a square need bounds of the variable")
        (square,) = self.add_variables(1, 0.0, np.inf, weight).tolist()
        for place in np.linspace(least, greatest, tangents).tolist():
            self.add_row([square, variable], [1.0, -2.0 * place], lower=-place * place)
        self._squares.append((variable, weight, square))

    def solve(self, *, nodes: int = 10_000, gap: float = 1e-6, start: Array | None = None) -> MixedIntegerSolution:
        """Solve the program; one thread, and no limit of time, so that equal programs have equal solutions.

        Args:
            nodes: The greatest number of nodes of the tree.
            gap: The gap at which a solution counts as optimal, in the unit of the cost.
            start: Values of the variables `integers` to begin with; without effect if they turn out to be infeasible.
        """
        return self._run(nodes, gap, start, None)

    def refined(self, integers: Array, tolerance: float = 1e-7) -> MixedIntegerSolution:
        """Solve the program with the values of its integer variables given, and with exact squares.

        Tangents are added where the solution is until they are as good as the squares: J. E. Kelley, "The cutting-plane
        method for solving convex programs", Journal of SIAM 8, 1960.

        Args:
            integers: The values of the variables `integers`.
            tolerance: By how much the cost of the squares may exceed that of the tangents.
        """
        return self._run(1, 0.0, None, integers, tolerance)

    def _run(
        self, nodes: int, gap: float, start: Array | None, fixed: Array | None, tolerance: float = 0.0
    ) -> MixedIntegerSolution:
        import highspy

        cost = self._joined(self._cost)
        for variable, coefficient in self._extra_cost:
            cost[variable] += coefficient
        lower, upper = self._joined(self._lower), self._joined(self._upper)
        integers = self.integers
        if fixed is not None:
            lower[integers] = upper[integers] = np.round(fixed)
        program = highspy.HighsLp()
        program.num_col_, program.num_row_ = self._count, self.rows
        program.col_cost_, program.col_lower_, program.col_upper_ = cost, lower, upper
        program.row_lower_, program.row_upper_ = np.array(self._row_lower), np.array(self._row_upper)
        matrix = program.a_matrix_
        matrix.format_ = highspy.MatrixFormat.kRowwise
        matrix.num_col_, matrix.num_row_ = self._count, self.rows
        matrix.start_ = np.array(self._starts, np.int32)
        matrix.index_ = np.array(self._columns, np.int32)
        matrix.value_ = np.array(self._coefficients, float)
        is_mixed = fixed is None and len(integers) > 0
        if is_mixed:
            kinds = [highspy.HighsVarType.kContinuous] * self._count
            for integer in integers.tolist():
                kinds[integer] = highspy.HighsVarType.kInteger
            program.integrality_ = kinds
        # The base class of `highspy.Highs`, which prints a banner when it is created.
        solver: Any = highspy._Highs()  # type: ignore[attr-defined] # which its stubs leave out
        for option, value in (
            ("output_flag", False),
            ("threads", 1),
            ("parallel", "off"),
            ("random_seed", 0),
            ("mip_max_nodes", nodes),
            ("mip_rel_gap", 0.0),
            ("mip_abs_gap", gap),
            ("mip_feasibility_tolerance", _TOLERANCE),
            ("primal_feasibility_tolerance", _TOLERANCE),
        ):
            solver.setOptionValue(option, value)
        solver.passModel(program)
        if is_mixed and start is not None:
            solver.setSolution(len(integers), integers.astype(np.int32), np.round(start))
        if solver.run() == highspy.HighsStatus.kError:
            # A process has one scheduler, whose number of threads is that of whoever solved first, such as a plugin.
            solver.resetGlobalScheduler(True)
            solver.run()
        solution = self._solution(solver, is_mixed=is_mixed)
        if fixed is not None and self._squares:
            for _ in range(_CUTS):
                if solution.values is None or not self._cut(solver, solution.values, tolerance):
                    break
                solver.run()
                solution = self._solution(solver, is_mixed=is_mixed)
        return solution

    def _cut(self, solver: Any, values: Array, tolerance: float) -> bool:
        """Add tangents where values of variables are, unless squares exceed their tangents by less than a tolerance."""
        places = np.array([variable for variable, _, _ in self._squares])
        squares = np.array([square for _, _, square in self._squares])
        weights = np.array([weight for _, weight, _ in self._squares])
        excess = weights * (values[places] ** 2 - values[squares])
        if excess.sum() <= tolerance:
            return False
        chosen = np.flatnonzero(excess > 0.1 * tolerance / len(places))
        at, count = values[places[chosen]], len(chosen)
        solver.addRows(
            count,
            -at * at,
            np.full(count, np.inf),
            2 * count,
            np.arange(0, 2 * count, 2, dtype=np.int32),
            np.stack([squares[chosen], places[chosen]], axis=1).ravel().astype(np.int32),
            np.stack([np.ones(count), -2.0 * at], axis=1).ravel(),
        )
        return True

    def _solution(self, solver: Any, *, is_mixed: bool) -> MixedIntegerSolution:
        import highspy

        ended, info = solver.getModelStatus(), solver.getInfo()
        statuses: dict[Any, Status] = {
            highspy.HighsModelStatus.kOptimal: "optimal",
            highspy.HighsModelStatus.kInfeasible: "infeasible",
            highspy.HighsModelStatus.kUnbounded: "unbounded",
        }
        if is_mixed:
            limits = (highspy.HighsModelStatus.kSolutionLimit, highspy.HighsModelStatus.kIterationLimit)
            statuses |= dict.fromkeys(limits, "node limit")
        status = statuses.get(ended, "failed")
        nodes = max(0, int(info.mip_node_count)) if is_mixed else 0
        feasible = info.primal_solution_status == int(highspy.SolutionStatus.kSolutionStatusFeasible)
        if status not in ("optimal", "node limit") or not feasible:
            bound = float(info.mip_dual_bound) if is_mixed and status == "node limit" else -np.inf
            return MixedIntegerSolution(status, None, np.inf, bound, nodes)
        cost = float(info.objective_function_value)
        values = np.array(solver.getSolution().col_value)
        return MixedIntegerSolution(status, values, cost, float(info.mip_dual_bound) if is_mixed else cost, nodes)

    @staticmethod
    def _joined(parts: Sequence[NDArray[Any]], kind: Any = float) -> NDArray[Any]:
        return np.concatenate(parts).astype(kind) if parts else np.zeros(0, kind)
