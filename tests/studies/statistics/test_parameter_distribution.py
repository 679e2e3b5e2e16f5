"""Distributions of parameters are those of the literature."""

import math
from typing import Any

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.studies.statistics.design import independent
from symaware_cli.studies.statistics.parameter_distribution import (
    Choice,
    LogUniformDistribution,
    NormalDistribution,
    ParameterDistribution,
    UniformDistribution,
)

POINTS = independent(3, ["x"], np.arange(20_000))[:, 0]


@pytest.mark.parametrize(
    ("distribution", "expected"),
    [
        (UniformDistribution(-2, 5), scipy.stats.uniform(-2, 7)),
        (NormalDistribution(3, 0.5), scipy.stats.norm(3, 0.5)),
        (LogUniformDistribution(1e-3, 10), scipy.stats.loguniform(1e-3, 10)),
    ],
)
def test_values_have_the_distribution(distribution: ParameterDistribution, expected: Any) -> None:
    values = np.array(distribution.values(POINTS))
    assert values == pytest.approx(expected.ppf(POINTS))
    assert scipy.stats.kstest(values, expected.cdf).pvalue > 0.001


@given(low=st.floats(-1e6, 1e6), width=st.floats(0, 1e6))
def test_no_value_is_outside_its_ends(low: float, width: float) -> None:
    values = UniformDistribution(low, low + width).values(np.array([2.0**-53, 0.5, 1 - 2.0**-53]))
    assert low <= min(values) <= max(values) <= low + width
    positive = LogUniformDistribution(1e-9 + abs(low), 1e-9 + abs(low) + width)
    assert all(positive.low <= value <= positive.high for value in positive.values(np.array([2.0**-53, 1 - 2.0**-53])))


def test_options_are_chosen_as_often_as_their_weights_say() -> None:
    options = ["wide", None, {"range": 3.0}]
    chosen = Choice(options, [1, 0, 3]).values(POINTS)
    assert None not in chosen
    assert chosen.count(options[2]) / len(chosen) == pytest.approx(0.75, abs=0.01)
    assert Choice([4, 8]).values(np.array([0.1, 0.5, 0.9])) == [4, 8, 8]
    assert Choice([4, 8, 9], [1, 2, 0]).values(np.array([1 - 2.0**-53])) == [8]


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: UniformDistribution(2, 1), "two finite ends in order, not 2 and 1"),
        (lambda: UniformDistribution(0, math.inf), "two finite ends"),
        (lambda: NormalDistribution(0, -1), "at least 0"),
        (lambda: LogUniformDistribution(0, 1), "greater than 0, not 0"),
        (lambda: Choice([]), "nothing to choose from"),
        (lambda: Choice([1, 2], [1]), "1 weights for 2 options"),
        (lambda: Choice([1, 2], [0, 0]), "one is greater"),
        (lambda: Choice([1, 2], [-1, 2]), "at least 0"),
    ],
)
def test_what_is_no_distribution_is_refused(make: Any, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        make()
