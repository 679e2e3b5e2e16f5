"""Direct multiple shooting: from an optimal control problem to a nonlinear program that keeps its stages apart.

The variables of stage k are its state, what is carried of the previous control input, its control input and its slacks;
its constraints are the motion to stage k + 1, then (at stage 0) the present state, then all others. This order is what
solvers need that exploit the structure (H. G. Bock, K. J. Plitt, "A multiple shooting algorithm for direct solution of
optimal control problems", IFAC World Congress 1984; L. Vanroye, A. Sathya, J. De Schutter, W. Decré, "FATROP: a fast
constrained optimal control problem solver for robot trajectory optimization and control", IROS 2023).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from symaware_cli.optimal_control.optimal_control_problem import OptimalControlProblem

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass
class Stack:
    """Expressions on top of each other, with a lower and an upper bound for each."""

    expressions: list[Any] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)

    def put(self, expression: Any, lower: Iterable[float], upper: Iterable[float]) -> Indices:
        """Add a column, and return where it stands."""
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
        nlp: The program as CasADi wants it: ``x``, ``p``, ``f``, ``g``. Its parameters are the present state, what is
            carried into stage 0, then those of the problem, stage after stage, each column by column.
        variables: Bounds of the variables, two arrays of shape (nv,).
        constraints: Bounds of the constraints, two arrays of shape (ng,).
        states: Where the states stand among the variables; shape (N + 1, nx).
        inputs: Where the control inputs stand; shape (N, nu).
        carried: Where what is carried of the previous control input stands; shape (N + 1, nc).
        carried_inputs: Which of its elements are carried; shape (nc,).
        slacks: Where the slacks of soft constraints stand; shape (ns,).
        state_sizes: How many states each stage has, with what is carried.
        input_sizes: How many control inputs, with slacks.
        constraint_sizes: How many constraints, the motion left out.
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
    """The symbols of one stage, and where they stand."""

    state: Any
    carried: Any
    control_input: Any
    previous_input: Any
    slacks: dict[int, Any]
    places: dict[str, Indices]

    @property
    def input_size(self) -> int:
        return len(self.places["input"]) + len(self.slacks)


def transcribe(problem: OptimalControlProblem, cost_scale: float) -> Program:
    """Write a problem as a program.

    Args:
        problem: What to write.
        cost_scale: What the cost is multiplied by.
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
            constraints.put(gap, *_nothing(gap.numel()))
        before = len(constraints)
        if k == 0:
            constraints.put(casadi.vertcat(stage.state, stage.carried) - start, *_nothing(start.numel()))
        for number, (each, function) in enumerate(demands):
            if k not in each.stages:
                continue
            value = function(*arguments)
            if each.penalty is None:
                constraints.put(value, each.lower, each.upper)
            else:
                total += each.penalty * stage.slacks[number]
                _put_softly(constraints, value, stage.slacks[number], each.lower, each.upper)
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
        states=np.array([stage.places["state"] for stage in stages]),
        inputs=np.array([stage.places["input"] for stage in stages[:-1]]),
        carried=np.array([stage.places["carried"] for stage in stages]),
        carried_inputs=carried_inputs,
        slacks=np.concatenate([stage.places["slacks"] for stage in stages]),
        state_sizes=[nx + len(carried_inputs)] * (steps + 1),
        input_sizes=[stage.input_size for stage in stages],
        constraint_sizes=sizes,
    )


def _used(problem: OptimalControlProblem) -> Indices:
    """Which elements of the previous control input anything depends on."""
    every = [each.expression for each in problem.costs] + [each.expression for each in problem.constraints]
    expressions = casadi.veccat(*every)
    if not expressions.numel():
        return np.empty(0, np.intp)
    return np.flatnonzero(casadi.which_depends(expressions, problem.previous_input, 1, False))


def _stage(problem: OptimalControlProblem, k: int, carried_inputs: Indices, variables: Stack) -> _Stage:
    """Declare the variables of a stage."""
    nx, nu, nc = problem.state.numel(), problem.control_input.numel(), len(carried_inputs)
    places = {}

    def declare(name: str, lower: list[float] | Array, upper: list[float] | Array) -> Any:
        symbols = casadi.SX.sym(name, len(lower))
        places[name] = variables.put(symbols, lower, upper)
        return symbols

    # The present state is given by an equation, whatever its bounds: there is nothing left to decide about it.
    state = declare("state", *(problem.state_bounds if k else _anything(nx)))
    carried = declare("carried", *_anything(nc))
    at_end = k == problem.steps
    control_input = declare("input", *(_nothing(0) if at_end else problem.input_bounds))
    soft = [n for n, each in enumerate(problem.constraints) if each.penalty is not None and k in each.stages]
    slacks = declare("slacks", [0.0] * len(soft), [np.inf] * len(soft))
    previous = casadi.SX(nu, 1)
    previous[carried_inputs.tolist()] = carried
    return _Stage(
        state,
        carried,
        casadi.SX(nu, 1) if at_end else control_input,
        previous,
        {number: slacks[place] for place, number in enumerate(soft)},
        places,
    )


def _put_softly(constraints: Stack, value: Any, slack: Any, lower: Array, upper: Array) -> None:
    """Demand lower - slack <= value <= upper + slack, one side after the other."""
    for sign, bound in ((1.0, lower), (-1.0, upper)):
        rows = np.flatnonzero(np.isfinite(bound)).tolist()
        if rows:
            constraints.put(sign * value[rows] + slack, sign * bound[rows], [np.inf] * len(rows))


def _nothing(count: int) -> tuple[list[float], list[float]]:
    return [0.0] * count, [0.0] * count


def _anything(count: int) -> tuple[list[float], list[float]]:
    return [-np.inf] * count, [np.inf] * count
