"""Solvers find what theory says, keep to what must hold, and fail politely."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from symaware_cli.planning.optimal_control.solver import Plan

casadi = pytest.importorskip("casadi", reason="CasADi is an extra")

from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator  # noqa: E402
from symaware_cli.engine.models.linear import Linear  # noqa: E402
from symaware_cli.engine.models.unicycle import Unicycle  # noqa: E402
from symaware_cli.planning.optimal_control import OptimalControlProblem, Solver  # noqa: E402

SEEDS = st.integers(0, 2**32 - 1)
both = pytest.mark.parametrize("name", ["fatrop", "ipopt"])
slowly = settings(max_examples=15, deadline=None)


def linear(A: NDArray[np.float64], B: NDArray[np.float64], max_input: float | None = None) -> Linear:
    names = [f"x{n}" for n in range(len(A))], [f"u{n}" for n in range(B.shape[1])]
    return Linear(
        Linear.Parameters(
            time_step=0.1,
            state=dict.fromkeys(names[0], "m"),
            control_input=dict.fromkeys(names[1], "m"),
            A=A.tolist(),
            B=B.tolist(),
            max_input=max_input,
        )
    )


def positive(random: np.random.Generator, size: int, least: float = 0.0) -> NDArray[np.float64]:
    root = random.normal(size=(size, size))
    return root @ root.T + least * np.eye(size)


def regulator(
    seed: int, steps: int, max_input: float | None = None
) -> tuple[OptimalControlProblem, Any, NDArray[np.float64]]:
    """A random linear system with a quadratic cost, its problem and its matrices."""
    random = np.random.default_rng(seed)
    nx, nu = int(random.integers(2, 5)), int(random.integers(1, 3))
    A, B = random.normal(size=(nx, nx)) * 0.6, random.normal(size=(nx, nu))
    Q, R, P = positive(random, nx), positive(random, nu, 0.1), positive(random, nx)
    problem = OptimalControlProblem(linear(A, B, max_input), steps=steps, time_step=0.1)
    x, u = problem.state, problem.control_input
    problem.add_cost(casadi.bilin(Q, x, x) + casadi.bilin(R, u, u))
    problem.add_terminal_cost(casadi.bilin(P, x, x))
    return problem, (A, B, Q, R, P), random.normal(size=nx)


@both
@given(seed=SEEDS, steps=st.integers(1, 12))
@slowly
def test_a_linear_quadratic_problem_has_the_solution_of_riccati(name: str, seed: int, steps: int) -> None:
    # Backwards from P_N: K = (R + B'PB)^-1 B'PA, P = Q + A'P(A - BK); u = -Kx, and the cost is x'P_0 x
    # (D. P. Bertsekas, Dynamic Programming and Optimal Control I, 2005, section 4.1).
    problem, (A, B, Q, R, P), state = regulator(seed, steps)
    gains = []
    for _ in range(steps):
        gains.append(np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A))
        P = Q + A.T @ P @ (A - B @ gains[-1])
    solution = Solver(problem, (name,), tolerance=1e-10).solve(state)
    assert solution.solved
    assert solution.status == "solved"
    assert solution.cost == pytest.approx(state @ P @ state, rel=1e-6, abs=1e-9)
    for k, gain in enumerate(reversed(gains)):
        assert solution.plan.inputs[k] == pytest.approx(-gain @ state, rel=1e-5, abs=1e-6)
        state = A @ state + B @ solution.plan.inputs[k]
        assert solution.plan.states[k + 1] == pytest.approx(state, rel=1e-6, abs=1e-7)


@given(seed=SEEDS)
@slowly
def test_solvers_agree_on_convex_problems(seed: int) -> None:
    problem, _, state = regulator(seed, 8, max_input=0.3)
    problem.add_constraint(problem.state[0] + problem.state[1], -1.0, 1.0, penalty=20.0)
    problem.add_constraint(problem.control_input[0] - problem.previous_input[0], -0.2, 0.2)
    first, second = (Solver(problem, (name,)).solve(state) for name in ("fatrop", "ipopt"))
    assert first.solved
    assert second.solved
    assert (first.solver, second.solver) == ("fatrop", "ipopt")
    assert first.cost == pytest.approx(second.cost, rel=1e-5, abs=1e-5)
    assert first.plan.inputs == pytest.approx(second.plan.inputs, abs=1e-3)
    assert first.violation == pytest.approx(second.violation, abs=1e-4)
    for solution in (first, second):
        assert np.abs(solution.plan.inputs).max() <= 0.3
        assert np.abs(np.diff(solution.plan.inputs[:, 0], prepend=0.0)).max() <= 0.2 + 1e-6


def detour(penalty: float | None = None, **options: Any) -> Solver:
    """A unicycle that goes round a disc of 1 m."""
    problem = OptimalControlProblem(Unicycle(), steps=20, time_step=0.25)
    x, u = problem.state, problem.control_input
    goal, disc = problem.parameter("goal", 2), problem.parameter("disc", 2)
    problem.add_cost(casadi.sumsqr(x[:2] - goal) + 0.1 * casadi.sumsqr(u))
    problem.add_terminal_cost(10.0 * casadi.sumsqr(x[:2] - goal))
    problem.add_constraint(casadi.sumsqr(x[:2] - disc), lower=1.0, penalty=penalty)
    return Solver(problem, **options)


DETOUR = detour()


def task(seed: int) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    random = np.random.default_rng(seed)
    state = np.array([*random.uniform(-2, -1.2, 2), random.uniform(-3, 3)])
    return state, {"goal": random.uniform(1.2, 3, 2), "disc": random.uniform(-0.1, 0.1, 2)}


@given(seed=SEEDS)
@slowly
def test_a_solution_moves_as_the_model_does_and_keeps_to_the_constraints(seed: int) -> None:
    state, values = task(seed)
    solution = DETOUR.solve(state, values)
    assert solution.solved
    assert solution.infeasibility < 1e-6
    states = solution.plan.states
    assert states == pytest.approx(solution.plan.dynamics.rollout(state, solution.plan.inputs), abs=1e-5)
    assert np.hypot(*(states[1:, :2] - values["disc"]).T).min() > 1.0 - 1e-6


@given(seed=SEEDS)
@slowly
def test_a_solution_as_a_guess_is_found_again_with_less_work(seed: int) -> None:
    state, values = task(seed)
    first = DETOUR.solve(state, values)
    again = DETOUR.solve(state, values, guess=first.plan)
    assert again.solved
    assert again.cost <= first.cost * (1 + 1e-5)
    assert again.iterations <= first.iterations


def test_where_the_first_solver_fails_from_the_guess_it_tries_the_alternatives_in_order() -> None:
    # Twenty iterations are too few from a plan that turns on the spot, and enough from a solution.
    solver, (state, values) = detour(iterations=20), task(2)
    idle = solver.rollout(state, [0.0, 1.0])
    good = DETOUR.solve(state, values).plan
    failed = solver.solve(state, values, guess=idle)
    assert not failed.solved
    made = []

    def alternatives(plans: Sequence[Plan]) -> Iterator[Plan]:
        for plan in plans:
            made.append(plan)
            yield plan

    found = solver.solve(state, values, guess=idle, alternatives=alternatives([idle, good, good]))
    alone = detour(solvers=("fatrop",), iterations=20).solve(state, values, guess=good)
    assert (found.solved, found.solver, found.status) == (True, "fatrop", "solved")
    np.testing.assert_array_equal(found.plan.inputs, alone.plan.inputs)
    assert made == [idle, good], "no more are made than are needed"
    # Nothing but the first solver was needed: twice in vain from where there is no way, then from the solution.
    assert found.iterations <= 2 * 21 + alone.iterations


def test_alternatives_are_not_made_where_the_guess_will_do_and_where_they_fail_too_the_guess_counts() -> None:
    state, values = task(2)
    good = DETOUR.solve(state, values)

    def none() -> Iterator[Any]:
        raise AssertionError("nobody needs it")
        yield

    again = DETOUR.solve(state, values, guess=good.plan, alternatives=none())
    np.testing.assert_array_equal(again.plan.inputs, DETOUR.solve(state, values, guess=good.plan).plan.inputs)
    short, idle = detour(iterations=3), DETOUR.rollout(state, [0.0, 1.0])
    failed, other = short.solve(state, values), short.solve(state, values, alternatives=[idle])
    assert not other.solved
    assert (other.solver, other.status) == (failed.solver, failed.status)
    np.testing.assert_array_equal(other.plan.inputs, failed.plan.inputs)


def test_a_warm_start_saves_iterations_along_the_way() -> None:
    state, values = task(5)
    cold = warm = 0
    plan = None
    for _ in range(10):
        cold += DETOUR.solve(state, values).iterations
        decision = DETOUR.replan(state, values, rest=None if plan is None else plan.shifted())
        warm += decision.solution.iterations
        plan = decision.plan
        assert plan is not None
        state = plan.states[1]
    assert warm < 0.7 * cold


def test_one_solution_leaves_no_trace_in_the_next() -> None:
    for name in ("fatrop", "ipopt"):
        solver = detour(solvers=(name,))
        first, other = task(1), task(2)
        before = solver.solve(*first)
        solver.solve(*other)
        solver.solve([0.0, 0.0, 0.0], other[1])
        after = solver.solve(*first)
        assert np.array_equal(before.plan.states, after.plan.states)
        assert np.array_equal(before.plan.inputs, after.plan.inputs)
        assert (before.cost, before.iterations) == (after.cost, after.iterations)


SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
from test_solver import detour, task
for name in ("fatrop", "ipopt"):
    plan = detour(solvers=(name,)).solve(*task(1)).plan
    print(plan.states.tobytes().hex(), plan.inputs.tobytes().hex())
"""


