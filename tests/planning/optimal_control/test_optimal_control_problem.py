"""What may be asked for, and what is refused before anybody solves it."""

from typing import Any

import numpy as np
import pytest

from symaware_cli.engine.models.noise import NoisyModel

casadi = pytest.importorskip("casadi", reason="CasADi is an extra")

from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator  # noqa: E402
from symaware_cli.engine.models.unicycle import Unicycle  # noqa: E402
from symaware_cli.planning.optimal_control import OptimalControlProblem, Solver  # noqa: E402


def problem_of(model: NoisyModel | None = None, steps: int = 5) -> OptimalControlProblem:
    return OptimalControlProblem(model or SingleIntegrator(), steps=steps, time_step=0.5)


def least_effort(problem: OptimalControlProblem) -> OptimalControlProblem:
    problem.add_cost(casadi.sumsqr(problem.control_input))
    return problem


def test_costs_and_constraints_count_at_the_stages_they_are_asked_for() -> None:
    problem = least_effort(problem_of())
    problem.add_constraint(problem.state, [1.0, -1.0], [1.0, -1.0], stages=[2])
    problem.add_constraint(problem.state[1], upper=-2.0, stages=[5])
    states = Solver(problem).solve([0.0, 0.0]).plan.states
    assert states[:3, 0] == pytest.approx([0.0, 0.5, 1.0])
    assert states[3:, 0] == pytest.approx(1.0)
    assert states[2:, 1] == pytest.approx([-1.0, -4 / 3, -5 / 3, -2.0])


def test_nothing_can_be_done_about_the_present_state() -> None:
    problem = least_effort(problem_of())
    problem.add_constraint(problem.state[0], lower=1.0)
    problem.bound_state([-np.inf, 2.0])
    states = Solver(problem).solve([0.0, 0.0]).plan.states
    assert states[0] == pytest.approx(0.0)
    assert states[1:] == pytest.approx(np.tile([1.0, 2.0], (5, 1)), abs=2e-3)


def test_the_limits_of_the_model_hold_by_themselves_and_may_be_tightened() -> None:
    problem = problem_of(Unicycle(Unicycle.Parameters(max_speed=1.0, max_turn_rate=2.0)))
    problem.add_cost(-problem.control_input[0] - problem.control_input[1])
    assert Solver(problem).solve([0.0, 0.0, 0.0]).plan.inputs == pytest.approx(np.tile([1.0, 2.0], (5, 1)), abs=1e-5)
    problem.bound_input(upper=[0.5, np.inf])
    assert Solver(problem).solve([0.0, 0.0, 0.0]).plan.inputs == pytest.approx(np.tile([0.5, 2.0], (5, 1)), abs=1e-5)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_where_a_model_limits_the_length_of_its_input_so_does_the_problem(dimensions: int) -> None:
    model = SingleIntegrator(SingleIntegrator.Parameters(max_speed=2.0, dimensions=dimensions))
    problem = problem_of(model)
    problem.add_cost(-casadi.sum1(problem.control_input))
    inputs = Solver(problem).solve(np.zeros(dimensions)).plan.inputs
    assert inputs == pytest.approx(2.0 / np.sqrt(dimensions), abs=1e-5)
    assert model.limit(inputs) == pytest.approx(inputs, abs=1e-6)


def test_a_model_without_limits_has_none() -> None:
    problem = problem_of(DoubleIntegrator())
    assert not problem.constraints
    assert np.isinf(problem.input_bounds).all()


def test_the_previous_input_is_that_of_the_stage_before() -> None:
    problem = problem_of()
    change = problem.control_input - problem.previous_input
    problem.add_cost(casadi.sumsqr(change))
    problem.add_constraint(problem.control_input[0], 4.0, 4.0, stages=[4])
    solver = Solver(problem)
    # The least sum of squares climbs in equal parts.
    assert solver.solve([0, 0], previous_input=[-1, 3]).plan.inputs[:, 0] == pytest.approx([0, 1, 2, 3, 4])
    assert solver.solve([0, 0], previous_input=[-1, 3]).plan.inputs[:, 1] == pytest.approx(3)
    assert solver.solve([0, 0]).plan.inputs[:, 0] == pytest.approx([0.8, 1.6, 2.4, 3.2, 4.0])


