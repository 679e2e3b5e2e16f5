"""Near pairs, compared with a search of all pairs."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from symaware_cli.geometry.proximity import Proximity, nearest_distances


def near(positions: NDArray[np.float64], reach: float) -> set[tuple[int, int]]:
    """All pairs within reach, by brute force."""
    distance = np.sqrt(((positions[:, None] - positions[None]) ** 2).sum(axis=2))
    return {(i, j) for i, j in itertools.combinations(range(len(positions)), 2) if distance[i, j] <= reach}


walks = st.fixed_dictionaries(
    {
        "seed": st.integers(0, 2**32 - 1),
        "count": st.integers(2, 200),
        "dimensions": st.sampled_from([2, 3]),
        "extent": st.sampled_from([0.0, 1.0, 10.0, 1000.0]),
        "stride": st.sampled_from([0.0, 0.001, 0.1, 3.0, 200.0]),
        "reaches": st.lists(st.floats(0.0, 5.0), min_size=1, max_size=4),
        "steps": st.integers(1, 25),
    }
)


@settings(max_examples=60)
@given(walks)
def test_every_pair_within_reach_is_found_regardless_of_earlier_queries(walk: dict[str, Any]) -> None:
    random = np.random.default_rng(walk["seed"])
    proximity = Proximity()
    positions = random.uniform(-walk["extent"], walk["extent"], (walk["count"], walk["dimensions"]))
    for step in range(walk["steps"]):
        if step % 5 != 4:  # now and then the same array again
            positions = positions + random.normal(scale=walk["stride"], size=positions.shape)
        reach = walk["reaches"][step % len(walk["reaches"])]
        pairs = proximity.pairs(positions, reach)
        found = list(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True))
        assert found == sorted(set(found)), "each pair comes once, in order"
        assert all(first < second for first, second in found)
        within = {pair for pair, distance in zip(found, pairs.distance.tolist(), strict=True) if distance <= reach}
        assert within == near(positions, reach)
        difference = positions[pairs.first] - positions[pairs.second]
        assert np.allclose(pairs.distance, np.linalg.norm(difference, axis=1), rtol=1e-14, atol=0)


@settings(max_examples=30)
@given(walks)
def test_the_nearest_two_are_as_near_as_the_nearest_of_all_pairs(walk: dict[str, Any]) -> None:
    random = np.random.default_rng(walk["seed"])
    positions = random.uniform(-walk["extent"], walk["extent"], (walk["count"], walk["dimensions"]))
    first, second = np.triu_indices(len(positions), 1)
    expected = np.linalg.norm(positions[first] - positions[second], axis=1).min()
    assert Proximity().nearest(positions) == pytest.approx(expected, rel=1e-12)


def test_two_bodies_in_one_place_are_near_at_reach_zero() -> None:
    positions = np.zeros((100, 2))
    assert len(Proximity().pairs(positions, 0.0).first) == 100 * 99 // 2


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_bodies_have_no_pairs(count: int) -> None:
    positions = np.zeros((count, 2))
    assert len(Proximity().pairs(positions, 1.0).first) == 0
    assert Proximity().nearest(positions) == np.inf


def test_a_crowd_that_shrinks_or_grows_is_indexed_again() -> None:
    proximity, random = Proximity(), np.random.default_rng(1)
    for count in (100, 150, 70, 10, 200):
        positions = random.uniform(-5, 5, (count, 2))
        pairs = proximity.pairs(positions, 1.0)
        chosen = pairs.distance <= 1.0
        assert set(zip(pairs.first[chosen].tolist(), pairs.second[chosen].tolist(), strict=True)) == near(
            positions, 1.0
        )


@pytest.mark.parametrize("count", [2, 10, 70])
def test_pairs_of_several_runs_are_those_of_each_run_to_the_bit(count: int) -> None:
    random = np.random.default_rng(count)
    runs = random.permutation(5 * count).reshape(5, count)
    runs.sort(axis=1)
    together, alone = Proximity(), [Proximity() for _ in runs]
    together.runs = runs
    for _ in range(4):
        positions = random.uniform(-3.0, 3.0, (5 * count, 3))
        pairs = together.pairs(positions, 0.7)
        one, other, distance = together.directed(positions, 0.7)
        assert pairs.runs == (5 if together.has_blocks else 0)
        for bodies, proximity in zip(runs, alone, strict=True):
            own = np.isin(pairs.first, bodies)
            near = own & (pairs.distance <= 0.7)
            expected = proximity.pairs(positions[bodies], 0.7)
            within = expected.distance <= 0.7
            assert bodies[expected.first[within]].tolist() == pairs.first[near].tolist()
            assert bodies[expected.second[within]].tolist() == pairs.second[near].tolist()
            assert expected.distance[within].tobytes() == pairs.distance[near].tobytes()
            first, second, apart = proximity.directed(positions[bodies], 0.7)
            directed = np.isin(one, bodies)
            assert bodies[first].tolist() == one[directed].tolist()
            assert bodies[second].tolist() == other[directed].tolist()
            assert apart.tobytes() == distance[directed].tobytes()


@pytest.mark.parametrize("runs", [None, 3])
@pytest.mark.parametrize("count", [1, 2, 64, 65])
def test_the_nearest_to_each_is_that_of_all_pairs_to_the_bit(count: int, runs: int | None) -> None:
    random, proximity = np.random.default_rng(count), Proximity()
    total = count * (runs or 1)
    if runs is not None:
        proximity.runs = random.permutation(total).reshape(runs, count)
        proximity.runs.sort(axis=1)
    for share in (1.0, 0.5, 1.0):  # all are present, some, and all again
        positions = random.uniform(-3.0, 3.0, (total, 2))
        present = random.random(total) < share
        positions[~present] = np.nan
        proximity.present = None if share == 1.0 else present
        expected = nearest_distances(positions, proximity.runs)
        assert proximity.nearest_to_each(positions).tobytes() == expected.tobytes()


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_a_body_without_a_position_is_near_none(count: int) -> None:
    positions, proximity = np.random.default_rng(count).uniform(-3.0, 3.0, (count, 2)), Proximity()
    positions[0, 1] = np.nan
    expected = nearest_distances(positions)
    assert expected[0] == np.inf
    for _ in range(2):  # computed, and kept
        assert proximity.nearest_to_each(positions).tobytes() == expected.tobytes()


def test_an_absent_body_is_in_no_pair() -> None:
    assert Proximity().nearest_to_each(np.empty((0, 2))).shape == (0,)
