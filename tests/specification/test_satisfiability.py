"""Formulas that no truths of their propositions satisfy in a run of a given length are found."""

import itertools

import numpy as np
import pytest
from formulas import PREDICATES, random_formula

from symaware_cli.evidence.semantics import robustness_interval
from symaware_cli.specification.formula import Always, And, Eventually, Formula, Next, Not, Or, Predicate, Until
from symaware_cli.specification.satisfiability import can_be_satisfied

P, Q = Predicate(0), Predicate(1)


@pytest.mark.parametrize("seed", range(30))
def test_it_is_what_trying_all_truths_gives(seed: int) -> None:
    generator = np.random.default_rng(seed)
    for _ in range(4):
        instants = int(generator.integers(1, 4))
        formula = random_formula(generator, int(generator.integers(1, 4)))
        rows = np.array(list(itertools.product((-1.0, 1.0), repeat=PREDICATES * instants)))
        samples = rows.reshape(-1, PREDICATES, instants).transpose(1, 2, 0)
        (low,), _ = robustness_interval(formula, list(samples), instants, len(rows), ended=True, times=1)
        assert can_be_satisfied(formula, PREDICATES, instants) == bool((low > 0.0).any()), (formula, instants)


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        (Always(0, None, Next(P)), False),
        (Always(0, None, Next(P, weak=True)), True),
        (Always(0, None, Or((Not(P), Next(P)))), True),
        (And((P, Always(0, None, Or((Not(P), Next(P)))))), False),
        (And((P, Always(0, None, Or((Not(P), Next(P, weak=True)))), Eventually(0, None, Not(P)))), False),
        (And((Always(0, None, Eventually(0, None, P)), Eventually(0, None, Always(0, None, Not(P))))), False),
        (And((Eventually(0, None, P), Eventually(0, None, Not(P)))), True),
        (And((Until(0, None, P, Q), Always(0, None, Not(Q)))), False),
        (Always(0, 50, P), False),
        (Eventually(0, 50, P), True),
    ],
)
def test_formulas_over_forty_instants(formula: Formula, expected: bool) -> None:
    assert can_be_satisfied(formula, 2, 40) is expected


def test_formulas_beyond_the_budget_stay_open() -> None:
    assert can_be_satisfied(Always(0, None, Next(P)), 1, 10**9) is None
