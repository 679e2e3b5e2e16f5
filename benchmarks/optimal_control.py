"""Benchmark of model predictive control: ``python optimal_control.py CASE`` prints the figures as JSON.

One program is written in two ways: an aircraft flies to a target and avoids another in 28 scenarios over 30 steps,
repeatedly along its way. The cases ``fatrop`` and ``ipopt`` are an `OptimalControlProblem`; the case ``plain`` uses
`Opti` and IPOPT, as in the tutorials of CasADi. The CPU time of each solution is measured. The case ``scenario`` is the
whole of scenarios/mpc.yaml, with six agents that plan 20 steps.
"""

import argparse
import itertools
import json
import time
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from symaware_cli.engine.models.aircraft import DubinsAircraft
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.planning.optimal_control import OptimalControlProblem, Plan, Solver

Array = NDArray[np.float64]

HORIZON, BRANCHES, ROBUST, STEPS = 30, 3, 3, 82
KEEP_SQUARE, SMOOTHING = 2000.0, 5.5e6
TARGET = np.array([420.0, 560.0, np.pi / 2])
SLOWEST, FASTEST, TURN = 6.0, 9.0, 0.1
INTRUDER = np.array([-120.0, 90.0, 0.0])
INTRUDER_SPEED, INTRUDER_TURN = 10.0, 0.07
#: Turn rates of the intruder, which turns left, flies straight, turns right and flies straight: a sampled Dubins path.
TURNS = np.array([INTRUDER_TURN] * 7 + [0.24 * INTRUDER_TURN] + [0.0] * 66 + [-INTRUDER_TURN] * 8 + [0.0] * 40)


def flown(pose: Array, turns: Array) -> Array:
    """Return the poses of the intruder, (m, K + 1, 3), for turn rates (m, K)."""
    poses = np.empty((len(turns), turns.shape[1] + 1, 3))
    poses[:, 0] = pose
    for k in range(turns.shape[1]):
        heading = poses[:, k, 2]
        ahead = [INTRUDER_SPEED * np.cos(heading), INTRUDER_SPEED * np.sin(heading), turns[:, k]]
        poses[:, k + 1] = poses[:, k] + np.stack(ahead, axis=1)
    return poses


def scenarios(pose: Array, step: int) -> Array:
    """Return possible positions of the intruder, (N + 1, 2, 28): all initial turns, then its intent; and its intent."""
    intent = TURNS[step : step + HORIZON]
    turns = np.tile(intent, (BRANCHES**ROBUST + 1, 1))
    turns[:-1, :ROBUST] = list(itertools.product((INTRUDER_TURN, -INTRUDER_TURN, 0.0), repeat=ROBUST))
    return flown(pose, turns)[:, :, :2].transpose(1, 2, 0)


class Ours:
    """The program as an `OptimalControlProblem`."""

    def __init__(self, name: str) -> None:
        model = DubinsAircraft(DubinsAircraft.Parameters(min_speed=SLOWEST, max_speed=FASTEST, max_turn_rate=TURN))
        problem = OptimalControlProblem(model, steps=HORIZON, time_step=1.0, integrator="euler")
        x, u = problem.state, problem.control_input
        intruder = problem.parameter("intruder", (2, BRANCHES**ROBUST + 1), per_stage=True)
        problem.add_cost(0.1 * casadi.sumsqr(x - TARGET))
        problem.add_terminal_cost(casadi.sumsqr(x - TARGET))
        problem.add_cost(SMOOTHING * (u[1] - problem.previous_input[1]) ** 2, stages=range(1, HORIZON))
        square = casadi.vertcat(*[casadi.sumsqr(x[:2] - each) for each in casadi.horzsplit(intruder)])
        problem.add_constraint(square, lower=KEEP_SQUARE, scale=KEEP_SQUARE, stages=range(1, HORIZON))
        problem.add_constraint(square[-1], lower=KEEP_SQUARE, scale=KEEP_SQUARE, stages=[HORIZON])
        self._solver = Solver(problem, (name,), barrier=1e-5, cost_scale=1e-4, iterations=500)
        self._plan: Plan | None = None

    def solve(self, state: Array, intruder: Array) -> tuple[Array, bool]:
        """Return the control input to apply, and whether the solver succeeded."""
        guess = self._plan.shifted() if self._plan else self._solver.rollout(state, [FASTEST, 0.0])
        solution = self._solver.solve(state, {"intruder": intruder}, guess=guess)
        self._plan = solution.plan
        return solution.plan.inputs[0], solution.solved


