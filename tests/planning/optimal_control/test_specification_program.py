"""Programs of specifications: optima against enumeration, robustness against the definition, equal solutions."""

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from formulas import random_formula
from numpy.typing import NDArray
from scipy.optimize import linprog

from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.evidence.semantics import robustness_interval
from symaware_cli.geometry.region import Region, RegionShape
from symaware_cli.planning.optimal_control import (
    Affine,
    LinearDynamics,
    SpecificationPlan,
    SpecificationProgram,
    margins,
    predicate_sets,
    state_names,
)
from symaware_cli.specification import formula as stl
from symaware_cli.specification.columns import ARGUMENTS
from symaware_cli.specification.formulation import Formulation, formulate
from symaware_cli.specification.parser import parse
from symaware_cli.specification.region import PlacedRegion

pytest.importorskip("highspy", reason="HiGHS is an extra")

Array = NDArray[np.float64]

STEPS = 5
NAMES = state_names(SingleIntegrator())
#: x+ = x + u, each element of u at most 1.
POINT = LinearDynamics(
    np.eye(2), np.eye(2), np.zeros(2), np.full(2, -1.0), np.full(2, 1.0), np.zeros((0, 2)), np.zeros(0)
)
#: A half space for each of three predicates, as normal and offset.
PREDICATES = (((1.0, 0.0), -0.5), ((0.0, -1.0), 0.25), ((-0.6, 0.8), 0.1))
HALVES = [Affine(normal, offset) for normal, offset in PREDICATES]


def formulation(text: str, regions: dict[str, Region]) -> Formulation:
    return formulate(parse(text, [*NAMES, *regions], ARGUMENTS), 10**9)


def sets_of_halves() -> list[tuple[object, object]]:
    names = {"a": HALVES[0], "b": HALVES[1], "c": HALVES[2]}
    tree = parse("a >= 0 and b >= 0 and c >= 0", names, ARGUMENTS)
    return list(predicate_sets(formulate(tree, 10**9), names, {}))


def planned(formula: stl.Formula, state: Sequence[float], alternatives: str = "binary") -> SpecificationPlan:
    program = SpecificationProgram(POINT, state, STEPS, robustness_weight=1.0, alternatives=alternatives)  # type: ignore[arg-type]
    program.require("it", formula, sets_of_halves())  # type: ignore[arg-type]
    return program.solve()


def robustness(formula: stl.Formula, states: Array) -> float:
    """The robustness of a formula by the definitions of its operators, if windows end with the states."""
    samples = [np.array([float(np.dot(normal, state)) + offset for state in states]) for normal, offset in PREDICATES]
    low, high = robustness_interval(formula, samples, len(states), 1, True, times=1)
    assert low == high
    return float(low[0, 0])


def selections(formula: stl.Formula, at: int, positive: bool = True) -> list[frozenset[tuple[int, int, bool]]]:
    """All ways to satisfy a formula: sets of predicates, instants and signs that hold."""

    def every(parts: list[list[frozenset[tuple[int, int, bool]]]]) -> list[frozenset[tuple[int, int, bool]]]:
        return list(dict.fromkeys(frozenset().union(*each) for each in itertools.product(*parts)))

    def either(parts: list[list[frozenset[tuple[int, int, bool]]]]) -> list[frozenset[tuple[int, int, bool]]]:
        return list(dict.fromkeys(itertools.chain(*parts)))

    match formula:
        case stl.Predicate(index=index):
            return [frozenset({(index, at, positive)})]
        case stl.Not(operand=operand):
            return selections(operand, at, not positive)
        case stl.Next(operand=operand):
            return selections(operand, at + 1, positive)
        case stl.And(operands=operands) | stl.Or(operands=operands):
            join = every if isinstance(formula, stl.And) == positive else either
            return join([selections(each, at, positive) for each in operands])
        case (
            stl.Always(first=first, last=last, operand=operand)
            | stl.Eventually(first=first, last=last, operand=operand)
        ):
            assert last is not None
            join = every if isinstance(formula, stl.Always) == positive else either
            return join([selections(operand, at + k, positive) for k in range(first, last + 1)])
        case stl.Until(first=first, last=last, left=left, right=right):
            assert last is not None
            inner, outer = (every, either) if positive else (either, every)
            return outer(
                [
                    inner(
                        [
                            selections(right, at + k, positive),
                            *(selections(left, at + j, positive) for j in range(k)),
                        ]
                    )
                    for k in range(first, last + 1)
                ]
            )
    raise AssertionError(formula)