def test_the_number_of_threads_changes_nothing(request: pytest.FixtureRequest) -> None:
    script = SCRIPT.format(folder=str(request.path.parent))
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", script],
            env={**os.environ, "OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": count},
            stdout=subprocess.PIPE,
        )
        for count in ("1", "2")
    ]
    said = [process.communicate()[0] for process in processes]
    assert said[0] == said[1]
    assert len(said[0].splitlines()) == 2


def test_an_agent_that_begins_inside_an_obstacle_has_no_plan() -> None:
    solution = detour().solve([0.1, 0.0, 0.0], {"goal": [3.0, 0.0], "disc": [0.0, 0.0]})
    assert not solution.solved
    assert solution.solver == "ipopt"
    assert solution.status == "infeasible problem detected"
    assert solution.infeasibility > 0.1
    assert solution.plan.states.shape == (21, 3)


def test_a_soft_constraint_lets_out_whoever_is_inside() -> None:
    solution = detour(penalty=1e3).solve([0.1, 0.0, 0.0], {"goal": [3.0, 0.0], "disc": [0.0, 0.0]})
    assert solution.solved
    assert solution.violation > 0.5
    assert solution.infeasibility < 1e-6
    assert np.hypot(*solution.plan.states[-1, :2]) > 1.0


def test_a_price_that_is_high_enough_changes_nothing_where_there_is_a_solution() -> None:
    state, values = task(3)
    hard, soft = (
        DETOUR.solve(state, values),
        detour(penalty=1e3).solve(state, values, guess=DETOUR.solve(state, values).plan),
    )
    assert soft.violation < 1e-5
    assert soft.cost == pytest.approx(hard.cost, rel=1e-5)


