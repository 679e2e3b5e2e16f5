"""Bounds of the probability that a formula fails are never below it, whatever depends on what."""

import numpy as np
from formulas import PREDICATES, random_formula
from hypothesis import example, given, settings
from hypothesis import strategies as st

from symaware_cli.specification.monitor import Monitor
from symaware_cli.specification.probability import TruthBounds, truth_bounds

SAMPLES = 60
SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=200)
@given(seed=SEEDS)
@example(seed=372848)  # `not always[2,] once[1,] p` fails for certain from the first instant on, if p held there
def test_a_bound_is_never_below_the_share_of_samples_that_fail(seed: int) -> None:
    """The samples themselves are the distribution, with any dependence between their predicates and instants."""
    generator = np.random.default_rng(seed)
    # Without constants: of these, too, nothing is known after the last instant.
    formula = random_formula(generator, 3, constants=False)
    instants, first = 8, int(generator.integers(8))
    likely = generator.choice([0.02, 0.5, 0.98], (PREDICATES, instants, 1))
    holds = generator.random((PREDICATES, instants, SAMPLES)) < likely
    holds[:, :first] = holds[:, :first, :1]  # the past is known
    monitor = Monitor(formula, SAMPLES, interval=False)
    for t in range(instants):
        monitor.update(list(np.where(holds[:, t], 1.0, -1.0)))
    share = holds.mean(axis=2)[:, :, None]
    predicates = [TruthBounds(1.0 - each, each) for each in share]
    bounds = truth_bounds(formula, predicates, instants, 1)
    assert bounds.fails[0, 0] >= (monitor.verdict < 0).mean() - 1e-12
    assert bounds.holds[0, 0] >= (monitor.verdict > 0).mean() - 1e-12
    assert ((bounds.fails >= 0) & (bounds.fails <= 1) & (bounds.holds >= 0) & (bounds.holds <= 1)).all()


@settings(max_examples=200)
@given(seed=SEEDS)
@example(seed=42159)
@example(seed=42280)
def test_without_chance_a_bound_is_the_verdict(seed: int) -> None:
    generator = np.random.default_rng(seed)
    formula = random_formula(generator, 2, constants=False)
    instants, rows = 8, 5
    holds = generator.random((PREDICATES, instants, rows)) < 0.7
    monitor = Monitor(formula, rows, interval=False)
    for t in range(instants):
        monitor.update(list(np.where(holds[:, t], 1.0, -1.0)))
    predicates = [TruthBounds((~each).astype(float), each.astype(float)) for each in holds]
    bounds = truth_bounds(formula, predicates, instants, rows)
    decided = monitor.verdict != 0
    np.testing.assert_array_equal(bounds.fails[0][decided], (monitor.verdict < 0)[decided].astype(float))
    np.testing.assert_array_equal(bounds.holds[0][decided], (monitor.verdict > 0)[decided].astype(float))