class Plain:
    """The program with `Opti`, as in tutorials."""

    def __init__(self) -> None:
        opti = self._opti = casadi.Opti()
        x, u = self._x, self._u = opti.variable(3, HORIZON + 1), opti.variable(2, HORIZON)
        self._start = opti.parameter(3)
        count = BRANCHES**ROBUST + 1
        self._intruder = [opti.parameter(2, count) for _ in range(HORIZON + 1)]
        cost = casadi.sumsqr(x[:, HORIZON] - TARGET)
        opti.subject_to(x[:, 0] == self._start)
        for k in range(HORIZON):
            cost += 0.1 * casadi.sumsqr(x[:, k] - TARGET)
            ahead = casadi.vertcat(u[0, k] * casadi.cos(x[2, k]), u[0, k] * casadi.sin(x[2, k]), u[1, k])
            opti.subject_to(x[:, k + 1] == x[:, k] + ahead)
            opti.subject_to(opti.bounded(SLOWEST, u[0, k], FASTEST))
            opti.subject_to(opti.bounded(-TURN, u[1, k], TURN))
            if k:
                cost += SMOOTHING * (u[1, k] - u[1, k - 1]) ** 2
        for k in range(1, HORIZON + 1):
            for scenario in range(count) if k < HORIZON else (count - 1,):
                opti.subject_to(casadi.sumsqr(x[:2, k] - self._intruder[k][:, scenario]) >= KEEP_SQUARE)
        opti.minimize(cost)
        options: dict[str, Any] = {"print_level": 0, "sb": "yes", "mu_init": 1e-4, "mu_target": 1e-4}
        opti.solver("ipopt", {"print_time": False, "expand": True}, options)
        self._plan: tuple[Array, Array] | None = None

    def solve(self, state: Array, intruder: Array) -> tuple[Array, bool]:
        """Return the control input to apply, and whether the solver succeeded."""
        opti = self._opti
        opti.set_value(self._start, state)
        for parameter, value in zip(self._intruder, intruder, strict=True):
            opti.set_value(parameter, value)
        if self._plan is None:
            ahead = np.arange(HORIZON + 1) * FASTEST
            opti.set_initial(self._x, np.stack([state[0] + ahead, state[1] + 0 * ahead, state[2] + 0 * ahead]))
            opti.set_initial(self._u, np.tile([[FASTEST], [0.0]], (1, HORIZON)))
        else:
            states, inputs = self._plan
            opti.set_initial(self._x, np.concatenate([states[:, 1:], states[:, -1:]], axis=1))
            opti.set_initial(self._u, np.concatenate([inputs[:, 1:], inputs[:, -1:]], axis=1))
        solution = opti.solve_limited()
        states, inputs = np.asarray(solution.value(self._x)), np.asarray(solution.value(self._u))
        self._plan = states, inputs
        return inputs[:, 0], bool(solution.stats()["success"])


def fly(name: str) -> dict[str, float]:
    """Fly the whole way; return figures of the CPU time of each step and of building the solver [s]."""
    began = time.process_time()
    program = Plain() if name == "plain" else Ours(name)
    built = time.process_time() - began
    own, intruder = np.zeros(3), INTRUDER
    times: list[float] = []
    unsolved, nearest = 0, np.inf
    for step in range(STEPS):
        expected = scenarios(intruder, step)
        began = time.process_time()
        control_input, solved = program.solve(own, expected)
        times.append(time.process_time() - began)
        unsolved += not solved
        own = own + np.array([control_input[0] * np.cos(own[2]), control_input[0] * np.sin(own[2]), control_input[1]])
        intruder = flown(intruder, TURNS[None, step : step + 1])[0, 1]
        nearest = min(nearest, float(np.hypot(*(own - intruder)[:2])))
    figures = {
        "mean": float(np.mean(times)),
        "median": float(np.median(times)),
        "worst": max(times),
        "whole": sum(times),
    }
    return {**figures, "build": built, "unsolved": unsolved, "nearest": nearest}


def run_scenario() -> dict[str, float]:
    """Run the scenario; return the CPU time of the run [s] and the number of plans."""
    built = build(Path(__file__).parents[1] / "scenarios" / "mpc.yaml")
    began = time.process_time()
    summary = execute(built, None)
    # Every fourth step of the world is a step of the plan.
    return {"whole": time.process_time() - began, "plans": summary.agents * summary.steps // 4}


def main() -> None:
    """Measure the case given on the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", choices=["fatrop", "ipopt", "plain", "scenario"])
    case = parser.parse_args().case
    print(json.dumps(run_scenario() if case == "scenario" else fly(case)))


if __name__ == "__main__":
    main()
