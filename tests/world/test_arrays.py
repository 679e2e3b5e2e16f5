"""Columns and series hold real numbers: others are refused everywhere, without conversion."""

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from simulating import Team

from symaware_cli import Agent, AwarenessVector, TimeSeries
from symaware_cli.awareness.column import Column
from symaware_cli.awareness.series_column import SeriesColumn
from symaware_cli.world.arrays import distinct, real

STRANGE = {
    "complex": np.array([1.0, 1j]),
    "complex without an imaginary part": np.array([1.0, 0j]),
    "complex in a list": [1.0, 1j],
    "numbers as text": ["1", "2"],
    "an array of text": np.array(["1", "2"]),
    "bytes": np.array([b"1", b"2"]),
    "None": [1.0, None],
    "objects": np.array([1.0, object()], object),
    "complex objects": np.array([1.0, 1j], object),
    "decimals": [Decimal(1), Decimal(2)],
    "dates": np.array(["2020-01-01", "2020-01-02"], "datetime64[D]"),
    "durations": np.array([1, 2], "timedelta64[s]"),
}


def agent() -> Agent:
    return Team().group("robot").agents[0]


WAYS: dict[str, Callable[[Any], object]] = {
    "a column": lambda value: setattr(Column(np.zeros((1, 2))), "values", [value]),
    "a row of a column": lambda value: Column(np.zeros((1, 2))).set_row(0, value),
    "a control input": lambda value: setattr(agent().model, "control_input", value),
    "control inputs": lambda value: setattr(agent().group, "control_input", [value]),
    "a believed state": lambda value: setattr(agent().self_awareness, "state", value),
    "believed states": lambda value: setattr(agent().group.awareness, "state", [value]),
    "series of a group": lambda value: SeriesColumn(1).set([0, 1], [value]),
    "a series": lambda value: TimeSeries({0.0: value}),
    "a sampled series": lambda value: TimeSeries.sampled([0, 1], value),
    "an awareness vector": lambda value: AwarenessVector("a", value),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("what", STRANGE)
def test_values_that_are_no_real_numbers_are_refused(what: str, way: str) -> None:
    with pytest.raises(TypeError, match="expected real numbers, not "):
        WAYS[way](STRANGE[what])


@pytest.mark.parametrize(
    "value",
    [
        [1, 2],
        (1.0, 2),
        [True, 2.0],
        np.array([1, 2], np.uint8),
        np.array([1, 2], np.float32),
        [Fraction(1), np.float64(2)],
        range(1, 3),
    ],
)
@pytest.mark.parametrize("way", WAYS)
def test_real_numbers_of_any_kind_are_taken(way: str, value: ArrayLike) -> None:
    WAYS[way](value)
    assert real(value).dtype == np.float64
    assert real(value).tolist() == [1.0, 2.0]


@given(st.lists(st.integers(-3, 3)))
def test_distinct_numbers_are_those_of_a_set_ascending(numbers: list[int]) -> None:
    assert distinct(np.array(numbers, np.int64)).tolist() == sorted({*numbers})
