"""Optimal control problems: costs and constraints along the motion of a model over a horizon."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.core import Model
from symaware_cli.geometry import Array
from symaware_cli.planning.optimal_control.dynamics import Dynamics
from symaware_cli.world import Integrator


class ProblemParameter(NamedTuple):
    """A quantity whose value is given when the problem is solved."""

    symbol: Any
    shape: tuple[int, ...]
    per_stage: bool


class Cost(NamedTuple):
    """A scalar expression that is summed over stages."""

    expression: Any
    stages: frozenset[int]


class Constraint(NamedTuple):
    """Bounds of a column of expressions at some stages, scaled; soft if it has a penalty."""

    expression: Any
    lower: Array
    upper: Array
    stages: frozenset[int]
    penalty: float | None


class OptimalControlProblem:
    """A cost along the motion of a model over N steps, to be minimised subject to constraints.

    Costs and constraints are CasADi expressions of the symbols of one stage: `state`, `control_input`,
    `previous_input` and the results of `parameter`. They are written once and apply to all stages that are given for
    them. Stages run from 0, the present state, to N; control inputs exist at the stages 0 to N - 1.

    The limits of the model's control input always apply. The present state is given when the problem is solved.

    Attributes:
        dynamics: The dynamics from one stage to the next.
        steps: N.
        state: Symbols of the state; a column of nx.
        control_input: Symbols of the control input; a column of nu.
        previous_input: Symbols of the control input of the previous stage; a column of nu. At stage 0 it is given to
            `solve`. The elements in use are additional states of the program, which keeps the problem stage-wise.
        parameters: The declared parameters by name.
        costs: The costs.
        constraints: The constraints.
        state_bounds: Lower and upper bounds of the state, shape (nx,) each.
        input_bounds: Lower and upper bounds of the control input, shape (nu,) each.
    """

    def __init__(
        self, model: Model, *, steps: int, time_step: float, integrator: Integrator = "exact", substeps: int = 1
    ) -> None:
        """Initialise a problem without costs.

        Args:
            model: The model.
            steps: The number of time steps of the horizon, N.
            time_step: The time from one stage to the next [s].
            integrator: ``exact``, ``rk4`` or ``euler``, as of the kinematic world.
            substeps: The number of parts of a time step for the integrator.

        Raises:
            ValueError: There are no steps, or the integrator is unknown.
        """
        if steps < 1:
            raise ValueError(f"a horizon has at least one step, not {steps}")
        self.dynamics = Dynamics(model, time_step, integrator, substeps)
        self.steps = steps
        self.state = casadi.SX.sym("state", len(model.state))
        self.control_input = casadi.SX.sym("input", len(model.control_input))
        self.previous_input = casadi.SX.sym("previous", len(model.control_input))
        self.parameters: dict[str, ProblemParameter] = {}
        self.costs: list[Cost] = []
        self.constraints: list[Constraint] = []
        count = len(model.state)
        self.state_bounds = np.full(count, -np.inf), np.full(count, np.inf)
        low, high = model.input_bounds()
        self.input_bounds = np.array(low, float), np.array(high, float)
        if _limits_length(model, *self.input_bounds):
            self.add_constraint(casadi.sumsqr(self.control_input / self.input_bounds[1]), upper=1.0)

    @property
    def model(self) -> Model:
        """The model."""
        return self.dynamics.model

    def parameter(self, name: str, shape: int | tuple[int, int] = 1, *, per_stage: bool = False) -> Any:
        """Declare a quantity whose value is given when the problem is solved.

        Args:
            name: Its name for `Solver.solve`.
            shape: Length of a column, or rows and columns of a matrix.
            per_stage: Whether it has a value for each of the N + 1 stages, such as the position of a moving agent.

        Returns:
            Its symbols, of this shape.

        Raises:
            ValueError: The name is taken.
        """
        if name in self.parameters:
            raise ValueError(f"there is a parameter `{name}` already")
        extent = (shape,) if isinstance(shape, int) else tuple(shape)
        symbol = casadi.SX.sym(name, *extent)
        self.parameters[name] = ProblemParameter(symbol, extent, per_stage)
        return symbol

    def add_cost(self, expression: Any, *, stages: Iterable[int] | None = None) -> None:
        """Add a cost.

        Args:
            expression: A scalar of the symbols of a stage.
            stages: The stages that it applies to; 0 to N - 1 by default.

        Raises:
            ValueError: It is no scalar, uses foreign symbols, or a stage does not exist.
        """
        scalar = self._expression(expression)
        if scalar.numel() != 1:
            raise ValueError(f"a cost is a scalar, and this has {scalar.numel()} elements")
        self.costs.append(Cost(scalar, self._stages(stages, range(self.steps), scalar)))

    def add_terminal_cost(self, expression: Any) -> None:
        """Add a cost of the last state, at stage N."""
        self.add_cost(expression, stages=[self.steps])

    def add_constraint(
        self,
        expression: Any,
        lower: ArrayLike = -np.inf,
        upper: ArrayLike = np.inf,
        *,
        stages: Iterable[int] | None = None,
        scale: float = 1.0,
        penalty: float | None = None,
    ) -> None:
        """Add a constraint lower <= expression <= upper.

        Args:
            expression: A column of expressions of the symbols of a stage.
            lower: A number for all rows, or one for each.
            upper: A number for all rows, or one for each; equal to the lower one for an equation.
            stages: The stages that it applies to; by default 0 to N - 1 if it depends on control inputs, and 1 to N
                otherwise, since the present state cannot be changed.
            scale: The divisor that makes it of the order of one for solvers; their tolerance is
                relative to this.
            penalty: The cost of a violation, for each stage and each `scale` of its worst row; None for a hard
                constraint. If a feasible solution exists, a penalty above its multipliers finds it.

        Raises:
            ValueError: It uses foreign symbols, or a stage does not exist.
        """
        column = self._expression(expression).reshape((-1, 1))
        low, high = (np.broadcast_to(np.asarray(each, float) / scale, column.numel()) for each in (lower, upper))
        usual = range(self.steps) if self._needs_input(column) else range(1, self.steps + 1)
        chosen = self._stages(stages, usual, column)
        self.constraints.append(Constraint(column / scale, low, high, chosen, penalty))

    def bound_state(self, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf) -> None:
        """Bound each element of the state at the stages 1 to N; cheaper than a constraint.

        Args:
            lower: A number for all elements, or one for each.
            upper: Likewise.
        """
        low, high = self.state_bounds
        self.state_bounds = np.maximum(low, lower), np.minimum(high, upper)

    def bound_input(self, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf) -> None:
        """Bound each element of the control input, in addition to the model's own limits.

        Args:
            lower: A number for all elements, or one for each.
            upper: Likewise.
        """
        low, high = self.input_bounds
        self.input_bounds = np.maximum(low, lower), np.minimum(high, upper)

    def _needs_input(self, expression: Any) -> bool:
        return bool(casadi.depends_on(expression, self.control_input))

    def _stages(self, stages: Iterable[int] | None, usual: range, expression: Any) -> frozenset[int]:
        chosen = frozenset(usual if stages is None else stages)
        last = self.steps - 1 if self._needs_input(expression) else self.steps
        if not chosen <= frozenset(range(last + 1)):
            raise ValueError(f"this applies to the stages 0 to {last} only, not to {max(chosen, key=abs)}")
        return chosen

    def _expression(self, expression: Any) -> Any:
        """Return the expression as a matrix, all of whose symbols belong to the problem."""
        matrix = casadi.SX(expression)
        given = [parameter.symbol for parameter in self.parameters.values()]
        own = casadi.veccat(self.state, self.control_input, self.previous_input, *given)
        known = {each.element_hash() for each in casadi.symvar(own)}
        foreign = sorted(str(each) for each in casadi.symvar(matrix) if each.element_hash() not in known)
        if foreign:
            raise ValueError(f"the problem has no symbol {foreign[0]}; declare it as a parameter")
        return matrix


def _limits_length(model: Model, low: Array, high: Array) -> bool:
    """Return whether a model limits the length of its scaled control input, and not only its elements.

    A model does not declare this; it follows from how `limit` changes the corners of the box.
    """
    if not (np.isfinite(high).all() and (high > 0.0).all() and (low == -high).all()):
        return False
    limited = model.limit(np.stack([high, low])) / high
    return len(high) > 1 and bool(np.allclose((limited * limited).sum(axis=1), 1.0))