def test_only_what_is_used_of_the_previous_input_is_carried() -> None:
    problem = problem_of()
    problem.add_cost((problem.control_input[1] - problem.previous_input[1]) ** 2, stages=range(1, 5))
    assert Solver(problem).program.carried_inputs.tolist() == [1]
    assert Solver(problem_of()).program.carried_inputs.tolist() == []


def test_parameters_are_columns_matrices_and_numbers_for_all_stages_or_for_each() -> None:
    problem = least_effort(problem_of())
    speed = problem.parameter("speed")
    place = problem.parameter("place", 2, per_stage=True)
    turn = problem.parameter("turn", (2, 3))
    problem.add_constraint(problem.state - place, 0.0, 0.0, stages=[2, 4])
    problem.add_constraint(problem.state[0] - turn[1, 2] * speed, 0.0, 0.0, stages=[5])
    solver = Solver(problem)
    places = np.arange(12.0).reshape(6, 2)
    values: dict[str, Any] = {"speed": 2.0, "place": places, "turn": [[0, 1, 2], [3, 4, 5]]}
    states = solver.solve([0.0, 0.0], values).plan.states
    assert states[[2, 4]] == pytest.approx(places[[2, 4]])
    assert states[5, 0] == pytest.approx(10.0)
    # One value stands for every stage.
    states = solver.solve([0.0, 0.0], values | {"place": [1.0, 7.0]}).plan.states
    assert states[[2, 4]] == pytest.approx(np.array([[1.0, 7.0], [1.0, 7.0]]))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({}, "the parameter `place` is missing"),
        ({"place": [0.0, 0.0], "plaice": 1.0}, "no parameter `plaice`"),
        ({"place": [0.0, 0.0, 0.0]}, r"`place` has the shape \(3,\), and \(6, 2\) is needed"),
        ({"place": [0.0, np.nan]}, "`place` is not finite"),
    ],
)
def test_wrong_values_of_parameters_are_refused(values: dict[str, float | list[float]], said: str) -> None:
    problem = problem_of()
    place = problem.parameter("place", 2, per_stage=True)
    problem.add_cost(casadi.sumsqr(problem.state - place))
    with pytest.raises(ValueError, match=said):
        Solver(problem).solve([0.0, 0.0], values)


@pytest.mark.parametrize(
    ("state", "said"), [([0.0], r"the state has the shape \(1,\)"), ([np.inf, 0.0], "the state is not finite")]
)
def test_wrong_states_are_refused(state: list[float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Solver(least_effort(problem_of())).solve(state)


def test_wrong_problems_are_refused() -> None:
    problem = problem_of()
    with pytest.raises(ValueError, match="a cost is a scalar, and this has 2 elements"):
        problem.add_cost(problem.state)
    with pytest.raises(ValueError, match="the stages 0 to 4 only, not to 5"):
        problem.add_cost(casadi.sumsqr(problem.control_input), stages=range(6))
    with pytest.raises(ValueError, match="the stages 0 to 5 only, not to -1"):
        problem.add_constraint(problem.state, 0.0, stages=[-1])
    with pytest.raises(ValueError, match="has no symbol mass"):
        problem.add_cost(casadi.SX.sym("mass"))
    problem.parameter("goal")
    with pytest.raises(ValueError, match="a parameter `goal` already"):
        problem.parameter("goal")
    with pytest.raises(ValueError, match="at least one solver"):
        Solver(problem, ())
    with pytest.raises(ValueError, match="no solver `ipotp`"):
        Solver(problem, ("ipotp",))
    with pytest.raises(ValueError, match="at least one step, not 0"):
        problem_of(steps=0)


def test_later_changes_of_a_problem_do_not_reach_its_solver() -> None:
    problem = least_effort(problem_of())
    solver = Solver(problem)
    problem.parameter("goal")
    problem.bound_input(lower=1.0)
    assert solver.solve([0.0, 0.0]).plan.inputs == pytest.approx(0.0)
