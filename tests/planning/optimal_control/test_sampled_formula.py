"""A plan with longer steps than the world satisfies a formula at all instants, if it moves on straight ways."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from symaware_cli.geometry.region import Region
from symaware_cli.planning.optimal_control.affine_predicate import Affine, Face, StateSet, margin, predicate_sets
from symaware_cli.planning.optimal_control.formula_tree import FormulaTree, KnownMargin
from symaware_cli.planning.optimal_control.sampled_formula import sampled
from symaware_cli.specification import formula as stl
from symaware_cli.specification.formulation import Formulation, formulate
from symaware_cli.specification.parser import parse

Array = NDArray[np.float64]

EVERY = 5
STEP = 200_000_000
REGIONS = {"wall": Region(box=(-1.0, 1.0, -1.0, 1.0)), "shelf": Region(box=(0.5, 3.0, -3.0, 3.0))}
FORMULAS = (
    "always[0, 4] not inside(position, wall)",
    "always inside(position, shelf)",
    "eventually[0.4, 3] always[0, 1] inside(position, shelf)",
    "always[0, 2] (not inside(position, wall) or eventually[0, 2] inside(position, shelf))",
    "not eventually[0, 3] (inside(position, wall) and not inside(position, shelf))",
)


def formulation(text: str) -> Formulation:
    return formulate(parse(text, ["position", *REGIONS], {"inside": 2}), STEP)


def robustness(formula: stl.Formula, sets: list[tuple[StateSet, StateSet]], states: Array) -> float:
    """The robustness on known states."""

    def leaf(half_space: Face, instant: int) -> KnownMargin:
        return KnownMargin(margin(half_space, states[instant]))

    tree = FormulaTree(formula, sets, 0, len(states) - 1, leaf, KnownMargin, lambda index, instant: None)
    return tree.value(tree.root, lambda each: 0.0)


@pytest.mark.parametrize("text", FORMULAS)
def test_predicates_at_the_steps_of_a_plan_hold_at_all_instants_between(text: str) -> None:
    made = formulation(text)
    sets = predicate_sets(made, {"position": Affine(np.eye(2))}, REGIONS)
    coarse = sampled(made.formula, sets, EVERY)
    generator = np.random.Generator(np.random.PCG64(7))
    held = 0
    for _ in range(400):
        corners = np.cumsum(generator.normal(size=(5, 2)) * 1.5, axis=0) + generator.normal(size=2)
        times = np.arange(4 * EVERY + 1) / EVERY
        way = np.stack([np.interp(times, np.arange(5), column) for column in corners.T], axis=1)
        promised = robustness(coarse.formula, list(coarse.sets), corners)
        if promised > 0.0:
            held += 1
            assert robustness(made.formula, sets, way) >= min(promised, 1e-9) - 1e-9
    assert held >= 3


def test_a_plan_that_jumps_over_a_wall_satisfies_the_formula_of_the_world_alone() -> None:
    made = formulation(FORMULAS[0])
    sets = predicate_sets(made, {"position": Affine(np.eye(2))}, REGIONS)
    coarse = sampled(made.formula, sets, EVERY)
    corners = np.array([[-2.0, 0.0], [2.0, 0.0], [2.0, 0.0], [2.0, 0.0], [2.0, 0.0]])
    assert robustness(coarse.formula, list(coarse.sets), corners) < 0.0
    assert robustness(made.formula, sets, corners) > 0.0


def test_operators_without_such_a_formula_are_refused() -> None:
    made = formulation("inside(position, shelf) until[0, 2] inside(position, wall)")
    sets = predicate_sets(made, {"position": Affine(np.eye(2))}, REGIONS)
    with pytest.raises(ValueError, match="until"):
        sampled(made.formula, sets, EVERY)
    assert sampled(made.formula, sets, 1).formula is made.formula