def enumerated(formula: stl.Formula, state: Sequence[float]) -> float:
    """The greatest robustness of all plans, by a linear program for each way to satisfy the formula; else -inf."""
    best = -np.inf
    for chosen in selections(formula, 0):
        rows, limits = [], []
        for index, at, positive in sorted(chosen):
            normal, offset = PREDICATES[index]
            sign = 1.0 if positive else -1.0
            # sign * (normal @ (state + sum of inputs) + offset) >= rho
            row = np.zeros(2 * STEPS + 1)
            row[: 2 * at] = np.tile(-sign * np.array(normal), at)
            row[-1] = 1.0
            rows.append(row)
            limits.append(sign * (float(np.dot(normal, state)) + offset))
        cost = np.zeros(2 * STEPS + 1)
        cost[-1] = -1.0
        found = linprog(cost, np.array(rows), limits, bounds=[(-1, 1)] * (2 * STEPS) + [(0, None)])
        if found.status == 0:
            best = max(best, -float(found.fun or 0.0))
    return best


def small_formula(seed: int) -> tuple[stl.Formula, list[float]]:
    """A random formula that ends within the steps, with few ways to satisfy it, and a state."""
    for attempt in itertools.count():
        generator = np.random.default_rng([seed, attempt])
        formula = random_formula(generator, 2, widest=2, past=False, unbounded=False, constants=False)
        end = stl.horizon(formula)
        if end is not None and 1 <= end <= STEPS and len(selections(formula, 0)) <= 60:
            return formula, generator.uniform(-2.0, 2.0, 2).round(2).tolist()
    raise AssertionError


@pytest.mark.parametrize("seed", range(40))
def test_the_optimum_is_that_of_all_choices_enumerated(seed: int) -> None:
    formula, state = small_formula(seed)
    expected = enumerated(formula, state)
    for alternatives in ("binary", "logarithmic"):
        plan = planned(formula, state, alternatives)
        if expected == -np.inf:
            assert plan.status == "infeasible"
        else:
            assert plan.status == "optimal"
            assert plan.robustness["it"] == pytest.approx(expected, abs=1e-6)
            assert plan.states is not None
            assert robustness(formula, plan.states) == pytest.approx(plan.robustness["it"], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1060))
def test_the_optimum_is_that_of_all_choices_enumerated_at_length(seed: int) -> None:
    test_the_optimum_is_that_of_all_choices_enumerated(seed)


def begins_within(formula: stl.Formula, at: int = 0) -> bool:
    """Whether no window of a formula may begin after the last step."""
    first = formula.first if isinstance(formula, stl.Always | stl.Eventually | stl.Until) else 0
    width = 0
    if isinstance(formula, stl.Next):
        return at < STEPS and begins_within(formula.operand, at + 1)
    if isinstance(formula, stl.Always | stl.Eventually | stl.Until):
        width = STEPS if formula.last is None else formula.last
    below = [begins_within(each, min(STEPS, at + width)) for each in stl.operands(formula)]
    return at + first <= STEPS and all(below)


@pytest.mark.parametrize("seed", range(60))
def test_instants_beyond_a_plan_are_open_to_the_search_and_left_out_of_the_robustness(seed: int) -> None:
    generator = np.random.default_rng(seed)
    formula = random_formula(generator, 2, widest=6, past=False, constants=False)
    program = SpecificationProgram(POINT, generator.uniform(-2.0, 2.0, 2).round(2), STEPS, robustness_weight=1.0)
    program.require("it", formula, sets_of_halves(), open_future=True)  # type: ignore[arg-type]
    plan = program.solve()
    if plan.states is None:
        return
    samples = [
        np.array([float(np.dot(normal, state)) + offset for state in plan.states]) for normal, offset in PREDICATES
    ]
    low, high = robustness_interval(formula, samples, len(plan.states), 1, False, times=1)
    assert low[0, 0] - 1e-9 <= plan.robustness["it"] <= high[0, 0] + 1e-9
    assert high[0, 0] >= -1e-7
    if begins_within(formula):
        ended = robustness_interval(formula, samples, len(plan.states), 1, True, cut=True, times=1).low[0, 0]
        assert plan.robustness["it"] == pytest.approx(ended, abs=1e-9)


REGIONS = {
    "goal": Region(box=(2.0, 3.0, 2.0, 3.0)),
    "wall": Region(polygon=((0.5, 0.5), (1.6, 0.7), (1.2, 1.8))),
    "pond": Region(circle={"centre": (2.5, 0.5), "radius": 0.7}),
    "free": Region(intersection=(RegionShape(complement="wall"), RegionShape(complement="pond"))),
}


def placed(name: str) -> PlacedRegion:
    return PlacedRegion(name, REGIONS, lambda _: (np.zeros(2), None))


def region_program(text: str, state: Sequence[float], steps: int = 6) -> SpecificationProgram:
    said = formulation(text, REGIONS)
    program = SpecificationProgram(POINT, state, steps, robustness_weight=1.0)
    program.require("it", said.formula, predicate_sets(said, NAMES, REGIONS))
    return program


