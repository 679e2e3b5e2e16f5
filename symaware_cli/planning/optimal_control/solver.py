"""Solvers of optimal control problems, with a budget of iterations, and the plans that result."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, ClassVar

import casadi
import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.core import TimeSeries
from symaware_cli.geometry import Array
from symaware_cli.planning.optimal_control.dynamics import Dynamics
from symaware_cli.planning.optimal_control.optimal_control_problem import OptimalControlProblem
from symaware_cli.planning.optimal_control.transcription import Program, transcribe
from symaware_cli.world import SECOND


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Control inputs over a horizon and the states they lead to.

    Attributes:
        states: The states at the stages 0 to N; shape (N + 1, nx).
        inputs: The control inputs, held over the steps 0 to N - 1; shape (N, nu).
        dynamics: The dynamics from one state to the next.
        left: The number of inputs that a solver chose; the others repeat the last of them.
    """

    states: Array
    inputs: Array
    dynamics: Dynamics = field(repr=False)
    left: int

    def shifted(self, steps: int = 1) -> Plan:
        """Return the rest of the plan after some steps, with its last input held; the usual warm start."""
        steps = min(steps, len(self.inputs))
        held = np.repeat(self.inputs[-1:], steps, axis=0)
        added = self.dynamics.rollout(self.states[-1], held)[1:]
        return Plan(
            np.concatenate([self.states[steps:], added]),
            np.concatenate([self.inputs[steps:], held]),
            self.dynamics,
            max(self.left - steps, 0),
        )

    def intent(self, now: int) -> TimeSeries:
        """Return the positions as a time series, the form of an intent.

        Args:
            now: Simulated time of stage 0, in nanoseconds.
        """
        offsets = np.round(np.arange(len(self.states)) * (self.dynamics.step * SECOND)).astype(np.int64)
        return TimeSeries.sampled(now + offsets, self.dynamics.model.positions(self.states))


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The result of a solver.

    Attributes:
        plan: The last iterate; a plan to follow only if `solved`.
        solved: Whether it is a solution within the tolerance.
        cost: The cost in the units of the problem, including penalties of soft constraints.
        infeasibility: The greatest violation of a hard constraint, dynamics included, in scaled units.
        violation: The greatest violation of a soft constraint, in its scaled units; 0 without any.
        solver: The solver that succeeded, or was tried last.
        status: ``solved``, ``out of iterations``, or the status that the solver returned.
        iterations: The total number of iterations of all solvers.
        wall_time: The wall time [s]; it varies, so nothing in a run may depend on it.
    """

    plan: Plan
    solved: bool
    cost: float
    infeasibility: float
    violation: float
    solver: str
    status: str
    iterations: int
    wall_time: float


@dataclass(frozen=True, slots=True, eq=False)
class PlanDecision:
    """The plan to follow, whether or not a solver found a new one.

    Attributes:
        plan: The new plan, else the rest of the previous one, else None if that is used up.
        solution: The result of the solver.
    """

    plan: Plan | None
    solution: Solution

    @property
    def fallen_back(self) -> bool:
        """Whether there is no new plan."""
        return not self.solution.solved


class Solver:
    """Solves a problem repeatedly, for different states and parameters.

    Building it takes a while, but one solver serves any number of agents: no solution influences the next, except by
    the guess that is passed.
    """

    #: A solver has no state between calls: the initial guess is passed each time.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(
        self,
        problem: OptimalControlProblem,
        solvers: Sequence[str] = ("fatrop", "ipopt"),
        *,
        iterations: int = 200,
        tolerance: float = 1e-6,
        barrier: float | None = None,
        cost_scale: float = 1.0,
        options: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        """Build the program; later changes of the problem have no effect.

        Args:
            problem: The problem to solve.
            solvers: Names of CasADi's solvers; each is tried if the previous one failed. Solvers other than ``fatrop``
                and ``ipopt`` need their budget in `options`.
            iterations: The budget of each solver for each guess. It bounds the computation time, with the same result
                on a slow machine.
            tolerance: The tolerance for the scaled problem.
            barrier: The initial barrier parameter of interior-point methods; small values exploit a good guess.
            cost_scale: The factor that makes the cost of the order of one for solvers.
            options: Further options of CasADi by solver.

        Raises:
            ValueError: No solver is named, or CasADi does not have one.
        """
        if not solvers:
            raise ValueError("at least one solver must be named")
        self.program: Program = transcribe(problem, cost_scale)
        self._dynamics, self._input_bounds = problem.dynamics, problem.input_bounds
        self._declared = dict(problem.parameters)
        self._cost_scale = cost_scale
        self._iterations = iterations
        usual = _options(self.program, iterations, tolerance, barrier)
        self._solvers: dict[str, Any] = {}
        for name in solvers:
            if not casadi.has_nlpsol(name):
                raise ValueError(f"CasADi has no solver `{name}` here")
            chosen = {**usual[""], **usual.get(name, {}), **(options or {}).get(name, {})}
            self._solvers[name] = casadi.nlpsol("program", name, self.program.nlp, chosen)
        # Converted once, as they never change.
        (low, high), (least, most) = self.program.variables, self.program.constraints
        bounds = {"lbx": low, "ubx": high, "lbg": least, "ubg": most}
        self._bounds = {name: casadi.DM(values) for name, values in bounds.items()}

    @property
    def steps(self) -> int:
        """The number of steps of the horizon, N."""
        return len(self.program.inputs)

    def solve(
        self,
        state: ArrayLike,
        parameters: Mapping[str, ArrayLike] | None = None,
        *,
        previous_input: ArrayLike | None = None,
        guess: Plan | None = None,
        alternatives: Iterable[Plan] = (),
    ) -> Solution:
        """Solve the problem from a state.

        Args:
            state: The present state; shape (nx,).
            parameters: A value of each declared parameter, of its shape. Values for each stage have the stages first,
                (N + 1, ...); a single value applies to all of them.
            previous_input: The control input before stage 0, shape (nu,); zero by default.
            guess: The initial guess, such as ``plan.shifted()``; by default the smallest control input.
            alternatives: Further guesses that the first solver tries in order if it fails, before other solvers are
                tried: a program that is not convex may have solutions that are not found from the first guess. They are
                evaluated only when needed.

        Returns:
            The result; failure of the solvers raises no exception. If all fail it is the last result from the guess.

        Raises:
            ValueError: The state or a parameter is missing, has another shape or is not finite.
        """
        began = time.perf_counter()
        program, model = self.program, self._dynamics.model
        present = _checked("the state", state, (len(model.state),))
        before = _checked(
            "the previous input",
            np.zeros(len(model.control_input)) if previous_input is None else previous_input,
            (len(model.control_input),),
        )
        values = np.concatenate([present, before[program.carried_inputs], *self._values(parameters or {})])
        first = self.rollout(present) if guess is None else guess
        foremost, *further = self._solvers
        attempts = chain(
            [(first, foremost)], ((other, foremost) for other in alternatives), ((first, name) for name in further)
        )
        iterations, best = 0, None
        for begin, name in attempts:
            found, success, status, count = self._attempt(name, self._start(present, before, begin), values)
            iterations += count
            point = np.array(found["x"]).ravel()
            solved = success and bool(np.isfinite(point).all())
            if solved or begin is first:
                best = found, point, solved, name, status
            if solved:
                break
        assert best is not None
        found, point, solved, name, status = best
        inputs = np.clip(point[program.inputs], *self._input_bounds)  # solvers relax bounds by their tolerance
        return Solution(
            plan=Plan(point[program.states], inputs, self._dynamics, self.steps),
            solved=solved,
            cost=float(found["f"]) / self._cost_scale,
            infeasibility=self._infeasibility(found),
            violation=float(np.max(point[program.slacks], initial=0.0)),
            solver=name,
            status=status,
            iterations=iterations,
            wall_time=time.perf_counter() - began,
        )

    def replan(
        self,
        state: ArrayLike,
        parameters: Mapping[str, ArrayLike] | None = None,
        *,
        previous_input: ArrayLike | None = None,
        rest: Plan | None = None,
    ) -> PlanDecision:
        """Solve the problem, and fall back to the rest of the previous plan if this fails.

        Args:
            state: As for `solve`.
            parameters: As for `solve`.
            previous_input: As for `solve`.
            rest: The rest of the previous plan, ``plan.shifted()``; also the guess.
        """
        solution = self.solve(state, parameters, previous_input=previous_input, guess=rest)
        if solution.solved:
            return PlanDecision(solution.plan, solution)
        return PlanDecision(rest if rest is not None and rest.left else None, solution)

    def rollout(self, state: ArrayLike, inputs: ArrayLike | None = None) -> Plan:
        """Return the motion under given control inputs, as a first guess.

        Args:
            state: The present state; shape (nx,).
            inputs: Shape (N, nu), or (nu,) for a constant; the smallest allowed by default.
        """
        held = np.clip(0.0, *self._input_bounds) if inputs is None else np.asarray(inputs, float)
        sequence = np.broadcast_to(held, (self.steps, len(self._dynamics.model.control_input))).copy()
        return Plan(self._dynamics.rollout(state, sequence), sequence, self._dynamics, 0)

    def _start(self, present: Array, before: Array, guess: Plan) -> Array:
        """Return the initial values of the variables; shape (nv,)."""
        program = self.program
        start = np.zeros(len(program.variables[0]))
        start[program.states] = guess.states
        start[program.states[0]] = present
        start[program.inputs] = guess.inputs
        start[program.carried] = np.concatenate([before[None], guess.inputs])[:, program.carried_inputs]
        return start

    def _attempt(self, name: str, start: Array, values: Array) -> tuple[Mapping[str, Any], bool, str, int]:
        """Run one solver, and return its result, whether it succeeded, its status, and its number of iterations."""
        solver = self._solvers[name]
        found = solver(x0=start, p=values, **self._bounds)
        statistics = solver.stats()
        count, success = int(statistics.get("iter_count", 0)), bool(statistics["success"])
        message = str(statistics["return_status"]).replace("_", " ").lower()
        if success:
            status = "solved"
        elif count >= self._iterations:
            status = "out of iterations"
        else:
            # FATROP returns a number if it fails.
            status = "no solution found" if message.lstrip("-").isdigit() else message
        return found, success, status, count

    def _values(self, parameters: Mapping[str, ArrayLike]) -> list[Array]:
        """Return the values of the parameters in the order of the program."""
        unknown = sorted(parameters.keys() - self._declared.keys())
        if unknown:
            raise ValueError(f"the problem has no parameter `{unknown[0]}`")
        values = []
        for name, declared in self._declared.items():
            if name not in parameters:
                raise ValueError(f"the parameter `{name}` is missing")
            value, shape = np.asarray(parameters[name], float), declared.shape
            if value.ndim == 0 and shape == (1,):
                value = value.reshape(1)
            if declared.per_stage:
                shape = (self.steps + 1, *shape)
                if value.shape == shape[1:]:
                    value = np.broadcast_to(value, shape)
            value = _checked(f"the parameter `{name}`", value, shape)
            # CasADi stores matrices in columns.
            values.append((np.swapaxes(value, -1, -2) if len(declared.shape) == 2 else value).ravel())
        return values

    def _infeasibility(self, found: Mapping[str, Any]) -> float:
        worst = 0.0
        for key, (low, high) in (("x", self.program.variables), ("g", self.program.constraints)):
            value = np.array(found[key]).ravel()
            worst = max(worst, np.max(low - value, initial=0.0), np.max(value - high, initial=0.0))
        return float(worst)


def _checked(what: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.asarray(value, float)
    if array.shape != shape:
        raise ValueError(f"{what} has the shape {array.shape}, and {shape} is needed")
    if not np.isfinite(array).all():
        raise ValueError(f"{what} is not finite")
    return array


def _options(program: Program, iterations: int, tolerance: float, barrier: float | None) -> dict[str, dict[str, Any]]:
    """Return CasADi's options by solver; those for all solvers are under an empty name."""
    low, high = program.constraints
    fatrop = {
        "fatrop.print_level": 0,
        "fatrop.max_iter": iterations,
        "fatrop.tolerance": tolerance,
        "structure_detection": "manual",
        "N": len(program.inputs),
        "nx": program.state_sizes,
        "nu": program.input_sizes,
        "ng": program.constraint_sizes,
        "equality": (low == high).tolist(),
    }
    ipopt = {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": iterations, "ipopt.tol": tolerance}
    if barrier is not None:
        fatrop["fatrop.mu_init"] = ipopt["ipopt.mu_init"] = barrier
    every = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False, "calc_lam_p": False}
    return {"": every, "fatrop": fatrop, "ipopt": ipopt}
