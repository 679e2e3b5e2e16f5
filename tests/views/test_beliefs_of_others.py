"""Beliefs of others, in columns."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from simulating import present

from symaware_cli.log import others_message
from symaware_cli.views.scene.others import Beliefs, read_beliefs
from symaware_cli.views.views import GroupView, RunView


def group_view(name: str, agents: tuple[str, ...], state: tuple[str, str, str], position: tuple[int, int]) -> GroupView:
    names = [(quantity, "m") for quantity in state]
    colours = np.zeros((len(agents), 3), np.uint8)
    return GroupView(name, agents, colours, None, tuple(names), (), position, None, f"/world/{name}/state")


# The position of a sled does not come first in its state.
RUN_VIEW = RunView(
    "test",
    1,
    {
        "robot": group_view("robot", ("robot.0", "robot.1"), ("x", "y", "heading"), (0, 1)),
        "sled": group_view("sled", ("sled",), ("speed", "x", "y"), (1, 2)),
    },
    {},
    ("robot.0", "robot.1", "sled", "wall"),
    10.0,
)


def message(
    lengths: Sequence[int],
    entities: Sequence[int],
    columns: int | Sequence[int],
    values: ArrayLike,
    rows: Sequence[int] | None = None,
    **more: Any,
) -> others_message.Awareness:
    return others_message.decode_awareness(
        others_message.encode_awareness(lengths, entities, columns, values, rows, **more)
    )


def read(entries: Sequence[tuple[int, others_message.Awareness]], count: int, wanted: Sequence[int]) -> Beliefs:
    return read_beliefs(entries, count, wanted, 2)


def test_a_belief_begins_with_the_position() -> None:
    states = message([2, 0], [1, 2], 4, [[1.0, 2.0, 0.5, 0.0], [3.0, 4.0, 9.0, 0.0]])
    tracks = message([1, 1], [2, 3], 4, [[5, 6, 0, 0], [7, 8, 0, 0]])
    beliefs = read([(0, states), (50, tracks)], 2, [0, 1])
    assert beliefs.places.tolist() == [[1, 2, 0], [3, 4, 0], [5, 6, 0], [7, 8, 0]]
    assert beliefs.who.tolist() == [1, 2, 2, 3]
    times, counts, mine = beliefs.of(0)
    assert (times.tolist(), counts.tolist(), mine.tolist()) == ([0, 50], [2, 1], [0, 1, 2])


def test_agents_that_a_message_leaves_out_keep_their_beliefs() -> None:
    entries = [(0, message([1, 1], [1, 0], 2, [[1, 1], [2, 2]])), (50, message([0], [], 2, [], [1]))]
    beliefs = read(entries, 2, [0, 1])
    assert beliefs.of(0)[0].tolist() == [0]
    times, counts, _ = beliefs.of(1)
    assert (times.tolist(), counts.tolist()) == ([0, 50], [1, 0])


def test_an_omniscient_agent_has_no_beliefs_that_differ_from_the_world() -> None:
    entries = [
        (0, message([1], [1], 2, [[1, 1]], [0])),
        (50, others_message.decode_awareness(others_message.WHOLE_WORLD)),
    ]
    times, counts, _ = read(entries, 2, [0]).of(0)
    assert (times.tolist(), counts.tolist()) == ([0, 50], [1, 0])


@given(st.lists(st.sampled_from([2, 3, 4]), min_size=1, max_size=5), st.data())
def test_covariances_are_found_whatever_the_sizes_are(sizes: list[int], data: st.DataObject) -> None:
    random = np.random.default_rng(data.draw(st.integers(0, 99)))
    squares = [random.normal(size=(size, size)) for size in sizes]
    values, flat = random.normal(size=sum(sizes)), np.concatenate([square.ravel() for square in squares])
    known = message([len(sizes), 0], [3] * len(sizes), sizes, values, covariances=flat)
    unknown = message([1, 0], [3], 2, [[0, 0]])
    beliefs = read([(0, unknown), (1, known)], 2, [0])
    assert np.isnan(present(beliefs.covariances)[0]).all()
    for square, found in zip(squares, present(beliefs.covariances)[1:], strict=True):
        np.testing.assert_array_equal(found, square[:2, :2])


def test_ages_are_zero_where_nothing_is_said() -> None:
    old = message([1, 0], [1], 2, [[0, 0]], ages=[1.5])
    new = message([1, 0], [1], 2, [[0, 0]])
    assert read([(0, old), (1, new)], 2, [0]).ages.tolist() == [1.5, 0.0]


def test_only_whoever_is_wanted_is_read() -> None:
    entries = [(0, message([1, 2], [1, 0, 2], 2, [[1, 1], [2, 2], [3, 3]]))]
    beliefs = read(entries, 2, [1])
    assert beliefs.places[:, 0].tolist() == [2, 3]
    assert beliefs.of(1)[1].tolist() == [2]


def test_without_messages_there_are_no_beliefs() -> None:
    assert len(read([], 2, [0]).places) == 0
