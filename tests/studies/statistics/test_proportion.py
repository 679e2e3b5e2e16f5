"""The interval of a share is exact, with a coverage of at least the confidence."""

import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.studies.statistics.interval_estimate import clopper_pearson


@given(count=st.integers(1, 2000), share=st.floats(0, 1), confidence=st.sampled_from([0.5, 0.9, 0.95, 0.999]))
def test_the_interval_agrees_with_the_exact_binomial_test(count: int, share: float, confidence: float) -> None:
    successes = round(share * count)
    found = clopper_pearson(successes, count, confidence)
    expected = scipy.stats.binomtest(successes, count).proportion_ci(confidence, method="exact")
    assert (found.lower, found.upper) == pytest.approx((expected.low, expected.high), abs=1e-9)
    assert found.covers(found.value)


@pytest.mark.parametrize("p", [0.001, 0.05, 0.3, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("count", [1, 10, 200])
def test_the_coverage_is_at_least_the_confidence(p: float, count: int) -> None:
    found = [clopper_pearson(successes, count) for successes in range(count + 1)]
    chances = scipy.stats.binom.pmf(np.arange(count + 1), count, p)
    covered = sum(chance for chance, each in zip(chances, found, strict=True) if each.covers(p))
    assert covered >= 0.95


def test_without_runs_the_interval_is_from_0_to_1() -> None:
    found = clopper_pearson(0, 0)
    assert math.isnan(found.value)
    assert (found.lower, found.upper) == (0, 1)


@pytest.mark.parametrize(("successes", "count"), [(3, 2), (-1, 2)])
def test_impossible_counts_are_rejected(successes: int, count: int) -> None:
    with pytest.raises(ValueError, match="successes among 2 runs"):
        clopper_pearson(successes, count)


@pytest.mark.parametrize("confidence", [0, 1, 95, math.nan])
def test_a_confidence_outside_0_to_1_is_rejected(confidence: float) -> None:
    with pytest.raises(ValueError, match=r"between 0 and 1, such as 0.95"):
        clopper_pearson(1, 2, confidence)
