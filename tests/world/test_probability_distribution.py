"""Distributions are those of the literature."""

import math
from typing import Any

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.world import ProbabilityDistribution, VectorDistribution
from symaware_cli.world.probability_distribution import always

POINTS = np.random.default_rng(3).random(20_000)


def of(**content: Any) -> ProbabilityDistribution:
    return ProbabilityDistribution(**content)


@pytest.mark.parametrize(
    ("distribution", "expected"),
    [
        (of(uniform=(-2, 5)), scipy.stats.uniform(-2, 7)),
        (of(normal=(3, 0.5)), scipy.stats.norm(3, 0.5)),
        (of(normal=(3, 0.5), constant=1), scipy.stats.norm(4, 0.5)),
        (of(normal=(0.1, 0.2), least=0), scipy.stats.truncnorm(-0.5, np.inf, 0.1, 0.2)),
        (of(normal=(0.1, 0.2), least=-0.1, greatest=0.2), scipy.stats.truncnorm(-1, 0.5, 0.1, 0.2)),
        (of(lognormal=(0.1, 0.5)), scipy.stats.lognorm(0.5, scale=0.1)),
        (of(loguniform=(1e-3, 10)), scipy.stats.loguniform(1e-3, 10)),
        (of(exponential=0.05), scipy.stats.expon(scale=0.05)),
        (of(exponential=0.05, constant=0.02), scipy.stats.expon(0.02, 0.05)),
        (of(exponential=0.5, greatest=1.0), scipy.stats.truncexpon(2, scale=0.5)),
    ],
)
def test_values_have_the_distribution(distribution: ProbabilityDistribution, expected: Any) -> None:
    values = np.array(distribution.values(POINTS))
    assert values == pytest.approx(expected.ppf(POINTS))
    assert scipy.stats.kstest(values, expected.cdf).pvalue > 0.001
    assert distribution.lowest == pytest.approx(expected.support()[0])


def test_truncated_draws_are_distributed_like_draws_within_the_bounds() -> None:
    whole, part = of(lognormal=(0.1, 0.5)), of(lognormal=(0.1, 0.5), least=0.08, greatest=0.3)
    within = [value for value in whole.values(POINTS) if 0.08 <= value <= 0.3]
    assert 0.08 <= min(part.values(POINTS)) <= max(part.values(POINTS)) <= 0.3
    assert scipy.stats.ks_2samp(within, part.values(POINTS)).pvalue > 0.001


@given(low=st.floats(-1e6, 1e6), width=st.floats(0, 1e6))
def test_no_value_is_outside_its_ends(low: float, width: float) -> None:
    points = np.array([0.0, 2.0**-53, 0.5, 1 - 2.0**-53, 1.0])
    for form, first in (("uniform", low), ("loguniform", 1e-9 + abs(low))):
        values = of(**{form: (first, first + width)}).values(points)
        assert first <= min(values) <= max(values) <= first + width


@pytest.mark.parametrize("content", [{"normal": (0.0, 1.0)}, {"lognormal": (1.0, 1.0)}, {"exponential": 1.0}])
def test_every_value_is_finite(content: dict[str, Any]) -> None:
    for bounds in ({}, {"least": 0.5}, {"greatest": 0.5}, {"least": 4.0, "greatest": 5.0}):
        assert np.isfinite(of(**content, **bounds).values(np.array([0.0, 1e-300, 0.5, 1.0]))).all()


def test_without_a_deviation_all_values_are_the_mean() -> None:
    assert of(normal=(0.0, 0.0), least=0).values(POINTS[:3]) == [0.0] * 3
    assert of(normal=(2.0, 0.0), least=0, greatest=2).values(POINTS[:3]) == [2.0] * 3
    assert of(lognormal=(2.0, 0.0)).values(POINTS[:3]) == [2.0] * 3
    assert of(exponential=0.0, constant=1.0).values(POINTS[:3]) == [1.0] * 3


def test_options_are_drawn_in_proportion_to_their_weights() -> None:
    options = ["wide", None, {"range": 3.0}]
    chosen = of(choice=options, weights=[1, 0, 3]).values(POINTS)
    assert None not in chosen
    assert chosen.count(options[2]) / len(chosen) == pytest.approx(0.75, abs=0.01)
    assert of(choice=[4, 8]).values(np.array([0.1, 0.5, 0.9])) == [4, 8, 8]
    assert of(choice=[4, 8, 9], weights=[1, 2, 0]).values(np.array([1 - 2.0**-53])) == [8]
    assert of(choice="1..3").choice == (1, 2, 3)


def test_constants_are_not_drawn() -> None:
    assert not always(0.25).is_drawn
    assert always(0.25).quantile(0.1) == 0.25
    assert [always(value).is_zero for value in (0.0, 1e-12, 1e-9)] == [True, True, False]
    assert not of(uniform=(0, 0)).is_zero


def test_standard_normal_numbers_are_scaled_as_quantiles_are() -> None:
    for content in ({"normal": (3, 0.5)}, {"normal": (3, 0.5), "constant": 1}):
        distribution = of(**content)
        assert distribution.scaled(scipy.stats.norm.ppf(POINTS)) == pytest.approx(distribution.quantiles(POINTS))
    assert not of(normal=(3, 0.5), least=0).is_plain_normal
    assert not of(lognormal=(3, 0.5)).is_plain_normal


def test_numbers_for_each_element_are_drawn_beside_each_other() -> None:
    several = VectorDistribution(normal=([0.0, 10.0], 2.0), least=0)
    points = POINTS[:20].reshape(10, 2)
    assert several.elements == 2
    for element, mean in enumerate((0.0, 10.0)):
        alone = of(normal=(mean, 2.0), least=0)
        assert several.quantiles(points)[:, element].tolist() == alone.quantiles(points[:, element]).tolist()


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({}, "exactly one of"),
        ({"uniform": (0, 1), "normal": (0, 1)}, "exactly one of"),
        ({"uniform": (2, 1)}, "low end 2.0 lies above the high end 1.0"),
        ({"uniform": (0, math.inf)}, "finite number"),
        ({"uniform": (-1.7e308, 1.7e308)}, "too wide"),
        ({"normal": (0, -1)}, "at least 0"),
        ({"lognormal": (1, 11)}, "at most 10"),
        ({"lognormal": (-1, 1)}, "at least 0"),
        ({"exponential": -1}, "at least 0"),
        ({"loguniform": (0, 1)}, "greater than 0, not 0"),
        ({"choice": []}, "at least 1 item"),
        ({"choice": [1, 2], "weights": [1]}, "1 weights for 2 options"),
        ({"choice": [1, 2], "weights": [0, 0]}, "one is greater"),
        ({"choice": [1, 2], "weights": [-1, 2]}, "at least 0"),
        ({"choice": [1, 2], "constant": 1}, "other forms"),
        ({"uniform": (0, 1), "weights": [1]}, "weights go with `choice`"),
        ({"uniform": (0, 1), "least": 0}, "`least` is for distributions"),
        ({"normal": (0, 1), "greatest": -40}, "`greatest` excludes nearly all"),
        ({"normal": (0, 1), "least": 2, "greatest": 1}, "`least` excludes nearly all"),
    ],
)
def test_invalid_distributions_are_refused(content: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        of(**content)
