"""A log in columns, chunk by chunk."""

from collections.abc import Sequence, Set
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import ArrayLike
from simulating import untyped

from symaware_cli.log import wire
from symaware_cli.log.error import LogError
from symaware_cli.log.wire import Rows
from symaware_cli.views.chunk import ChunkReader

Story = list[tuple[int, tuple[str, wire.Rows | wire.SeriesRows]]]

TABLE, SERIES = "/world/robot/state", "/agents/robot/risk"
COUNT = 3
COUNTS = {TABLE: COUNT, SERIES: COUNT}


def rows(values: Sequence[list[int]], only: Sequence[int] | None = None) -> Rows:
    return wire.decode_rows(wire.encode_rows(np.array(values, float), only))


def series(
    lengths: Sequence[int], only: Sequence[int] | None = None, values: ArrayLike | None = None
) -> wire.SeriesRows:
    points = sum(lengths)
    flat = np.arange(points, dtype=float)[:, None] if values is None else np.array(values, float).reshape(points, -1)
    return wire.decode_series(wire.encode_series(np.arange(points), flat, lengths, only))


numbers = st.floats(-10, 10)
subsets = st.none() | st.lists(st.integers(0, COUNT - 1), min_size=1, unique=True).map(sorted)


@st.composite
def table_messages(draw: st.DrawFn) -> tuple[str, wire.Rows]:
    only = draw(subsets)
    values = draw(arrays(float, (COUNT if only is None else len(only), 2), elements=numbers))
    return TABLE, wire.Rows(None if only is None else np.array(only, np.uint32), values)


@st.composite
def series_messages(draw: st.DrawFn) -> tuple[str, wire.SeriesRows]:
    only = draw(subsets)
    count = COUNT if only is None else len(only)
    shared = draw(st.booleans())
    lengths = [draw(st.integers(0, 3))] if shared else draw(st.lists(st.integers(0, 3), min_size=count, max_size=count))
    points = lengths[0] * count if shared else sum(lengths)
    values = draw(arrays(float, (points, 1), elements=numbers))
    chosen = None if only is None else np.array(only, np.uint32)
    return SERIES, wire.SeriesRows(chosen, np.array(lengths, np.uint32), np.arange(points), values)


stories = st.lists(st.tuples(st.integers(0, 2), st.one_of(table_messages(), series_messages())), max_size=12)


def told(story: Story, cut: Set[int]) -> list[Any]:
    """The content of all chunks put together again, where one begins at each of some instants."""
    chunk_reader, chunks, time = ChunkReader(COUNTS), [], 0
    for pause, (topic, message) in story:
        if pause and time in cut and not chunk_reader.empty:
            chunks.append(chunk_reader.drain())
        time += pause
        chunk_reader.take(topic, time, message)
    if not chunk_reader.empty:
        chunks.append(chunk_reader.drain())
    frames = [chunk.frames[TABLE] for chunk in chunks if TABLE in chunk.frames]
    strips = [chunk.strips[SERIES] for chunk in chunks if SERIES in chunk.strips]
    return [
        *([time for each in frames for time in each.times], [row for each in frames for row in each.values.tolist()]),
        *([time for each in strips for time in each.times], [row for each in strips for row in each.lengths.tolist()]),
        [value for each in strips for value in each.values.ravel().tolist()],
    ]


@given(stories, st.sets(st.integers(0, 24)))
def test_a_log_says_the_same_however_it_is_cut(story: Story, cut: set[int]) -> None:
    whole, parts = told(story, set()), told(story, cut)
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)


@given(stories)
def test_agents_that_are_left_out_keep_their_values(story: Story) -> None:
    known = np.full((COUNT, 2), np.nan)
    held: list[list[float]] = [[]] * COUNT
    chunk_reader, time = ChunkReader(COUNTS), 0
    for pause, (topic, message) in story:
        time += pause
        chunk_reader.take(topic, time, message)
        only = range(COUNT) if message.rows is None else message.rows
        if topic == TABLE:
            known[list(only)] = message.values
            continue
        each = np.broadcast_to(untyped(message).lengths, len(only))
        ends = np.cumsum(each)
        for row, length, end in zip(only, each, ends, strict=True):
            held[row] = message.values[end - length : end, 0].tolist()
    chunk = chunk_reader.drain()
    if TABLE in chunk.frames:
        np.testing.assert_array_equal(chunk.frames[TABLE].values[-1], known)
    if SERIES in chunk.strips:
        strips = chunk.strips[SERIES]
        assert strips.lengths[-1].tolist() == [len(values) for values in held]
        total = strips.lengths[-1].sum()
        last = strips.values[len(strips.values) - total :].ravel().tolist()
        assert last == [value for values in held for value in values]


