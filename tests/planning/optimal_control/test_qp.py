"""Small quadratic programs, against all their active sets, tried one by one."""

import subprocess
import sys
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from symaware_cli.planning.optimal_control.qp import QPSolution, conflict, solve_qp

Array = NDArray[np.float64]
Program = tuple[Array, Array, Array, Array, Array]


def random_program(random: np.random.Generator) -> Program:
    """A program of 1 to 3 variables; of some the equations or the limits contradict each other."""
    size, count = int(random.integers(1, 4)), int(random.integers(1, 8))
    root = random.normal(size=(size, size))
    A = random.normal(size=(count, size)) * 10.0 ** random.uniform(-2, 2, (count, 1))
    length = np.abs(A).sum(axis=1)
    middle = A @ random.normal(size=size) + length * random.normal(size=count) * random.choice([0.1, 4.0])
    width = length * random.uniform(0, 2, count)
    width[0] *= random.random() > 0.1  # some have an equation
    lower = np.where(random.random(count) < 0.3, -np.inf, middle - width)
    upper = np.where(np.isfinite(lower) & (random.random(count) < 0.5) & (width > 0.0), np.inf, middle + width)
    return root @ root.T + 0.1 * np.eye(size), 3.0 * random.normal(size=size), A, lower, upper


def solution_by_enumeration(program: Program) -> Array | None:
    """The solution of a program, or None if it is infeasible.

    It solves the equations of each set of at most n constraints that could be active: the best feasible point of these
    is the solution, as one of the sets is active there.
    """
    H, f, A, lower, upper = program
    size = len(f)
    rows = np.concatenate([A, -A])
    limits = np.concatenate([upper, -lower])
    rows, limits = rows[np.isfinite(limits)], limits[np.isfinite(limits)]
    length = np.sqrt((rows * rows).sum(axis=1))
    rows, limits = rows / length[:, None], limits / length
    best, least = None, np.inf
    for many in range(size + 1):
        chosen = list(combinations(range(len(rows)), many))
        sets = np.array(chosen, int).reshape(len(chosen), many)
        active = rows[sets]
        conditions = np.zeros((len(sets), size + many, size + many))
        conditions[:, :size, :size] = H
        conditions[:, :size, size:] = np.swapaxes(active, 1, 2)
        conditions[:, size:, :size] = active
        regular = np.abs(np.linalg.det(conditions)) > 1e-13
        right = np.concatenate([np.broadcast_to(-f, (len(sets), size)), limits[sets]], axis=1)
        points = np.linalg.solve(conditions[regular], right[regular][..., None])[:, :size, 0]
        rounding = 1e-9 * np.maximum(1.0, np.abs(points).max(axis=1))
        points = points[(points @ rows.T <= limits + rounding[:, None]).all(axis=1)]
        costs = 0.5 * np.einsum("ki,ij,kj->k", points, H, points) + points @ f
        if len(points) and costs.min() < least:
            least, best = costs.min(), points[costs.argmin()]
    return best


def check_multipliers(program: Program, solution: QPSolution) -> None:
    """The multipliers prove that the solution is the best: the conditions of Karush, Kuhn and Tucker."""
    H, f, A, lower, upper = program
    reached, y = A @ solution.x, solution.multipliers
    scale = 1.0 + np.abs(f).max() + (np.abs(A) * np.abs(y)[:, None]).max()
    assert np.abs(H @ solution.x + f + A.T @ y).max() <= 1e-9 * scale
    apart = (reached - np.where(y > 0.0, upper, lower)) / np.sqrt((A * A).sum(axis=1))
    assert np.abs(apart[y != 0.0]).max(initial=0.0) <= 1e-8 * max(1.0, np.abs(solution.x).max())


def compare_with_enumeration(count: int) -> tuple[int, int]:
    random = np.random.default_rng(20)
    infeasible = 0
    for _ in range(count):
        program = random_program(random)
        expected, solution = solution_by_enumeration(program), solve_qp(*program)
        if expected is None:
            infeasible += 1
            assert solution.status == "infeasible"
        else:
            assert solution.solved
            assert np.abs(solution.x - expected).max() <= 1e-8 * max(1.0, np.abs(expected).max())
            check_multipliers(program, solution)
    return count - infeasible, infeasible


def test_random_programs_are_solved_as_by_enumeration_or_called_infeasible() -> None:
    feasible, infeasible = compare_with_enumeration(1000)
    assert feasible > 200
    assert infeasible > 200


@pytest.mark.slow
def test_two_thousand_random_programs_are_solved_as_by_enumeration_or_called_infeasible() -> None:
    feasible, infeasible = compare_with_enumeration(2000)
    assert feasible > 400
    assert infeasible > 400


@pytest.mark.parametrize("radius", [0.0, 1e-6, 0.3, 3.0, 10.0])
@pytest.mark.parametrize("direction", ["face", "vertex", "any"])
def test_a_program_whose_feasible_set_is_one_vertex_or_face_of_a_polygon_is_solved(
    radius: float, direction: str
) -> None:
    random = np.random.default_rng(int(1e6 * radius))
    for _ in range(50):
        angles = random.uniform(0, 7) + np.arange(20) * np.pi / 10
        faces = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        vertices = radius / np.cos(np.pi / 20) * np.stack([np.cos(angles + np.pi / 20), np.sin(angles + np.pi / 20)], 1)
        gradient = {"face": faces[3] * 2.0, "vertex": vertices[5] + 0.0, "any": random.normal(size=2)}[direction]
        best = (vertices @ gradient).max()
        A = np.vstack([faces, gradient])
        solution = solve_qp(
            np.eye(2), np.zeros(2), A, np.r_[np.full(20, -np.inf), best], np.r_[np.full(20, radius), np.inf]
        )
        assert solution.solved
        length = max(float(np.sqrt(gradient @ gradient)), 1e-300)
        assert (faces @ solution.x - radius).max() <= 2e-9
        assert (best - gradient @ solution.x) / length <= 2e-9


