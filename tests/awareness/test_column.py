"""Columns hold one quantity of a whole group, and know which rows changed; those of tables have any number of rows."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulating import untyped

from symaware_cli import TimeSeries
from symaware_cli.awareness.column import Column, TableColumn
from symaware_cli.awareness.series_column import SeriesColumn
from symaware_cli.awareness.value_range import ValueRange
from symaware_cli.world.arrays import is_finite

operations = st.lists(
    st.one_of(
        st.tuples(st.just("row"), st.integers(0, 3), st.floats(-9, 9)),
        st.tuples(st.just("all"), st.just(0), st.floats(-9, 9)),
        st.tuples(st.just("read"), st.just(0), st.just(0.0)),
        st.tuples(st.just("take"), st.just(0), st.just(0.0)),
    ),
    max_size=30,
)


@given(operations)
def test_a_column_behaves_like_a_list_of_vectors_whose_read_values_never_change(
    steps: list[tuple[str, int, float]],
) -> None:
    column, model, changed = Column(np.zeros((4, 2))), [[0.0, 0.0]] * 4, set(range(4))
    held = []
    for what, row, value in steps:
        if what == "row":
            column.set_row(row, [value, -value])
            model = [*model[:row], [value, -value], *model[row + 1 :]]
            changed.add(row)
        elif what == "all":
            column.values = np.full((4, 2), value)
            model, changed = [[value, value]] * 4, set(range(4))
        elif what == "read":
            held.append((column.values, [list(each) for each in model]))
        else:
            taken = column.take_changes()
            assert (list(range(4)) if taken is None else taken) == sorted(changed)
            changed = set()
    assert column.values.tolist() == model
    for array, as_read in held:
        assert array.tolist() == as_read


def test_a_row_that_was_read_is_a_copy_that_may_be_written() -> None:
    column = Column([[1.0, 2.0]])
    row = column.row(0)
    row[:] = 9
    assert column.values.tolist() == [[1.0, 2.0]]


def test_a_column_that_was_read_cannot_be_written() -> None:
    column = Column([[1.0, 2.0]])
    column.set_row(0, [3, 4])
    with pytest.raises(ValueError, match="read-only"):
        column.values[0, 0] = 9


def test_a_column_does_not_follow_the_array_it_was_given() -> None:
    given_array = np.zeros((2, 1))
    column = Column(given_array)
    given_array[:] = 5
    assert column.values.tolist() == [[0.0], [0.0]]
    column.values = given_array
    given_array[:] = 6
    assert column.values.tolist() == [[5.0], [5.0]]


def test_a_read_only_view_of_a_foreign_array_is_copied() -> None:
    owner = np.zeros((2, 1))
    view = owner[:]
    view.flags.writeable = False
    column = Column(view)
    owner[:] = 5
    assert column.values.tolist() == [[0.0], [0.0]]


def test_a_vector_of_another_length_is_refused() -> None:
    column = Column(np.zeros((2, 2)))
    for wrong in ([1.0], [1.0, 2.0, 3.0], 1.0, [[1.0, 2.0]]):
        with pytest.raises(ValueError, match="expected a vector"):
            column.set_row(0, wrong)
    with pytest.raises(ValueError, match="expected an array"):
        column.values = np.zeros((3, 2))


def test_rows_with_nan_or_infinity_are_found_once() -> None:
    column = Column([[1.0, 2.0], [np.nan, 0.0], [0.0, -np.inf], [1e200, 1e200]])
    assert column.take_beyond() == [1, 2]
    assert column.take_beyond() == []
    column.set_row(2, [np.inf, 0.0])
    assert column.take_beyond() == [2]


def each_kind() -> list[tuple[Any, Callable[[float], Any]]]:
    """A column of each kind for three agents, and what its rows are set to for a number."""
    return [
        (Column(np.zeros((3, 1))), lambda number: [number]),
        (SeriesColumn(3), lambda number: TimeSeries({0.0: [number]})),
        (TableColumn(3, 1), lambda number: [[number]]),
    ]


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 2), st.sampled_from([0.0, 1e200, np.nan, np.inf])), max_size=4))
def test_a_column_passes_if_no_row_is_found_and_else_the_rows_are_still_found(writes: list[tuple[int, float]]) -> None:
    for column, value in each_kind():
        column.take_beyond()
        for row, number in writes:
            column.set_row(row, value(number))
        last = dict(writes)
        beyond = sorted(row for row, number in last.items() if not np.isfinite(number))
        assert column.passes() == (not beyond)
        assert column.fresh == bool(beyond)
        assert column.take_beyond() == beyond


@given(st.sets(st.integers(0, 2)))
def test_cleared_rows_hold_no_number_until_they_are_put_back(rows: set[int]) -> None:
    def numbers(column: Any) -> list[float]:
        return [float(np.append(column.present(row), np.nan).ravel()[0]) for row in range(3)]

    for column, value in each_kind():
        for row in range(3):
            column.set_row(row, value(row))
        column.take_beyond()
        held = column.held()
        column.take_changes()
        column.clear(sorted(rows))
        assert [np.isnan(number) for number in numbers(column)] == [row in rows for row in range(3)]
        assert not column.fresh
        taken = column.take_changes()
        assert list(range(3) if taken is None else taken) == sorted(rows)
        column.put_back(sorted(rows), held)
        assert numbers(column) == [0, 1, 2]
        assert not column.fresh


@pytest.mark.parametrize(
    ("bounds", "beyond"),
    [
        (ValueRange(), [1, 2]),
        (ValueRange(nan=True), [2]),
        (ValueRange(infinity=True), [1]),
        (ValueRange(1e100), [1, 2, 3]),
    ],
)
def test_bounds_define_the_valid_numbers(bounds: ValueRange, beyond: list[int]) -> None:
    values = np.array([[1.0, 2.0], [np.nan, 0.0], [0.0, -np.inf], [1e200, 1e200]])
    column = Column(np.zeros((4, 2)), bounds)
    column.values = values
    assert column.take_beyond() == beyond
    column.values = values
    column.restore([1], np.zeros((4, 2)))
    assert column.take_beyond() == [row for row in beyond if row != 1]


# Kernels of BLAS take up to 32 elements at once, so what they do with the rest shows in lengths beyond that.
@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=70), st.integers(0, 3))
def test_a_finite_array_is_recognised_without_a_warning_even_if_its_squares_overflow(
    values: list[float], doublings: int
) -> None:
    values = values * 2**doublings
    assert is_finite(np.array([values])) == bool(np.isfinite(values).all())


def test_every_agent_starts_with_an_empty_series_which_is_no_change() -> None:
    column = SeriesColumn(3)
    assert column.row(2) == TimeSeries()
    column.set_row(1, TimeSeries())
    assert column.take_changes() == []


def test_series_of_a_whole_group_share_their_instants() -> None:
    column = SeriesColumn(2)
    column.set([0, 10], [[1.0, 2.0], [3.0, 4.0]])
    assert column.take_changes() is None
    assert column.row(1) == TimeSeries.sampled([0, 10], [3.0, 4.0])
    assert column.shared is not None


def test_an_agents_own_series_wins_until_the_group_writes_again() -> None:
    column = SeriesColumn(2)
    column.set(0, [1.0, 2.0])
    column.set_row(1, TimeSeries({0.0: 9.0}))
    assert column.row(1)[0.0].tolist() == [9.0]
    assert column.shared is None
    column.set(0, [3.0, 4.0])
    assert column.row(1)[0.0].tolist() == [4.0]


def test_taking_a_groups_changes_takes_those_of_its_rows_as_well() -> None:
    column = SeriesColumn(2)
    column.set_row(0, TimeSeries({0.0: 1.0}))
    column.set(0, [3.0, 4.0])
    assert column.take_changes() is None
    assert column.take_changes() == []


@pytest.mark.parametrize(("times", "values"), [(0, [1.0]), ([0, 1], [1.0, 2.0]), ([0], [[1.0, 2.0], [3.0, 4.0]])])
def test_series_that_do_not_fit_the_group_are_refused(
    times: int | list[int], values: list[float | list[float]]
) -> None:
    with pytest.raises(ValueError, match="expected values for 2 agents"):
        SeriesColumn(2).set(times, values)


def test_series_of_a_group_ascend_in_time() -> None:
    for times in ([0, 0], [5, 3]):
        with pytest.raises(ValueError, match="ascend"):
            SeriesColumn(1).set(times, [[1.0, 2.0]])


def test_a_deferred_series_is_computed_once_at_its_first_reading_and_counts_as_one_change() -> None:
    column = SeriesColumn(2)
    calls: list[None] = []

    def compute() -> tuple[list[int], list[list[float]]]:
        calls.append(None)
        return [0, 10], [[1.0, 2.0], [3.0, 4.0]]

    column.defer(compute)
    column.defer(compute)
    assert column.take_changes() is None
    assert not calls
    assert column.row(1) == TimeSeries({0: 3.0, 1e-8: 4.0})
    assert column.maximum() == (4.0, 1)
    assert len(calls) == 1
    assert column.take_changes() == []


def test_a_value_written_after_a_deferred_series_takes_precedence() -> None:
    column = SeriesColumn(2)
    column.defer(lambda: ([0], [1.0, 2.0]))
    column.set_row(0, TimeSeries({0.0: 7.0}))
    assert column.row(0) == TimeSeries({0.0: 7.0})
    assert column.row(1) == TimeSeries({0.0: 2.0})
    column.defer(lambda: ([0], [1.0, 2.0]))
    assert column.row(0) == TimeSeries({0.0: 1.0})
    column.defer(lambda: pytest.fail("nobody reads it"))
    column.set([0], [3.0, 4.0])
    assert column.maximum() == (4.0, 1)


def test_only_a_series_is_a_series() -> None:
    with pytest.raises(TypeError, match="expected a TimeSeries, not dict"):
        SeriesColumn(1).set_row(0, untyped({0.0: 1.0}))


def test_vectors_in_the_series_of_a_group_have_one_length() -> None:
    column = SeriesColumn(2)
    column.set_row(0, TimeSeries({0.0: [1.0, 2.0]}))
    with pytest.raises(ValueError, match="vectors of 2"):
        column.set_row(1, TimeSeries({0.0: [1.0]}))


def test_the_series_of_a_group_do_not_follow_the_array_they_were_given() -> None:
    column, values = SeriesColumn(1), np.array([[1.0]])
    column.set(0, values)
    values[:] = 5
    assert column.row(0)[0.0].tolist() == [1.0]


@given(
    st.lists(st.floats(-9, 9), min_size=3, max_size=3),
    st.dictionaries(st.integers(0, 2), st.floats(-9, 9) | st.none(), max_size=3),
)
def test_the_maximum_is_the_largest_value_in_force(shared: list[float], own: dict[int, float | None]) -> None:
    column = SeriesColumn(3)
    column.set(0, shared)
    values: dict[int, float | None] = dict(enumerate(shared))
    for row, value in own.items():
        column.set_row(row, TimeSeries() if value is None else TimeSeries({0.0: value}))
        values[row] = value
    present = {row: value for row, value in values.items() if value is not None}
    found = column.maximum()
    if not present:
        assert found is None
    else:
        assert found is not None
        assert found[0] == max(present.values())
        assert present[found[1]] == found[0]


def test_each_agent_has_as_many_rows_as_were_written() -> None:
    column = TableColumn(3, 2)
    assert column.row(1).shape == (0, 2)
    column.set([[[1, 2]], [], [[3, 4], [5, 6]]])
    assert [len(table) for table in column.tables] == [1, 0, 2]
    column.set_row(1, [[7, 8]])
    assert column.row(1).tolist() == [[7, 8]]


def test_new_rows_are_reported_once() -> None:
    column = TableColumn(3, 1)
    assert column.take_changes() == []
    column.set_row(2, [[1.0]])
    column.set_row(0, [])
    assert column.take_changes() == [0, 2]
    column.set([[], [], []])
    assert column.take_changes() is None
    assert column.take_changes() == []


@given(st.lists(st.sampled_from([0.0, np.nan, np.inf]), min_size=3, max_size=3))
def test_rows_out_of_bounds_are_found_when_all_tables_are_set_at_once(numbers: list[float]) -> None:
    column = TableColumn(3, 1)
    column.set([[[number]] for number in numbers])
    assert column.take_beyond() == [row for row, number in enumerate(numbers) if not np.isfinite(number)]


def test_a_table_that_was_handed_out_never_changes() -> None:
    column = TableColumn(1, 1)
    given = np.array([[1.0]])
    column.set([given])
    given[0] = 2.0
    before = column.row(0)
    column.set_row(0, [[3.0]])
    assert before.tolist() == [[1.0]]
    with pytest.raises(ValueError, match="read-only"):
        before[0] = 4.0


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (lambda column: column.set([[]]), "a table for each of 2 agents, not 1"),
        (lambda column: column.set_row(0, [[1.0]]), r"shape \(any, 2\), not \(1, 1\)"),
        (lambda column: column.set_row(0, [1.0, 2.0]), r"not \(2,\)"),
    ],
)
def test_unsuitable_values_are_refused(write: Callable[..., Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        write(TableColumn(2, 2))