@both
def test_the_budget_of_iterations_is_kept(name: str) -> None:
    state, values = task(1)
    solution = detour(solvers=(name,), iterations=2).solve(state, values)
    assert not solution.solved
    assert solution.status == "out of iterations"
    assert 2 <= solution.iterations <= 3


def test_the_next_solver_is_tried_where_one_fails() -> None:
    state, values = task(1)
    chain = detour(options={"fatrop": {"fatrop.max_iter": 1}}).solve(state, values)
    alone = detour(solvers=("ipopt",)).solve(state, values)
    assert chain.solved
    assert chain.solver == "ipopt"
    assert np.array_equal(chain.plan.states, alone.plan.states)
    assert chain.iterations > alone.iterations


@both
def test_a_cost_that_is_not_a_number_is_a_failure(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    problem = OptimalControlProblem(SingleIntegrator(), steps=5, time_step=0.2)
    problem.add_cost(casadi.log(problem.state[0]) + casadi.sumsqr(problem.control_input))
    solution = Solver(problem, (name,), iterations=20).solve([-1.0, 0.0])
    assert not solution.solved
    capfd.readouterr()


def test_replanning_falls_back_to_the_rest_of_the_plan_until_it_is_used_up() -> None:
    state, values = task(1)
    solver = detour()
    plan = first = solver.replan(state, values).plan
    assert plan is not None
    assert first is not None
    inside: dict[str, Any] = {**values, "disc": [0.0, 0.0]}
    for k in range(1, 20):
        decision = solver.replan([0.1, 0.0, 0.0], inside, rest=plan.shifted()) if k in (1, 19) else None
        plan = decision.plan if decision else plan.shifted()
        assert plan is not None
        assert plan.left == 20 - k
        assert plan.inputs[0].tolist() == first.inputs[k].tolist()
    assert decision is not None
    assert decision.fallen_back
    assert solver.replan([0.1, 0.0, 0.0], inside, rest=plan.shifted()).plan is None
    assert solver.replan([0.1, 0.0, 0.0], inside).plan is None


def test_scales_change_nothing_but_the_numbers_that_solvers_see() -> None:
    state, values = task(4)
    problem = OptimalControlProblem(Unicycle(), steps=20, time_step=0.25)
    x, u = problem.state, problem.control_input
    goal, disc = problem.parameter("goal", 2), problem.parameter("disc", 2)
    problem.add_cost(1e4 * (casadi.sumsqr(x[:2] - goal) + 0.1 * casadi.sumsqr(u)))
    problem.add_terminal_cost(1e5 * casadi.sumsqr(x[:2] - goal))
    problem.add_constraint(1e6 * casadi.sumsqr(x[:2] - disc), lower=1e6, scale=1e6)
    scaled, plain = Solver(problem, cost_scale=1e-4).solve(state, values), DETOUR.solve(state, values)
    assert scaled.cost == pytest.approx(1e4 * plain.cost, rel=1e-6)
    assert scaled.plan.inputs == pytest.approx(plain.plan.inputs, abs=1e-4)


def test_a_plan_shifts_and_tells_where_it_leads() -> None:
    problem = OptimalControlProblem(DoubleIntegrator(), steps=4, time_step=0.5)
    problem.add_cost(casadi.sumsqr(problem.control_input))
    problem.add_terminal_cost(casadi.sumsqr(problem.state[:2] - 1.0))
    plan = Solver(problem).solve([0.0, 0.0, 0.0, 0.0]).plan
    shifted = plan.shifted()
    assert np.array_equal(shifted.states[:4], plan.states[1:])
    assert np.array_equal(shifted.inputs, plan.inputs[[1, 2, 3, 3]])
    assert shifted.states[-1] == pytest.approx(plan.dynamics(plan.states[-1:], plan.inputs[-1:])[0])
    assert [plan.shifted(n).left for n in (0, 1, 4, 9)] == [4, 3, 0, 0]
    assert np.array_equal(plan.shifted(2).states, plan.shifted().shifted().states)
    intent = plan.intent(3_000_000_000)
    assert intent.times.tolist() == [3_000_000_000 + 500_000_000 * k for k in range(5)]
    assert np.array_equal(intent.values, plan.states[:, :2])


def test_other_solvers_of_casadi_may_be_named() -> None:
    quiet = {"print_header": False, "print_iteration": False, "print_status": False}
    options = {"sqpmethod": {"qpsol": "osqp", "qpsol_options": {"osqp.verbose": False}, **quiet}}
    problem, _, state = regulator(7, 5)
    if not casadi.has_conic("osqp"):
        pytest.skip("CasADi has no OSQP here")
    solution = Solver(problem, ("sqpmethod",), options=options).solve(state)
    assert solution.solved
    assert solution.cost == pytest.approx(Solver(problem).solve(state).cost, rel=1e-2)
