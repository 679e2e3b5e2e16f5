"""Variants with common random numbers are compared run by run."""

import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.studies.statistics.paired import compare

PAIRS = st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=2, max_size=60)


def noisy(seed: int = 1, count: int = 50, shared: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    common = shared * random.normal(size=count)
    return common + random.normal(size=count), common + 0.5 + random.normal(size=count)


def test_the_interval_agrees_with_the_paired_t_test() -> None:
    first, second = noisy()
    found = compare(first, second)
    expected = scipy.stats.ttest_rel(second, first).confidence_interval(0.95)
    assert (found.mean.lower, found.mean.upper) == pytest.approx((expected.low, expected.high))
    assert found.mean.value == pytest.approx((second - first).mean())


def test_the_sign_test_is_a_binomial_test_without_ties() -> None:
    first, second = noisy()
    second[:5] = first[:5]
    found = compare(first, second)
    assert found.greater + found.less == 45
    expected = scipy.stats.binomtest(found.less, 45).pvalue
    assert found.sign_test == pytest.approx(expected)


def test_verdicts_are_compared_on_the_runs_in_which_they_differ() -> None:
    first = np.array([True] * 80 + [False] * 10 + [True] * 10)
    second = np.array([True] * 80 + [True] * 10 + [False] * 10)
    found = compare(first, second)
    assert (found.greater, found.less, found.sign_test, found.mean.value) == (10, 10, 1.0, 0.0)


def test_the_variance_ratio_measures_the_runs_saved_by_common_random_numbers() -> None:
    found = compare(*noisy(count=4000))
    # Variances of 10 each; the difference has a variance of 2.
    assert found.variance_ratio == pytest.approx(10, rel=0.15)
    assert found.correlation == pytest.approx(0.9, abs=0.02)


def test_common_random_numbers_can_do_harm() -> None:
    first, second = noisy(count=500)
    assert compare(first, -second).variance_ratio < 1
    assert compare(first, -second).correlation < 0


@pytest.mark.parametrize("seed", range(3))
def test_the_interval_of_the_mean_has_about_the_nominal_coverage(seed: int) -> None:
    covered = sum(compare(*noisy(1000 * seed + stream, 20)).mean.covers(0.5) for stream in range(400))
    assert covered / 400 == pytest.approx(0.95, abs=0.035)


@given(pairs=PAIRS)
def test_exchanging_the_variants_flips_the_signs(pairs: list[tuple[float, float]]) -> None:
    first, second = np.array(pairs).T
    found, other = compare(first, second), compare(second, first)
    assert found.mean.lower == pytest.approx(-other.mean.upper, abs=1e-9)
    assert (found.median.lower, found.median.upper) == (-other.median.upper, -other.median.lower)
    assert (found.greater, found.less, found.sign_test) == (other.less, other.greater, other.sign_test)
    assert found.variance_ratio == pytest.approx(other.variance_ratio, nan_ok=True)


def test_runs_without_a_value_are_left_out_of_both_variants() -> None:
    assert compare([1, math.nan, 3, 4.5], [2, 3, math.nan, 5]) == compare([1, 4.5], [2, 5])


def test_a_constant_difference_gives_a_point_and_equal_variants_no_variance_ratio() -> None:
    found = compare([1, 2, 4], [2, 3, 5])
    assert (found.mean.lower, found.mean.upper, found.variance_ratio) == (1, 1, math.inf)
    assert math.isnan(compare([1, 1], [1, 1]).variance_ratio)
    assert compare([1, 2], [1, 2]).sign_test == 1.0


def test_too_few_runs_give_infinite_intervals() -> None:
    assert compare([], []).mean.halfwidth == math.inf
    assert compare([1], [2]).mean.value == 1


def test_values_that_cannot_be_compared_are_rejected() -> None:
    with pytest.raises(ValueError, match="run by run"):
        compare([1, 2], [1])
    with pytest.raises(ValueError, match="infinite"):
        compare([1, 2], [1, math.inf])
