"""Direct multiple shooting: transcribes an optimal control problem to a nonlinear program with stage structure.

The variables of stage k are its state, the carried elements of the previous control input, its control input and its
slacks; its constraints are the dynamics to stage k + 1, then (at stage 0) the present state, then all others. Solvers
that exploit the structure need this order (H. G. Bock, K. J. Plitt, "A multiple shooting algorithm for direct solution
of optimal control problems", IFAC World Congress 1984; L. Vanroye, A. Sathya, J. De Schutter, W. Decré, "FATROP: a fast
constrained optimal control problem solver for robot trajectory optimization and control", IROS 2023).

Reasons: docs/decisions/0012-optimal-control.md
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np

from symaware_cli.geometry import Array, Indices
from symaware_cli.planning.optimal_control.optimal_control_problem import OptimalControlProblem


@dataclass
class Stack:
    """A column of expressions with a lower and an upper bound for each."""

    expressions: list[Any] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)

    def put(self, expression: Any, lower: Iterable[float], upper: Iterable[float]) -> Indices:
        """Append a column, and return its indices."""
        first = len(self.lower)
        self.expressions.append(expression)
        self.lower.extend(lower)
        self.upper.extend(upper)
        return np.arange(first, len(self.lower))

    def __len__(self) -> int:
        return len(self.lower)


@dataclass(frozen=True)
class Program:
    """A nonlinear program, stage by stage.

    Attributes:
        nlp: The program for CasADi: ``x``, ``p``, ``f``, ``g``. Its parameters are the present state, the carried
            elements at stage 0, then those of the problem, stage after stage, each in columns.
        variables: Bounds of the variables, two arrays of shape (nv,).
        constraints: Bounds of the constraints, two arrays of shape (ng,).
        states: Indices of the states among the variables; shape (N + 1, nx).
        inputs: Indices of the control inputs; shape (N, nu).
        carried: Indices of the carried elements of the previous control input; shape (N + 1, nc).
        carried_inputs: The elements of the control input that are carried; shape (nc,).
        slacks: Indices of the slacks of soft constraints; shape (ns,).
        state_sizes: The number of states of each stage, including carried elements.
        input_sizes: The number of control inputs of each stage, including slacks.
        constraint_sizes: The number of constraints of each stage, without the dynamics.
    """

    nlp: dict[str, Any]
    variables: tuple[Array, Array]
    constraints: tuple[Array, Array]
    states: Indices
    inputs: Indices
    carried: Indices
    carried_inputs: Indices
    slacks: Indices
    state_sizes: list[int]
    input_sizes: list[int]
    constraint_sizes: list[int]


@dataclass
class _Stage:
    """The symbols of one stage, and their indices."""

    state: Any
    carried: Any
    control_input: Any
    previous_input: Any
    slacks: dict[int, Any]
    indices: dict[str, Indices]

    @property
    def input_size(self) -> int:
        return len(self.indices["input"]) + len(self.slacks)


def transcribe(problem: OptimalControlProblem, cost_scale: float) -> Program:
    """Transcribe a problem.

    Args:
        problem: The problem.
        cost_scale: The factor of the cost.
    """
    steps, nx = problem.steps, problem.state.numel()
    carried_inputs = _used(problem)
    variables, constraints = Stack(), Stack()
    stages = [_stage(problem, k, carried_inputs, variables) for k in range(steps + 1)]
    start = casadi.SX.sym("start", nx + len(carried_inputs))
    columns = [
        [casadi.SX.sym(name, *each.shape) for _ in range(steps + 1 if each.per_stage else 1)]
        for name, each in problem.parameters.items()
    ]
    symbols = [problem.state, problem.control_input, problem.previous_input]
    symbols += [each.symbol for each in problem.parameters.values()]

    def of_stage(expression: Any) -> casadi.Function:
        return casadi.Function("stage", symbols, [expression])

    motion = of_stage(problem.dynamics.symbolic(problem.state, problem.control_input))
    costs = [(each, of_stage(each.expression)) for each in problem.costs]
    demands = [(each, of_stage(each.expression)) for each in problem.constraints]
    total: Any = casadi.SX(0)
    sizes = []
    for k, stage in enumerate(stages):
        given = [column[min(k, len(column) - 1)] for column in columns]
        arguments = [stage.state, stage.control_input, stage.previous_input, *given]
        if k < steps:
            following = casadi.vertcat(motion(*arguments), *(stage.control_input[n] for n in carried_inputs.tolist()))
            gap = casadi.vertcat(stages[k + 1].state, stages[k + 1].carried) - following
            constraints.put(gap, *_zeros(gap.numel()))
        before = len(constraints)
        if k == 0:
            constraints.put(casadi.vertcat(stage.state, stage.carried) - start, *_zeros(start.numel()))
        for number, (each, function) in enumerate(demands):
            if k not in each.stages:
                continue
            value = function(*arguments)
            if each.penalty is None:
                constraints.put(value, each.lower, each.upper)
            else:
                total += each.penalty * stage.slacks[number]
                _put_soft(constraints, value, stage.slacks[number], each.lower, each.upper)
        sizes.append(len(constraints) - before)
        total += sum(function(*arguments) for each, function in costs if k in each.stages)
    return Program(
        nlp={
            "x": casadi.vertcat(*variables.expressions),
            "p": casadi.veccat(start, *(symbol for column in columns for symbol in column)),
            "f": cost_scale * total,
            "g": casadi.vertcat(*constraints.expressions),
        },
        variables=(np.array(variables.lower), np.array(variables.upper)),
        constraints=(np.array(constraints.lower), np.array(constraints.upper)),
        states=np.array([stage.indices["state"] for stage in stages]),
        inputs=np.array([stage.indices["input"] for stage in stages[:-1]]),
        carried=np.array([stage.indices["carried"] for stage in stages]),
        carried_inputs=carried_inputs,
        slacks=np.concatenate([stage.indices["slacks"] for stage in stages]),
        state_sizes=[nx + len(carried_inputs)] * (steps + 1),
        input_sizes=[stage.input_size for stage in stages],
        constraint_sizes=sizes,
    )


def _used(problem: OptimalControlProblem) -> Indices:
    """Return the elements of the previous control input that any expression depends on."""
    every = [each.expression for each in problem.costs] + [each.expression for each in problem.constraints]
    expressions = casadi.veccat(*every)
    if not expressions.numel():
        return np.empty(0, np.intp)
    return np.flatnonzero(casadi.which_depends(expressions, problem.previous_input, 1, False))


def _stage(problem: OptimalControlProblem, k: int, carried_inputs: Indices, variables: Stack) -> _Stage:
    """Declare the variables of a stage."""
    nx, nu, nc = problem.state.numel(), problem.control_input.numel(), len(carried_inputs)
    indices = {}

    def declare(name: str, lower: list[float] | Array, upper: list[float] | Array) -> Any:
        symbols = casadi.SX.sym(name, len(lower))
        indices[name] = variables.put(symbols, lower, upper)
        return symbols

    # The present state is given by an equation, so its bounds have no effect.
    state = declare("state", *(problem.state_bounds if k else _unbounded(nx)))
    carried = declare("carried", *_unbounded(nc))
    at_end = k == problem.steps
    control_input = declare("input", *(_zeros(0) if at_end else problem.input_bounds))
    soft = [n for n, each in enumerate(problem.constraints) if each.penalty is not None and k in each.stages]
    slacks = declare("slacks", [0.0] * len(soft), [np.inf] * len(soft))
    previous = casadi.SX(nu, 1)
    previous[carried_inputs.tolist()] = carried
    return _Stage(
        state,
        carried,
        casadi.SX(nu, 1) if at_end else control_input,
        previous,
        {number: slacks[index] for index, number in enumerate(soft)},
        indices,
    )


def _put_soft(constraints: Stack, value: Any, slack: Any, lower: Array, upper: Array) -> None:
    """Add the constraints lower - slack <= value <= upper + slack."""
    for sign, bound in ((1.0, lower), (-1.0, upper)):
        rows = np.flatnonzero(np.isfinite(bound)).tolist()
        if rows:
            constraints.put(sign * value[rows] + slack, sign * bound[rows], [np.inf] * len(rows))


def _zeros(count: int) -> tuple[list[float], list[float]]:
    return [0.0] * count, [0.0] * count


def _unbounded(count: int) -> tuple[list[float], list[float]]:
    return [-np.inf] * count, [np.inf] * count