def test_a_plan_avoids_regions_and_is_at_least_as_robust_by_the_monitor_as_by_the_program() -> None:
    plan = region_program("always inside(position, free) and eventually[0, 6] inside(position, goal)", [0, 0]).solve()
    assert plan.states is not None
    free, goal = placed("free").robustness(plan.states), placed("goal").robustness(plan.states)
    assert min(free.min(), goal.max()) >= plan.robustness["it"] - 1e-9
    assert plan.robustness["it"] > 0.3


def test_a_distance_is_that_of_a_polygon_within_the_disc_or_around_it() -> None:
    near = region_program("always distance(position, [1, 1]) < 1.5", [1.2, 1.1], 3).solve()
    far = region_program("eventually[3, 3] distance(position, [1, 1]) > 2", [1.2, 1.1], 3).solve()
    assert near.states is not None
    assert far.states is not None
    nearest = np.hypot(*(near.states[1:] - 1.0).T)
    assert (nearest <= 1.5 - near.robustness["it"] + 1e-9).all()
    assert np.hypot(*(far.states[3] - 1.0)) >= 2.0 + far.robustness["it"] - 1e-9


def test_equal_programs_have_equal_solutions_to_the_byte() -> None:
    text = "always inside(position, free) and eventually[0, 6] inside(position, goal)"
    first, second = (region_program(text, [0, 0]).solve() for _ in range(2))
    assert first.states is not None
    assert second.states is not None
    assert first.states.tobytes() == second.states.tobytes()
    assert first.inputs is not None
    assert second.inputs is not None
    assert first.inputs.tobytes() == second.inputs.tobytes()


def test_past_states_are_fixed_and_count() -> None:
    formula = stl.And((stl.Eventually(0, 4, stl.Predicate(0)), stl.Always(0, 4, stl.Predicate(1))))
    sets = sets_of_halves()
    visited = np.array([[0.9, 0.0], [1.4, -0.4]])
    past = margins(sets, visited)  # type: ignore[arg-type]
    assert past[0] == pytest.approx([0.4, 0.9])
    program = SpecificationProgram(POINT, [0.4, -0.3], 2, robustness_weight=1.0)
    assert program.require("it", formula, sets, first=-2, past=past)  # type: ignore[arg-type]
    # The predicate held by 0.25 at first, which no plan can improve; and nothing more has to be visited.
    assert program.solve().robustness["it"] == pytest.approx(0.25)
    missed = [np.array([-0.1, -0.2]), np.array([0.1, -0.1])]
    assert not SpecificationProgram(POINT, [0.4, -0.3], 2).require("it", formula, sets, first=-2, past=missed)  # type: ignore[arg-type]


def test_margins_are_reduced_at_instants_to_come() -> None:
    formula = stl.Always(0, 2, stl.Predicate(0))
    program = SpecificationProgram(POINT, [1.0, 0.0], 2)
    program.require("it", formula, sets_of_halves(), reduction=lambda half_space, instant: 0.7 * instant)  # type: ignore[arg-type]
    plan = program.solve()
    assert plan.states is not None
    assert (plan.states[1:, 0] - 0.5 >= [0.7 - 1e-9, 1.4 - 1e-9]).all()


def test_a_tube_has_a_radius_that_costs_less_if_it_is_wide() -> None:
    program = SpecificationProgram(POINT, [1.0, 0.0], 1)
    (radius,) = program.program.add_variables(1, 0.1, 3.0, cost=-1.0)
    program.add_radius(1, radius, 0.1, 3.0)
    program.require("it", stl.Always(1, 1, stl.Predicate(0)), sets_of_halves())  # type: ignore[arg-type]
    plan = program.solve()
    assert plan.solution.values is not None
    assert plan.solution.values[radius] == pytest.approx(1.5)


def test_effort_is_quadratic_after_tangents_are_refined() -> None:
    program = SpecificationProgram(POINT, [0.0, 0.0], 3)
    program.require("it", stl.Eventually(3, 3, stl.Predicate(0)), sets_of_halves())  # type: ignore[arg-type]
    program.add_effort(1.0, tangents=3)
    plan = program.solve()
    assert plan.inputs is not None
    assert plan.inputs[:, 0] == pytest.approx([0.5 / 3] * 3, abs=1e-4)
    assert plan.solution.cost == pytest.approx(0.25 / 3, abs=1e-6)


def test_the_rest_of_a_plan_is_planned_again_with_the_same_alternatives() -> None:
    text = "always inside(position, free) and eventually[0, 6] inside(position, goal)"
    plan = region_program(text, [0, 0]).solve()
    assert plan.states is not None
    again = region_program(text, [0, 0]).solve_as_chosen(plan.states)
    assert again.status == "optimal"
    assert again.robustness["it"] == pytest.approx(plan.robustness["it"], abs=1e-6)


def test_without_limits_there_is_no_program() -> None:
    free = LinearDynamics.of(SingleIntegrator(), 1.0)
    with pytest.raises(ValueError, match="limits"):
        SpecificationProgram(free, [0.0, 0.0], 3)
