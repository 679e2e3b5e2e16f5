"""The interval of a quantile consists of two order statistics, and is valid for any distribution."""

import math
from typing import Any

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.studies.statistics.interval_estimate import quantile


@given(count=st.integers(6, 300), probability=st.sampled_from([0.1, 0.5, 0.9]), seed=st.integers(0, 100))
def test_the_interval_agrees_with_the_quantile_test_of_scipy(count: int, probability: float, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=count)
    found = quantile(values, probability)
    q = float(np.quantile(values, probability))
    # SciPy's type stubs declare the interval as a number.
    expected: Any = scipy.stats.quantile_test(values, q=q, p=probability).confidence_interval(0.95)
    for mine, its in ((found.lower, expected.low), (found.upper, expected.high)):
        assert mine == its or (math.isinf(mine) and math.isnan(its))


@pytest.mark.parametrize("probability", [0.05, 0.5, 0.99])
def test_the_coverage_is_at_least_the_confidence(probability: float) -> None:
    samples = np.random.default_rng(4).uniform(size=(1000, 80))
    covered = sum(quantile(sample, probability).covers(probability) for sample in samples)
    assert covered / 1000 >= 0.95 - 3 * math.sqrt(0.95 * 0.05 / 1000)


def test_an_end_is_infinite_if_no_value_is_extreme_enough() -> None:
    found = quantile(np.arange(10.0), 0.99)
    assert math.isfinite(found.lower)
    assert found.upper == math.inf


def test_missing_values_are_left_out() -> None:
    assert quantile([3.0, math.nan, 1.0, 2.0], 0.5) == quantile([1.0, 2.0, 3.0], 0.5)
    assert math.isnan(quantile([math.nan], 0.5).value)
    assert quantile([], 0.5).halfwidth == math.inf


def test_invalid_arguments_of_a_quantile_are_rejected() -> None:
    with pytest.raises(ValueError, match="infinite"):
        quantile([1.0, math.inf], 0.5)
    with pytest.raises(ValueError, match="2 axes"):
        quantile([[1.0]], 0.5)
    with pytest.raises(ValueError, match="between 0 and 1, not 1"):
        quantile([1.0], 1.0)
