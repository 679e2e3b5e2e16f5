"""Splitting on a walk with known probabilities is unbiased, and its interval has the nominal coverage."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from symaware_cli.evidence.splitting import StageCount, mean_of_repeats, product, split

LEVELS = (8, 11, 14, 17, 20)


class Walk:
    """A walk on the sites 0 to 20 from site 5, as a process: its state is its site and the number of steps taken."""

    def __init__(self, up: float, steps: int = 10**9) -> None:
        self.up = up
        self.steps = steps

    def begin(self) -> tuple[int, int]:
        return 5, 0

    def reach(self, state: tuple[int, int], stage: int, seed: int) -> tuple[int, int] | None:
        (site, made), draw = state, random.Random(seed).random
        while site < LEVELS[stage]:
            if site == 0 or made == self.steps:
                return None
            site += 1 if draw() < self.up else -1
            made += 1
        return site, made


def ruin(up: float) -> float:
    """Return the probability of reaching site 20 before site 0, from site 5 (Feller, volume 1, chapter XIV)."""
    ratio = (1 - up) / up
    return (1 - ratio**5) / (1 - ratio**20)


def estimates(walk: Walk, trials: int, repeats: int, seed: int = 0) -> list[float]:
    """Return the estimates of several repeats."""
    own = range(seed, seed + repeats)
    return [product(split(walk, len(LEVELS), trials, each), len(LEVELS)) for each in own]


@pytest.mark.parametrize(("up", "steps", "known"), [(0.45, 10**9, 0.0317916305), (0.45, 100, 0.0195389499)])
def test_the_interval_of_repeats_covers_the_known_probability(up: float, steps: int, known: float) -> None:
    found = mean_of_repeats(estimates(Walk(up, steps), 50, 100), 0.999)
    assert found.covers(known)
    assert found.halfwidth < 0.2 * known


def test_trials_that_do_not_divide_evenly_cause_no_bias() -> None:
    found = np.array(estimates(Walk(0.45), 3, 4000))
    assert abs(found.mean() - ruin(0.45)) < 4.0 * found.std() / math.sqrt(len(found))


def test_the_interval_covers_a_probability_of_one_in_three_hundred_thousand() -> None:
    assert ruin(0.3) == pytest.approx(2.9787e-6, rel=1e-4)
    found = mean_of_repeats(estimates(Walk(0.3), 200, 30), 0.99)
    assert found.covers(ruin(0.3))
    assert found.upper < 5e-6


def test_a_repeat_with_an_unreached_level_gives_0() -> None:
    counts = split(Walk(0.0), len(LEVELS), 10, 1)
    assert counts == [StageCount(10, 0)]
    assert product(counts, len(LEVELS)) == 0.0


def test_the_interval_is_trivial_for_one_repeat_or_without_events() -> None:
    for sample in ([0.2], [0.0, 0.0, 0.0]):
        found = mean_of_repeats(sample)
        assert (found.lower, found.upper) == (0.0, 1.0)


def test_the_interval_is_computed_for_the_logarithm() -> None:
    found = mean_of_repeats([0.01, 0.02, 0.03])
    margin = 4.302652729749464 * 0.01 / math.sqrt(3) / 0.02  # t(0.975; 2)
    assert found.value == pytest.approx(0.02)
    assert (found.lower, found.upper) == pytest.approx((0.02 * math.exp(-margin), 0.02 * math.exp(margin)))


@pytest.mark.slow
def test_an_interval_of_95_percent_has_about_the_nominal_coverage() -> None:
    walk, known = Walk(0.45), ruin(0.45)
    covered = [mean_of_repeats(estimates(walk, 40, 10, 10 * number)).covers(known) for number in range(300)]
    assert 0.9 <= sum(covered) / len(covered) <= 0.99
