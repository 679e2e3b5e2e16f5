"""The two nearest of many bodies, against all pairs."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from outlines import distance, placed, random_shape

from symaware_cli.geometry.body_outlines import BodyOutlines
from symaware_cli.geometry.proximity import Proximity


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 12, 70]), st.sampled_from([1.0, 2.5, 8.0]))
def test_the_nearest_two_are_those_of_all_pairs_of_outlines(seed: int, count: int, room: float) -> None:
    random = np.random.default_rng(seed)
    kinds = [random_shape(random) for _ in range(3)]
    counts = np.bincount(random.integers(3, size=count), minlength=3)
    bodies = BodyOutlines([shape.pieces[0] for shape in kinds], counts.tolist())
    shapes = [shape for shape, number in zip(kinds, counts, strict=True) for _ in range(number)]
    proximity, least = Proximity(), np.inf
    for _ in range(3):
        positions = random.uniform(0, room * np.sqrt(count), (count, 2))
        headings = random.uniform(-4, 4, count)
        outlines = [placed(*each)[0] for each in zip(shapes, positions, headings, strict=True)]
        gaps = {pair: distance(*(outlines[each] for each in pair)) for pair in itertools.combinations(range(count), 2)}
        found = bodies.nearest(positions, headings, proximity, least)
        assert (found is not None) == (min(gaps.values()) < least) or abs(min(gaps.values()) - least) < 1e-9
        if found is not None:
            assert found.gap == pytest.approx(min(gaps.values()), abs=1e-9)
            assert gaps[found.one, found.other] == pytest.approx(found.gap, abs=1e-9)
            least = found.gap


def test_bodies_in_one_place_are_as_deep_in_each_other_as_they_are_wide() -> None:
    discs = BodyOutlines([([(0.0, 0.0)], 0.5), None], [2, 1])
    assert discs.nearest(np.zeros((3, 2)), np.zeros(3), Proximity()) == (-1.0, 0, 1)
    assert discs.some(np.array([0, 2])).nearest(np.zeros((2, 2)), np.zeros(2), Proximity()) == (-0.5, 0, 1)
    assert discs.nearest(np.zeros((1, 2)), np.zeros(1), Proximity()) is None