def test_a_row_of_zeros_is_satisfied_or_makes_the_program_infeasible() -> None:
    A = [[0.0, 0.0], [1.0, 0.0]]
    assert solve_qp(np.eye(2), [0, 0], A, [-1, 1], [0, np.inf]).x.tolist() == [1.0, 0.0]
    assert solve_qp(np.eye(2), [0, 0], A, [-np.inf, 1], [-0.1, np.inf]).status == "infeasible"


def test_no_constraint_is_lost_whatever_the_scale_of_the_cost_and_of_its_row() -> None:
    for cost in (1e-9, 1.0, 1e15):
        for row in (1e-9, 1.0, 1e9):
            solution = solve_qp([[cost]], [0.0], [[row]], [2.0 * row], [np.inf])
            assert solution.solved
            assert solution.x[0] == pytest.approx(2.0, rel=1e-8)
            assert solution.multipliers[0] == pytest.approx(-2.0 * cost / row, rel=1e-8)


def test_bounds_hold_and_have_multipliers_after_the_rows() -> None:
    solution = solve_qp(np.eye(2), [-3.0, 1.0], [[1.0, 1.0]], [0.5], [np.inf], bounds=([-1.0, -1.0], [1.0, 1.0]))
    assert solution.x == pytest.approx([1.0, -0.5])
    assert solution.multipliers == pytest.approx([-0.5, 2.5, 0.0])


def test_a_row_with_a_price_yields_by_its_multiplier_over_the_price() -> None:
    program = np.eye(2), [0.0, 0.0], [[1.0, 0.0], [2.0, 0.0]], [-np.inf, 6.0], [1.0, np.inf]
    assert solve_qp(*program).status == "infeasible"
    solution = solve_qp(*program, prices=[np.inf, 8.0])
    assert solution.x == pytest.approx([1.0, 0.0])
    assert solution.slacks == pytest.approx([0.0, 4.0])
    assert solution.slacks[1] == pytest.approx(-solution.multipliers[1] / 8.0)


def test_a_guess_saves_iterations_and_changes_nothing_but_rounding() -> None:
    random = np.random.default_rng(3)
    saved = 0
    for _ in range(300):
        H, f, A, lower, upper = random_program(random)
        first = solve_qp(H, f, A, lower, upper)
        f = f + 0.01 * random.normal(size=len(f))
        cold, warm = (solve_qp(H, f, A, lower, upper, guess=guess) for guess in (None, first))
        assert warm.status == cold.status
        if cold.solved:
            assert np.abs(warm.x - cold.x).max() <= 1e-8 * max(1.0, np.abs(cold.x).max())
            saved += cold.iterations - warm.iterations
    assert saved > 0


def test_a_result_depends_on_the_program_alone() -> None:
    random = np.random.default_rng(4)
    programs = [random_program(random) for _ in range(100)]
    forwards = [solve_qp(*program) for program in programs]
    backwards = [solve_qp(*program) for program in reversed(programs)][::-1]
    for one, other in zip(forwards, backwards, strict=True):
        assert one.x.tobytes() == other.x.tobytes()
        assert one.multipliers.tobytes() == other.multipliers.tobytes()


def test_conflict_names_constraints_all_of_which_are_needed_for_the_contradiction() -> None:
    A = [[0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    lower, upper = [-5.0, 2.0, -np.inf, 1.0], [5.0, np.inf, 2.0, np.inf]
    assert conflict(A, lower, upper) == (1, 2, 3)
    assert conflict(A, lower, upper, bounds=([-1.0, -1.0], [1.0, 9.0])) == (1, 4)
    assert conflict(A[:3], lower[:3], upper[:3]) == ()
    assert conflict([[1.0]], [1.0], [0.0]) == (0,)


@pytest.mark.parametrize(
    ("H", "A", "lower", "message"),
    [
        ([[1.0, 0.0], [0.0, 0.0]], [[1.0, 0.0]], [0.0], "positive definite"),
        ([[-1.0, 0.0], [0.0, -1.0]], [[1.0, 0.0]], [0.0], "positive definite"),
        ([[np.nan, 0.0], [0.0, 1.0]], [[1.0, 0.0]], [0.0], "finite"),
        (np.eye(2), [[1.0, np.nan]], [0.0], "finite"),
        (np.eye(2), [[1.0, 0.0]], [np.nan], "NaN"),
        (np.eye(2), [[1.0]], [0.0], "do not match"),
    ],
)
def test_a_program_that_is_none_is_refused(H: Array, A: Array, lower: Array, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        solve_qp(H, [0.0, 0.0], A, lower, [1.0])


def test_a_program_without_rows_has_bounds_at_most() -> None:
    none = np.empty((0, 2))
    assert solve_qp(np.eye(2), [1, 2], none, [], []).x.tolist() == [-1.0, -2.0]
    solution = solve_qp(np.eye(2), [1, 2], none, [], [], bounds=([0, -9], [1, 9]))
    assert solution.x.tolist() == [0.0, -2.0]
    assert solution.multipliers.tolist() == [-1.0, 0.0]


def test_it_does_not_need_casadi() -> None:
    code = "import sys; from symaware_cli.planning.optimal_control import qp; assert 'casadi' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
