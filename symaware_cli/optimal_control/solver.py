"""Solvers: from the present state to a plan, within a budget."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain
from typing import Any, ClassVar

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.optimal_control.optimal_control_problem import OptimalControlProblem
from symaware_cli.optimal_control.plan import Plan, PlanDecision, Solution
from symaware_cli.optimal_control.transcription import Program, transcribe

Array = NDArray[np.float64]


class Solver:
    """Solves a problem again and again, for other states and parameters.

    Building it takes a while, and one serves any number of agents: nothing of one solution enters into the next but
    what is handed over as a guess.
    """

    #: A solver keeps nothing from one call to the next: where it begins is told each time.
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
        """Build the program; later changes of the problem do not reach it.

        Args:
            problem: What to solve.
            solvers: Names of CasADi's solvers; each is tried where the one before failed. Others than ``fatrop`` and
                ``ipopt`` get their budget by `options`.
            iterations: The budget of each of them, from each guess. It bounds the time that a step takes, and the
                result is the same on a slow machine.
            tolerance: To which the scaled problem is to be solved.
            barrier: Where interior-point methods begin; small values make the most of a good guess.
            cost_scale: What the cost is multiplied by before a solver sees it, so that it is of the order of one.
            options: Further options of CasADi by solver.

        Raises:
            ValueError: No solver is named, or CasADi has none of the name.
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
        # Converted once: they never change.
        (low, high), (least, most) = self.program.variables, self.program.constraints
        bounds = {"lbx": low, "ubx": high, "lbg": least, "ubg": most}
        self._bounds = {name: casadi.DM(values) for name, values in bounds.items()}

    @property
    def steps(self) -> int:
        """How many steps the horizon has, N."""
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
            state: The present one; shape (nx,).
            parameters: A value for each that the problem declared, of its shape. What is declared for each stage has
                the stages first, (N + 1, ...); a single value holds for all of them.
            previous_input: The control input before stage 0, shape (nu,); zero if nothing is said.
            guess: Where to begin, such as ``plan.shifted()``; without, the motion under the least control input.
            alternatives: Where else the first solver begins, in this order, if it fails from the guess, before others
                try that: a program that is not convex may have solutions that are not found from there. They are made
                only when they are needed.

        Returns:
            What came of it; that solvers fail is no exception. Where all fail it is what came of the guess.

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
        """Solve the problem while a plan is in force, and fall back to what is left of that if this fails.

        Args:
            state: As for `solve`, as all that is not said here.
            parameters: Likewise.
            previous_input: Likewise.
            rest: What is left of the plan in force, ``plan.shifted()``; it is the guess, too.
        """
        solution = self.solve(state, parameters, previous_input=previous_input, guess=rest)
        if solution.solved:
            return PlanDecision(solution.plan, solution)
        return PlanDecision(rest if rest is not None and rest.left else None, solution)

    def rollout(self, state: ArrayLike, inputs: ArrayLike | None = None) -> Plan:
        """What control inputs lead to, a first guess.

        Args:
            state: The present one; shape (nx,).
            inputs: Shape (N, nu), or (nu,) to hold one; the least that is allowed if nothing is said.
        """
        held = np.clip(0.0, *self._input_bounds) if inputs is None else np.asarray(inputs, float)
        sequence = np.broadcast_to(held, (self.steps, len(self._dynamics.model.control_input))).copy()
        return Plan(self._dynamics.rollout(state, sequence), sequence, self._dynamics, 0)

    def _start(self, present: Array, before: Array, guess: Plan) -> Array:
        """Where solvers begin; shape (nv,)."""
        program = self.program
        start = np.zeros(len(program.variables[0]))
        start[program.states] = guess.states
        start[program.states[0]] = present
        start[program.inputs] = guess.inputs
        start[program.carried] = np.concatenate([before[None], guess.inputs])[:, program.carried_inputs]
        return start

    def _attempt(self, name: str, start: Array, values: Array) -> tuple[Mapping[str, Any], bool, str, int]:
        """Let one solver try: what it found, whether it succeeded, what it said, and its number of iterations."""
        solver = self._solvers[name]
        found = solver(x0=start, p=values, **self._bounds)
        statistics = solver.stats()
        count, success = int(statistics.get("iter_count", 0)), bool(statistics["success"])
        said = str(statistics["return_status"]).replace("_", " ").lower()
        if success:
            status = "solved"
        elif count >= self._iterations:
            status = "out of iterations"
        else:
            # FATROP says only that it failed.
            status = "no solution found" if said.lstrip("-").isdigit() else said
        return found, success, status, count

    def _values(self, parameters: Mapping[str, ArrayLike]) -> list[Array]:
        """The values of the parameters in the order of the program."""
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
            # CasADi's matrices stand column by column.
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
    """Options of CasADi by solver; those of all under an empty name."""
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
