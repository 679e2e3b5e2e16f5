"""The bootstrap agrees with the literature, and is determined by seed and name."""

import math

import numpy as np
import pytest
import scipy.stats

from symaware_cli.studies.statistics.interval_estimate import bootstrap_mean


def exponential(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).exponential(size=count)


def test_the_interval_agrees_with_scipy_up_to_resampling_noise() -> None:
    values = exponential(60)
    found = bootstrap_mean(values, 7, "closest")
    expected = scipy.stats.bootstrap((values,), np.mean, n_resamples=20_000, random_state=np.random.default_rng(2))
    interval = expected.confidence_interval
    assert (found.lower, found.upper) == pytest.approx((interval.low, interval.high), abs=0.05 * found.halfwidth)
    assert found.value == values.mean()


def test_the_interval_has_about_the_nominal_coverage() -> None:
    covered = sum(bootstrap_mean(exponential(80, seed), seed, "x").covers(1.0) for seed in range(300))
    assert 0.90 <= covered / 300 <= 0.98


def test_the_interval_depends_only_on_the_seed_and_the_name() -> None:
    values = exponential(40)
    found = bootstrap_mean(values, 7, "closest")
    assert bootstrap_mean(values, 7, "closest") == found
    assert bootstrap_mean(values, 8, "closest") != found
    assert bootstrap_mean(values, 7, "effort") != found


def test_the_interval_shifts_and_scales_with_the_values() -> None:
    values = exponential(40)
    one, other = bootstrap_mean(values, 7, "x"), bootstrap_mean(1e6 + 2 * values, 7, "x")
    assert (other.lower, other.upper) == pytest.approx((1e6 + 2 * one.lower, 1e6 + 2 * one.upper))


def test_resamples_of_many_values_are_computed_in_parts() -> None:
    values = exponential(3_000)
    assert bootstrap_mean(values, 7, "x").halfwidth == pytest.approx(1.96 * values.std() / math.sqrt(3_000), rel=0.1)


def test_too_few_values_give_an_infinite_interval_and_equal_ones_a_point() -> None:
    assert bootstrap_mean([], 1, "x").halfwidth == math.inf
    assert bootstrap_mean([2.0, math.nan], 1, "x").lower == -math.inf
    same = bootstrap_mean([0.1] * 3, 1, "x")
    assert same.lower == same.value == same.upper == pytest.approx(0.1)
