"""Variants on common chance are compared run by run."""

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


def test_the_interval_is_that_of_the_paired_t_test() -> None:
    first, second = noisy()
    found = compare(first, second)
    expected = scipy.stats.ttest_rel(second, first).confidence_interval(0.95)
    assert (found.mean.lower, found.mean.upper) == pytest.approx((expected.low, expected.high))
    assert found.mean.value == pytest.approx((second - first).mean())


def test_the_sign_test_is_the_binomial_one_without_ties() -> None:
    first, second = noisy()
    second[:5] = first[:5]
    found = compare(first, second)
    assert found.greater + found.less == 45
    expected = scipy.stats.binomtest(found.less, 45).pvalue
    assert found.sign_test == pytest.approx(expected)


def test_verdicts_are_compared_by_the_runs_in_which_they_differ() -> None:
    first = np.array([True] * 80 + [False] * 10 + [True] * 10)
    second = np.array([True] * 80 + [True] * 10 + [False] * 10)
    found = compare(first, second)
    assert (found.greater, found.less, found.sign_test, found.mean.value) == (10, 10, 1.0, 0.0)


def test_the_variance_ratio_tells_how_many_runs_common_chance_saves() -> None:
    found = compare(*noisy(count=4000))
    # Variances 10 each; that of the difference 2.
    assert found.variance_ratio == pytest.approx(10, rel=0.15)
    assert found.correlation == pytest.approx(0.9, abs=0.02)


def test_common_chance_may_do_harm() -> None:
    first, second = noisy(count=500)
    assert compare(first, -second).variance_ratio < 1
    assert compare(first, -second).correlation < 0


@pytest.mark.parametrize("seed", range(3))
def test_the_interval_of_the_mean_covers_about_as_often_as_it_says(seed: int) -> None:
    covered = sum(compare(*noisy(1000 * seed + stream, 20)).mean.covers(0.5) for stream in range(400))
    assert covered / 400 == pytest.approx(0.95, abs=0.035)


@given(pairs=PAIRS)
def test_exchanging_the_variants_exchanges_the_signs(pairs: list[tuple[float, float]]) -> None:
    first, second = np.array(pairs).T
    found, other = compare(first, second), compare(second, first)
    assert found.mean.lower == pytest.approx(-other.mean.upper, abs=1e-9)
    assert (found.median.lower, found.median.upper) == (-other.median.upper, -other.median.lower)
    assert (found.greater, found.less, found.sign_test) == (other.less, other.greater, other.sign_test)
    assert found.variance_ratio == pytest.approx(other.variance_ratio, nan_ok=True)


def test_runs_without_a_value_are_left_out_in_both() -> None:
    assert compare([1, math.nan, 3, 4.5], [2, 3, math.nan, 5]) == compare([1, 4.5], [2, 5])


def test_variants_that_differ_by_a_constant_have_a_point_and_those_that_are_equal_no_ratio() -> None:
    found = compare([1, 2, 4], [2, 3, 5])
    assert (found.mean.lower, found.mean.upper, found.variance_ratio) == (1, 1, math.inf)
    assert math.isnan(compare([1, 1], [1, 1]).variance_ratio)
    assert compare([1, 2], [1, 2]).sign_test == 1.0


def test_few_runs_say_nothing() -> None:
    assert compare([], []).mean.halfwidth == math.inf
    assert compare([1], [2]).mean.value == 1


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(ValueError, match="run by run"):
        compare([1, 2], [1])
    with pytest.raises(ValueError, match="infinite"):
        compare([1, 2], [1, math.inf])
