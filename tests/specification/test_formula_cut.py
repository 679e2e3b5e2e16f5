"""Windows that are longer than the run are cut, and the robustness stays the same."""

import numpy as np
import pytest
from formulas import random_formula, random_samples

from symaware_cli.evidence.semantics import robustness_interval
from symaware_cli.specification.formula import Always, Eventually, Historically, Once, Predicate, Until, cut, reach
from symaware_cli.specification.monitor import Monitor


def compared(seed: int, count: int) -> int:
    generator, changed = np.random.default_rng(seed), 0
    for _ in range(count):
        formula = random_formula(generator, 3, widest=int(generator.choice([3, 8, 20, 40])))
        instants = int(generator.integers(1, 7))
        samples = list(random_samples(generator, instants, 2))
        shorter = cut(formula, 2 * instants)
        changed += shorter != formula
        for ended in (False, True):
            for finite in (False, True):
                one, other = (
                    robustness_interval(each, samples, instants, 2, ended, cut=finite) for each in (formula, shorter)
                )
                assert np.array_equal(one.low, other.low), (formula, instants, ended, finite)
                assert np.array_equal(one.high, other.high), (formula, instants, ended, finite)
    return changed


def test_cut_windows_have_the_robustness_of_whole_ones() -> None:
    assert compared(1, 150) > 50


@pytest.mark.slow
def test_cut_windows_of_many_formulas_have_the_robustness_of_whole_ones() -> None:
    assert compared(2, 3000) > 900


FAR = 10**12


@pytest.mark.parametrize(
    "formula",
    [
        Always(0, FAR, Predicate(0)),
        Eventually(FAR, FAR, Predicate(0)),
        Until(0, FAR, Predicate(0), Predicate(0)),
        Always(0, None, Once(0, FAR, Predicate(0))),
        Always(0, FAR, Eventually(FAR, FAR, Predicate(0))),
        Historically(FAR, FAR, Once(0, FAR, Predicate(0))),
        Always(0, 3, Historically(2, FAR, Predicate(0))),
    ],
)
def test_windows_of_any_length_reach_little_further_than_the_run(formula: Always) -> None:
    shorter = cut(formula, 20)
    assert reach(shorter) < 100
    monitor = Monitor(shorter, 1)
    for value in (1.0, 2.0, 3.0):
        monitor.update([np.array([value])])
    monitor.finish()
