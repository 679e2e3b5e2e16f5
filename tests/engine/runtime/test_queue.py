"""The queue: in which order entries come, and that they are data that can be put away."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.core import Clock
from symaware_cli.engine.runtime.queue import Entry, LivelockError, Phase, Queue

ENTRIES = st.lists(st.tuples(st.integers(1, 5), st.integers(-1, 3), st.sampled_from(Phase), st.integers(0, 3)))


def queue_of(done: list[tuple[int, int, int, Any]]) -> Queue:
    """A queue that writes down what it does."""
    queue = Queue(Clock())
    for place in range(-1, 4):
        queue.register(place, {"do": lambda row, payload: done.append((queue.clock.now, queue.place, row, payload))})
    return queue


def run_all(queue: Queue) -> None:
    while queue.entries:
        queue.begin(queue.entries[0][0])
        queue.run()


@given(entries=ENTRIES)
def test_entries_come_by_time_place_phase_row_and_number(entries: list[tuple[int, int, Phase, int]]) -> None:
    done: list[Any] = []
    queue = queue_of(done)
    for number, (time, place, phase, row) in enumerate(entries):
        queue.put(time, place, phase, row, "do", number)
    run_all(queue)
    expected = sorted((*entry, number) for number, entry in enumerate(entries))
    assert done == [(time, place, row, number) for time, place, _, row, number in expected]


@given(entries=ENTRIES, chosen=st.lists(st.integers(0, 20)))
def test_a_cancelled_wait_leaves_nothing_behind(entries: list[tuple[int, int, Phase, int]], chosen: list[int]) -> None:
    done: list[Any] = []
    queue = queue_of(done)
    numbers = [queue.put(*entry, "do", number) for number, entry in enumerate(entries)]
    cancelled = {number for number in chosen if number < len(entries)}
    for number in sorted(cancelled):
        queue.cancel(numbers[number])
        assert all(each.number != numbers[number] for each in queue.pending())
    assert len(queue) == len(queue.pending()) == len(entries) - len(cancelled)
    left = [entry for number, entry in enumerate(entries) if number not in cancelled]
    assert (queue.entries[0][0] if queue.entries else None) == min((time for time, *_ in left), default=None)
    run_all(queue)
    assert {payload for *_, payload in done} == set(range(len(entries))) - cancelled


@given(entries=ENTRIES)
def test_entries_can_be_put_away_as_data_and_taken_up_by_another_queue(
    entries: list[tuple[int, int, Phase, int]],
) -> None:
    first: list[Any] = []
    second: list[Any] = []
    queue, other = queue_of(first), queue_of(second)
    for number, entry in enumerate(entries):
        queue.put(*entry, "do", number)
    away = json.dumps(queue.pending())
    run_all(queue)
    other.replace([Entry(*each) for each in json.loads(away)])
    other.put(6, 0, Phase.TURN, 0, "do", "behind")
    run_all(other)
    assert second == [*first, (6, 0, 0, "behind")]


def test_a_component_that_triggers_itself_without_end_is_named() -> None:
    queue = Queue(Clock())
    queue.register(2, {"again": lambda row, payload: queue.put(0, 2, Phase.TURN, 0, "again")})
    queue.put(0, 2, Phase.TURN, 0, "again")
    with pytest.raises(LivelockError) as caught:
        queue.run()
    assert caught.value.places == [2]
