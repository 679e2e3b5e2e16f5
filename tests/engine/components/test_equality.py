"""What says the same is the same, however it is written."""

import copy
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli import AwarenessVector, KnowledgeDatabase, TimeSeries
from symaware_cli.engine.components.communication.equality import same

plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3)
values = st.recursive(
    plain | st.lists(st.floats(), max_size=3).map(np.array),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner, max_size=3),
    max_leaves=6,
)


@given(values)
def test_a_value_is_the_same_as_its_copy(value: dict[str, Any] | list[dict[str, Any]] | None) -> None:
    assert same(value, copy.deepcopy(value))
    assert same(KnowledgeDatabase({"it": value})["it"], value)


@given(values, values)
def test_sameness_does_not_depend_on_the_order(
    one: dict[str, Any] | list[Any] | None, other: list[list[Any]] | None
) -> None:
    assert same(one, other) == same(other, one)


def test_shapes_and_kinds_count() -> None:
    assert not same(np.zeros(2), np.zeros((2, 1)))
    assert not same(np.zeros(2), [0.0, 0.0])
    assert not same({"a": 1}, {"b": 1})
    assert same(np.array([1.0, np.nan]), np.array([1.0, np.nan]))


def test_series_and_awareness_are_compared_by_their_values() -> None:
    series = {0.0: [1.0, np.nan]}
    assert same(TimeSeries(series), copy.deepcopy(TimeSeries(series)))
    assert not same(TimeSeries(series), TimeSeries({0.5: [1.0, np.nan]}))
    assert same(
        AwarenessVector("a", [1.0], TimeSeries(series)), copy.deepcopy(AwarenessVector("a", [1.0], TimeSeries(series)))
    )
    assert not same(AwarenessVector("a", [1.0]), AwarenessVector("b", [1.0]))


def test_incomparable_values_equal_only_themselves() -> None:
    one = object()
    assert same(one, one)
    assert not same(one, object())
