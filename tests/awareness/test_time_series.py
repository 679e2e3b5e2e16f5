"""Time series are immutable values."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli import TimeSeries


def test_a_series_reads_as_a_mapping_from_seconds_to_vectors() -> None:
    series = TimeSeries({0.5: [1, 3], 0.0: [1, 2]})
    assert list(series) == [0.0, 0.5]
    assert series[0.5].tolist() == [1.0, 3.0]
    assert series.get(0.7) is None
    assert series.get(0.7, "none") == "none"
    assert 0.5 in series
    assert 0.7 not in series
    assert [(time, vector.tolist()) for time, vector in series.items()] == [(0.0, [1.0, 2.0]), (0.5, [1.0, 3.0])]
    with pytest.raises(KeyError):
        series[0.7]


def test_a_scalar_is_a_vector_of_one() -> None:
    assert TimeSeries({0.0: 0.5}).values.shape == (1, 1)
    assert TimeSeries.sampled([0, 1], [0.5, 0.6]).values.shape == (2, 1)


def test_an_empty_series_has_no_instants_and_equals_another() -> None:
    assert len(TimeSeries()) == 0
    assert TimeSeries() == TimeSeries({})
    assert TimeSeries().times.shape == (0,)


def test_a_series_cannot_be_written() -> None:
    series = TimeSeries({0.0: [1, 2]})
    for array in (series.times, series.values, series[0.0], TimeSeries().values):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 5


def test_a_series_does_not_follow_the_arrays_it_was_made_from() -> None:
    times, values = np.array([0, 10]), np.array([[1.0], [2.0]])
    series = TimeSeries.sampled(times, values)
    vector = np.array([3.0])
    mapped = TimeSeries({0.0: vector})
    times[:], values[:], vector[:] = 7, 7, 7
    assert series.times.tolist() == [0, 10]
    assert series.values.tolist() == [[1.0], [2.0]]
    assert mapped[0.0].tolist() == [3.0]


@pytest.mark.parametrize(
    ("times", "values"),
    [([0, 0], [1, 2]), ([1, 0], [1, 2]), ([0, 1], [1, 2, 3]), ([[0, 1]], [[1, 2]]), ([0], [[[1]]])],
)
def test_times_that_do_not_ascend_or_do_not_fit_the_values_are_refused(
    times: list[int | list[int]], values: list[int | list[Any]]
) -> None:
    with pytest.raises(ValueError, match=r"ascend|shape|same length"):
        TimeSeries.sampled(times, values)


@pytest.mark.parametrize("samples", [{0.1: [1, 2], 0.1 + 1e-12: [3, 4]}, {0.0: [1, 2], 1.0: [1, 2, 3]}])
def test_samples_at_one_nanosecond_or_of_different_lengths_are_refused_in_words(
    samples: dict[float, list[int]],
) -> None:
    with pytest.raises(ValueError, match=r"must ascend|same length"):
        TimeSeries(samples)


series = st.dictionaries(st.integers(0, 50), st.integers(-5, 5), max_size=8).map(
    lambda samples: (
        TimeSeries.sampled(sorted(samples), [samples[time] for time in sorted(samples)]) if samples else TimeSeries()
    )
)


@given(series, series)
def test_joined_series_have_all_instants_and_the_right_operand_takes_precedence(
    left: TimeSeries, right: TimeSeries
) -> None:
    joined = left | right
    expected = dict(zip(left.times.tolist(), left.values[:, 0].tolist() if len(left) else [], strict=True))
    expected |= dict(zip(right.times.tolist(), right.values[:, 0].tolist() if len(right) else [], strict=True))
    assert joined.times.tolist() == sorted(expected)
    assert [expected[time] for time in sorted(expected)] == (joined.values[:, 0].tolist() if len(joined) else [])


@given(series, series)
def test_equal_series_are_those_with_equal_samples(left: TimeSeries, right: TimeSeries) -> None:
    assert (left == right) == (
        left.times.tolist() == right.times.tolist() and left.values.tolist() == right.values.tolist()
    )
