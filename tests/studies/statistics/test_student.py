"""The interval of a mean by Student's distribution."""

import math

import numpy as np
import pytest
import scipy.stats

from symaware_cli.studies.statistics.interval_estimate import student_mean


def test_the_interval_agrees_with_the_t_test() -> None:
    values = np.random.default_rng(1).normal(2.0, 3.0, 40)
    found = student_mean(values, 0.9)
    expected = scipy.stats.ttest_1samp(values, 0).confidence_interval(0.9)
    assert (found.lower, found.upper) == pytest.approx((expected.low, expected.high))
    assert found.value == pytest.approx(values.mean())
    assert found.count == 40


def test_too_few_values_give_an_infinite_interval_and_equal_ones_a_point() -> None:
    assert student_mean([1.0, math.nan]).halfwidth == math.inf
    assert math.isnan(student_mean([]).value)
    found = student_mean([0.1] * 3)
    assert found.lower == found.upper == found.value
