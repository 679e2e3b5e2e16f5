"""The smallest input satisfies the constraints, or violates them as little as possible."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from symaware_drones.program import Constraint, Inputs

INPUTS = Inputs(20, 3.0)
NUMBER = st.floats(-2, 2)


def test_without_constraints_it_is_zero() -> None:
    assert INPUTS.smallest(1.0, []) == ((0.0, 0.0), [])
    assert INPUTS.smallest(1.0, [Constraint("a", 1.0, 0.0, -1.0)]) == ((0.0, 0.0), [])


def test_it_lies_on_the_constraint() -> None:
    found, relaxed = INPUTS.smallest(1.0, [Constraint("a", 0.0, 2.0, 3.0)])
    assert found == pytest.approx((0.0, 1.5))
    assert not relaxed


@given(x=NUMBER, y=NUMBER, gamma=st.floats(0.01, 1))
def test_the_one_feasible_point_is_a_corner(x: float, y: float, gamma: float) -> None:
    best = gamma * INPUTS.most(x, y)
    found, relaxed = INPUTS.smallest(gamma, [Constraint("a", x, y, best)])
    assert not relaxed
    assert x * found[0] + y * found[1] == pytest.approx(best, abs=1e-5)


@given(x=NUMBER, y=NUMBER, bound=st.floats(-3, 9), x2=NUMBER, y2=NUMBER, bound2=st.floats(-3, 9))
def test_no_corner_and_no_mixture_is_better(
    x: float, y: float, bound: float, x2: float, y2: float, bound2: float
) -> None:
    constraints = [Constraint("a", x, y, bound), Constraint("b", x2, y2, bound2)]
    (u, v), relaxed = INPUTS.smallest(1.0, constraints)
    by = dict(relaxed)
    for name, one, other, least in constraints:
        assert one * u + other * v >= least - by.get(name, 0.0) - 1e-5
    if "a" in by:
        assert INPUTS.most(x, y) == pytest.approx(bound - by["a"], abs=1e-5)
    if not relaxed:
        for share in (0.25, 0.5, 1.0):
            for one, other in INPUTS.corners:
                near = u + share * (one - u), v + share * (other - v)
                if x * near[0] + y * near[1] >= bound and x2 * near[0] + y2 * near[1] >= bound2:
                    assert math.hypot(*near) >= math.hypot(u, v) - 1e-5


@example([(2.0, 0.0)], [(0.25, 0.0, 1.0), (0.0, 1.192092896e-07, 0.0)], 1.0)
@given(
    st.lists(st.tuples(st.floats(-math.pi, math.pi), st.floats(-4, 0)), min_size=1, max_size=4),
    st.lists(st.tuples(NUMBER, NUMBER, st.floats(-3, 9)), max_size=2),
    st.floats(0.1, 1),
)
def test_the_separation_of_drones_takes_precedence_over_all_tasks(
    apart: list[tuple[float, float]], tasks: list[tuple[float, float, float]], gamma: float
) -> None:
    walls = [Constraint(f"w{n}", math.cos(angle), math.sin(angle), bound) for n, (angle, bound) in enumerate(apart)]
    wanted = [Constraint(f"t{n}", *each) for n, each in enumerate(tasks)]
    (u, v), relaxed = INPUTS.smallest(gamma, wanted, walls)
    by = dict(relaxed)
    assert all(x * u + y * v >= bound - 1e-5 for _, x, y, bound in walls)
    for name, x, y, bound in wanted:
        if math.hypot(x, y) > 1e-9:
            assert x * u + y * v >= bound - by.get(name, 0.0) - 1e-4
