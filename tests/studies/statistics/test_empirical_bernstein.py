"""The intervals of a bounded mean are valid at all times simultaneously."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.studies.statistics.confidence_sequence import EmpiricalBernstein
from symaware_cli.studies.statistics.interval_estimate import Array

UNIT = st.lists(st.floats(0, 1), min_size=1, max_size=60)


def reference(values: list[float], alpha: float) -> tuple[float, float]:
    """Return the interval of theorem 2, computed value by value, before intersection with the previous ones."""
    mean, variance, total, squares = 0.5, 0.25, 0.0, 0.0
    bets = gains = penalty = 0.0
    for index, value in enumerate(values, 1):
        bet = min(0.5, math.sqrt(2 * math.log(2 / alpha) / (variance * index * math.log(1 + index))))
        penalty += 4 * (value - mean) ** 2 * (-math.log(1 - bet) - bet) / 4
        bets += bet
        gains += bet * value
        total += value
        mean = (0.5 + total) / (index + 1)
        squares += (value - mean) ** 2
        variance = (0.25 + squares) / (index + 1)
    margin = (math.log(2 / alpha) + penalty) / bets
    return gains / bets - margin, gains / bets + margin


@given(values=UNIT, alpha=st.sampled_from([0.01, 0.05, 0.5]))
def test_the_interval_ends_agree_with_the_theorem(values: list[float], alpha: float) -> None:
    found = [reference(values[:count], alpha) for count in range(1, len(values) + 1)]
    lower, upper = EmpiricalBernstein(0, 1, 1 - alpha).update(values)
    expected_lower = max(0.0, *(each[0] for each in found))
    expected_upper = min(1.0, *(each[1] for each in found))
    if expected_lower < expected_upper:
        assert (lower[-1], upper[-1]) == pytest.approx((expected_lower, expected_upper), abs=1e-9)


@given(values=UNIT, cuts=st.lists(st.integers(0, 60), max_size=5))
def test_splitting_the_values_into_blocks_does_not_change_the_intervals(values: list[float], cuts: list[int]) -> None:
    whole, parts = EmpiricalBernstein(0, 1, 0.5), EmpiricalBernstein(0, 1, 0.5)
    lower, upper = whole.update(values)
    blocks = [parts.update(block) for block in np.split(values, sorted(min(cut, len(values)) for cut in cuts))]
    assert np.concatenate([block[0] for block in blocks]).tolist() == lower.tolist()
    assert np.concatenate([block[1] for block in blocks]).tolist() == upper.tolist()
    assert parts.estimate() == whole.estimate()
    assert (np.diff(lower) >= 0).all()
    assert (np.diff(upper) <= 0).all()
    assert (lower <= upper).all()


@given(values=UNIT, low=st.floats(-100, 100), width=st.floats(0.1, 100))
def test_intervals_scale_with_the_unit_of_the_values(values: list[float], low: float, width: float) -> None:
    unit, other = EmpiricalBernstein(0, 1, 0.9), EmpiricalBernstein(low, low + width, 0.9)
    unit.update(values)
    other.update(np.clip(low + width * np.array(values), low, low + width))
    found, expected = other.estimate(), unit.estimate()
    assert found.lower == pytest.approx(low + width * expected.lower, abs=1e-6)
    assert found.upper == pytest.approx(low + width * expected.upper, abs=1e-6)
    assert found.value == pytest.approx(low + width * expected.value, abs=1e-6)


def uniform(random: np.random.Generator, shape: tuple[int, int]) -> Array:
    return random.random(shape)


def beta(random: np.random.Generator, shape: tuple[int, int]) -> Array:
    return random.beta(10, 30, shape)


def rare(random: np.random.Generator, shape: tuple[int, int]) -> Array:
    """A distribution on 0 and 1, in which 1 is rare."""
    return (random.random(shape) < 0.02).astype(float)


@pytest.mark.parametrize(("draw", "mean"), [(uniform, 0.5), (beta, 0.25), (rare, 0.02)])
def test_all_intervals_of_a_stream_jointly_have_the_nominal_coverage(draw, mean: float) -> None:  # type: ignore[no-untyped-def]
    streams = 2000
    values = draw(np.random.default_rng(8), (1000, streams))
    lower, upper = EmpiricalBernstein(0, 1, streams=(streams,)).update(values)
    assert ((lower <= mean) & (mean <= upper)).all(axis=0).mean() >= 0.95


def test_the_interval_is_narrower_for_values_with_less_variance() -> None:
    wide, narrow = EmpiricalBernstein(0, 1), EmpiricalBernstein(0, 1)
    random = np.random.default_rng(9)
    wide.update(random.integers(0, 2, 1000))
    narrow.update(random.normal(0.5, 0.02, 1000))
    assert narrow.estimate().halfwidth < 0.25 * wide.estimate().halfwidth


def test_invalid_bounds_and_values_outside_them_are_rejected() -> None:
    with pytest.raises(ValueError, match="the value 3 is outside the bounds 0 and 2"):
        EmpiricalBernstein(0, 2).update([1, 3])
    for low, high in ((1, 0), (0, math.inf), (0, 0), (math.nan, 1)):
        with pytest.raises(ValueError, match="two numbers in order"):
            EmpiricalBernstein(low, high)


def test_the_interval_without_values_spans_the_bounds() -> None:
    found = EmpiricalBernstein(-1, 3).estimate()
    assert (found.lower, found.upper, found.count) == (-1, 3, 0)
    assert math.isnan(found.value)