def test_a_series_without_points_for_any_agent_clears_the_previous_one() -> None:
    chunk_reader = ChunkReader(COUNTS)
    chunk_reader.take(SERIES, 0, series([1, 1, 1]))
    chunk_reader.take(SERIES, 1, wire.decode_series(wire.encode_series([], np.empty((3, 0, 1)))))
    assert chunk_reader.drain().strips[SERIES].lengths.tolist() == [[1, 1, 1], [0, 0, 0]]


def test_the_first_points_of_series_are_nan_where_there_are_none() -> None:
    chunk_reader = ChunkReader(COUNTS)
    chunk_reader.take(SERIES, 0, series([2, 0, 1]))
    np.testing.assert_array_equal(chunk_reader.drain().strips[SERIES].firsts.values[0, :, 0], [0.0, np.nan, 2.0])


def test_values_at_other_instants_are_those_that_held_then() -> None:
    chunk_reader = ChunkReader(COUNTS)
    chunk_reader.take(TABLE, 10, rows([[1, 1], [2, 2], [3, 3]]))
    chunk_reader.drain()
    chunk_reader.take(TABLE, 20, rows([[9, 9]], [1]))
    found = chunk_reader.drain().frames[TABLE].at(np.array([15, 20, 25]))
    assert found[:, 1, 0].tolist() == [2.0, 9.0, 9.0]
    assert found[:, 0, 0].tolist() == [1.0, 1.0, 1.0]


def test_known_values_stay_known_in_chunks_without_them() -> None:
    chunk_reader = ChunkReader(COUNTS)
    chunk_reader.take(TABLE, 10, rows([[1, 1], [2, 2], [3, 3]]))
    chunk_reader.drain()
    chunk_reader.take(SERIES, 30, series([1, 1, 1]))
    frames = chunk_reader.drain().frames[TABLE]
    assert len(frames.times) == 0
    assert frames.at(np.array([30]))[0, 2].tolist() == [3.0, 3.0]


def test_before_anything_is_known_values_are_nan() -> None:
    chunk_reader = ChunkReader(COUNTS)
    chunk_reader.take(TABLE, 10, rows([[1, 1]], [2]))
    frames = chunk_reader.drain().frames[TABLE]
    assert np.isnan(frames.at(np.array([5]))).all()
    np.testing.assert_array_equal(frames.values[0], [[np.nan] * 2, [np.nan] * 2, [1, 1]])


@pytest.mark.parametrize("message", [rows([[1, 2]], [COUNT]), series([1], [COUNT])])
def test_a_row_that_the_group_does_not_have_is_a_damaged_log(message: wire.Rows | wire.SeriesRows) -> None:
    topic = TABLE if isinstance(message, wire.Rows) else SERIES
    with pytest.raises(LogError, match="row 3 of a group of 3"):
        ChunkReader(COUNTS).take(topic, 0, message)


def test_columns_that_change_are_a_damaged_log() -> None:
    chunk_reader = ChunkReader(COUNTS)
    chunk_reader.take(TABLE, 0, rows([[1, 1], [2, 2], [3, 3]]))
    with pytest.raises(LogError, match="do not fit together"):
        chunk_reader.take(TABLE, 1, rows([[1, 1, 1]], [0]))


def test_two_messages_of_one_instant_make_one_frame() -> None:
    chunk_reader = ChunkReader(COUNTS)
    chunk_reader.take(TABLE, 0, rows([[1, 1]], [0]))
    chunk_reader.take(TABLE, 0, rows([[2, 2]], [1]))
    frames = chunk_reader.drain().frames[TABLE]
    assert frames.times.tolist() == [0]
    assert frames.values[0, :2].tolist() == [[1, 1], [2, 2]]
