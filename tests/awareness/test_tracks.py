"""Beliefs of agents about others are extrapolated and merged."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulating import STEP, Team, present, simulation

from symaware_cli import Tracks

SECOND = 1_000_000_000


def tracks(time: int, pairs: Sequence[tuple[int, int]], ages: Sequence[float], covariances: bool = True) -> Tracks:
    """Tracks of pairs, ascending, at positions that tell the pair, all of which move at 1 m/s along x."""
    count = len(pairs)
    observers, others = np.array(pairs, np.intp).reshape(count, 2).T
    return Tracks.of(
        time,
        3,
        observers,
        others,
        np.stack([10.0 * observers, 1.0 * others], axis=1),
        np.tile([1.0, 0.0], (count, 1)),
        covariances=np.tile(np.eye(4), (count, 1, 1)) if covariances else None,
        ages=np.array(ages, float),
    )


known = st.dictionaries(st.tuples(st.integers(0, 2), st.integers(0, 4)), st.integers(0, 5), max_size=8).map(
    lambda found: dict(sorted(found.items()))
)


@given(known, known, st.integers(0, 5), st.integers(0, 5))
def test_of_each_pair_the_more_recent_belief_counts(
    seen: dict[tuple[int, int], int], told: dict[tuple[int, int], int], seen_at: int, told_at: int
) -> None:
    one = tracks(seen_at * SECOND, list(seen), list(seen.values()))
    other = tracks(told_at * SECOND, list(told), list(told.values()))
    both, time = one.updated(other), max(seen_at, told_at)
    assert both.time == time * SECOND
    pairs = list(zip(both.observers.tolist(), both.others.tolist(), strict=True))
    assert pairs == sorted({*seen, *told})
    for place, pair in enumerate(pairs):
        since = {at - found[pair]: at for found, at in ((told, told_at), (seen, seen_at)) if pair in found}
        latest = max(since)
        assert both.ages[place] == time - latest
        # All are carried on to one instant; equally recent, what is seen counts.
        assert both.positions[place].tolist() == [10.0 * pair[0] + time - since[latest], pair[1]]


def test_an_extrapolated_agent_becomes_less_certain() -> None:
    now = tracks(0, [(0, 1)], [0.5])
    then = now.at(2 * SECOND)
    assert then.ages.tolist() == [2.5]
    assert then.positions.tolist() == [[2.0, 1.0]]
    assert then.covariances is not None
    assert then.covariances[0].tolist() == [[5, 0, 2, 0], [0, 5, 0, 2], [2, 0, 1, 0], [0, 2, 0, 1]]
    back = then.at(0)
    assert back.positions.tolist() == now.positions.tolist()
    assert back.covariances is not None
    assert now.covariances is not None
    assert np.array_equal(back.covariances, now.covariances)
    assert now.at(0) is now


@pytest.mark.parametrize("sure", ["seen", "received"])
def test_certain_values_need_no_covariance(sure: str) -> None:
    one, other = tracks(0, [(0, 1)], [0], sure == "received"), tracks(0, [(0, 2)], [0], sure == "seen")
    certain = 0 if sure == "seen" else 1
    assert not present(one.updated(other).covariances)[certain].any()
    assert present(one.updated(other).covariances)[1 - certain].any()


def test_an_expanded_world_has_all_agents_except_oneself() -> None:
    ready = simulation({"cat": Team(count=2), "dog": Team(count=3)})
    dog = ready.groups[1]
    written = dog.awareness.everybody(ready.environment.snapshot())
    dog.awareness.world = ready.environment.snapshot()
    near = dog.others(1e9)
    for name in ("pointers", "others", "positions", "velocities"):
        assert np.array_equal(getattr(written, name), getattr(near, name))
    assert written.others.tolist() == [0, 1, 3, 4, 0, 1, 2, 4, 0, 1, 2, 3]


def test_messages_before_the_first_perception_change_nothing() -> None:
    ready = simulation({"cat": Team(count=2)})
    awareness = ready.groups[0].awareness
    awareness.world = ready.environment.snapshot()
    told = Tracks.of(0, 2, np.array([0]), np.array([1]), np.zeros((1, 2)), np.zeros((1, 2)))
    awareness.received = told
    assert awareness.tracks is None
    awareness.received = told.at(STEP).updated(
        Tracks.of(STEP, 2, np.array([0]), np.array([1]), np.ones((1, 2)), np.zeros((1, 2)))
    )
    later = present(ready.groups[0].awareness.tracks)
    assert later.others.tolist() == [1, 0]
    assert ready.groups[0].awareness.tracks is later
