"""The intervals of a share are valid at all times simultaneously."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import betaln, xlog1py, xlogy

from symaware_cli.studies.statistics.confidence_sequence import BetaMixture, bounds


def martingale(p: float, successes: int, count: int) -> float:
    """Return the logarithm of M_n(p), as defined in the docstring of `BetaMixture`."""
    failures = count - successes
    mixed = betaln(0.5 + successes, 0.5 + failures) - betaln(0.5, 0.5)
    return float(mixed - xlogy(successes, p) - xlog1py(failures, -p))


@settings(deadline=None)
@given(count=st.integers(1, 10**6), share=st.floats(0, 1), alpha=st.sampled_from([0.001, 0.05, 0.5]))
def test_the_martingale_reaches_its_threshold_at_the_ends(count: int, share: float, alpha: float) -> None:
    successes = round(share * count)
    lower, upper = (float(end[0]) for end in bounds(np.array([float(successes)]), np.array([float(count)]), alpha))
    goal, estimate = math.log(1 / alpha), successes / count
    if successes:
        expected = brentq(lambda p: martingale(p, successes, count) - goal, 1e-300, estimate, xtol=1e-15)
        assert lower == pytest.approx(expected, rel=1e-6)
    else:
        assert lower == 0
    if successes < count:
        expected = brentq(lambda p: martingale(p, successes, count) - goal, estimate, 1 - 1e-16, xtol=1e-15)
        assert upper == pytest.approx(expected, rel=1e-6)
    else:
        assert upper == 1


@given(values=st.lists(st.booleans(), min_size=1, max_size=60), cuts=st.lists(st.integers(0, 60), max_size=5))
def test_splitting_the_values_into_blocks_does_not_change_the_intervals(values: list[bool], cuts: list[int]) -> None:
    whole, parts = BetaMixture(), BetaMixture()
    array = np.array(values, float)
    lower, upper = whole.update(array)
    blocks = [parts.update(block) for block in np.split(array, sorted(min(cut, len(values)) for cut in cuts))]
    assert np.concatenate([block[0] for block in blocks]).tolist() == lower.tolist()
    assert np.concatenate([block[1] for block in blocks]).tolist() == upper.tolist()
    assert parts.estimate() == whole.estimate()
    assert whole.estimate().value == pytest.approx(array.mean())


@given(values=st.lists(st.booleans(), min_size=1, max_size=400))
def test_intervals_are_nested(values: list[bool]) -> None:
    lower, upper = BetaMixture(0.5).update(np.array(values, float))
    assert (np.diff(lower) >= 0).all()
    assert (np.diff(upper) <= 0).all()
    assert (lower <= upper).all()
    assert lower[0] >= 0
    assert upper[0] <= 1


def test_an_empty_intersection_of_intervals_leaves_a_point() -> None:
    values = np.array([1.0] * 100 + [0.0] * 300)
    whole, parts = BetaMixture(), BetaMixture()
    lower, upper = whole.update(values)
    assert lower[-1] == upper[-1] == lower[99]
    singly = [parts.update(values[index : index + 1]) for index in range(len(values))]
    assert [float(each[0][0]) for each in singly] == lower.tolist()
    assert [float(each[1][0]) for each in singly] == upper.tolist()


def test_each_of_several_streams_equals_a_single_one() -> None:
    values = np.random.default_rng(5).integers(0, 2, (50, 3)).astype(float)
    lower, upper = BetaMixture(streams=(3,)).update(values)
    for stream in range(3):
        one = BetaMixture().update(values[:, stream])
        assert (one[0].tolist(), one[1].tolist()) == (lower[:, stream].tolist(), upper[:, stream].tolist())


@pytest.mark.parametrize("p", [0.02, 0.5, 0.9, 0.999])
def test_all_intervals_of_a_stream_jointly_have_the_nominal_coverage(p: float) -> None:
    streams, runs = 500, 800
    values = np.random.default_rng(6).random((runs, streams)) < p
    lower, upper = BetaMixture(streams=(streams,)).update(values)
    covered = ((lower <= p) & (p <= upper)).all(axis=0).sum()
    assert covered / streams >= 0.95


def test_a_share_accepts_only_values_of_0_and_1() -> None:
    with pytest.raises(ValueError, match="0 and 1"):
        BetaMixture().update([0.5])
    with pytest.raises(ValueError, match="outside the bounds 0 and 1"):
        BetaMixture().update([math.nan])
