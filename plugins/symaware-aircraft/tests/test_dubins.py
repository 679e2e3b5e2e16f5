"""Dubins paths are the shortest paths, and end at the given poses."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from symaware_aircraft import WORDS, dubins_paths, shortest_path

Pose = tuple[float, float, float]

coordinates = st.floats(-1000, 1000)
poses = st.tuples(coordinates, coordinates, st.floats(-10, 10))
radii = st.floats(1.0, 300.0)
#: Near enough for every word to exist.
near = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-10, 10))


def difference(one: Pose | NDArray[np.float64], other: Pose) -> tuple[float, float]:
    """Return the distance of two poses [m], and the angle between their headings [rad]."""
    turned = math.remainder(one[2] - other[2], 2 * math.pi)
    return math.hypot(one[0] - other[0], one[1] - other[1]), abs(turned)


def reversed_pose(pose: Sequence[float]) -> Pose:
    return (pose[0], pose[1], pose[2] + math.pi)


@pytest.mark.parametrize(
    ("end", "word", "length"),
    # A. M. Shkel, V. Lumelsky, "Classification of the Dubins set", 2001, and the case study's checks.
    [((5, 0, 3), "RSL", 8.2725), ((4, 4, math.pi), "LSL", 7.6137)],
)
def test_reference_paths_have_the_word_and_length_that_is_known(end: Pose, word: str, length: float) -> None:
    path = shortest_path((0, 0, 0), end, 1.0)
    assert path.word == word
    assert path.length == pytest.approx(length, abs=5e-5)


def test_the_intruder_of_the_case_study_flies_an_lsr() -> None:
    path = shortest_path((-120, 90, 0), (600, 450, 0), 10 / 0.07)
    assert path.word == "LSR"
    assert path.lengths[0] / path.radius == pytest.approx(0.508585, abs=1e-6)
    assert path.lengths[1] == pytest.approx(665.0456, abs=1e-4)
    assert path.length == pytest.approx(810.3556, abs=1e-4)


def test_the_recorded_sampling_of_that_path_is_that_of_the_published_runs() -> None:
    rates = shortest_path((-120, 90, 0), (600, 450, 0), 10 / 0.07).turn_rates(10.0, 1.0, "recorded")
    expected = [0.07] * 7 + [0.24 * 0.07] + [0.0] * 66 + [-0.07] * 8
    np.testing.assert_allclose(rates, expected, atol=1e-15)


@pytest.mark.parametrize("end", [(7, 0, 0), (0, 0, 0), (0, 0, 2 * math.pi), (3, 0, -2 * math.pi)])
def test_straight_ahead_is_no_turn(end: Pose) -> None:
    path = shortest_path((0, 0, 0), end, 1.0)
    assert path.length == pytest.approx(end[0], abs=1e-12)


@given(poses, poses, radii)
def test_every_word_ends_at_the_end(start: Pose, end: Pose, radius: float) -> None:
    for path in dubins_paths(start, end, radius):
        distance, angle = difference(path.end, end)
        assert distance < 1e-9
        assert angle < 1e-9


@given(near, near)
def test_the_shortest_of_six_is_taken(start: Pose, end: Pose) -> None:
    paths = dubins_paths(start, end, 1.0)
    assert {path.word for path in paths} <= set(WORDS)
    assert shortest_path(start, end, 1.0).length == min(path.length for path in paths)


def test_each_word_is_the_shortest_somewhere() -> None:
    generator = np.random.default_rng(1)
    ends = zip(*generator.uniform([[-4], [-4], [-3]], [[4], [4], [3]], (3, 400)), strict=True)
    assert {shortest_path((0, 0, 0), end, 1.0).word for end in ends} == set(WORDS)


def test_the_way_back_and_the_mirror_image_are_as_long() -> None:
    # Drawn, not searched for: where a word ceases to exist the length jumps, and there rounding decides.
    draws = np.random.default_rng(2).uniform([-5, -5, -10] * 2, [5, 5, 10] * 2, (1000, 6))
    for start, end in zip(draws[:, :3], draws[:, 3:], strict=True):
        length = shortest_path(start, end, 1.0).length
        back = shortest_path(reversed_pose(end), reversed_pose(start), 1.0)
        mirrored = shortest_path(start * [1, -1, -1], end * [1, -1, -1], 1.0)
        assert back.length == pytest.approx(length, abs=1e-9)
        assert mirrored.length == pytest.approx(length, abs=1e-9)


@given(poses, poses, radii)
def test_no_turn_is_tighter_than_the_radius_and_no_step_longer_than_the_path(
    start: Pose, end: Pose, radius: float
) -> None:
    path = shortest_path(start, end, radius)
    along = np.linspace(0.0, path.length, 200)
    at = path.poses(along)
    ahead = np.diff(along)
    assert (np.abs(np.diff(at[:, 2])) <= ahead / radius + 1e-9).all()
    assert (np.hypot(*np.diff(at[:, :2], axis=0).T) <= ahead + 1e-9).all()
    np.testing.assert_allclose(path.headings(along), at[:, 2], atol=1e-9)


@given(near, near)
def test_no_other_way_of_arcs_is_shorter(start: Pose, end: Pose) -> None:
    # A lower bound that needs no words: the straight line, and the turning that headings ask for.
    path = shortest_path(start, end, 1.0)
    distance, angle = difference(start, end)
    assert path.length >= max(distance, angle) - 1e-9


@given(poses, poses)
@settings(max_examples=50)
def test_mean_turn_rates_keep_the_heading_of_the_path_and_stay_within_the_limit(start: Pose, end: Pose) -> None:
    path = shortest_path(start, end, 10 / 0.07)
    rates = path.turn_rates(10.0, 1.0)
    assert (np.abs(rates) <= 0.07 + 1e-12).all()
    assert path.start[2] + rates.sum() == pytest.approx(path.end[2], abs=1e-9)
    at = np.arange(len(rates) + 1) * 10.0
    np.testing.assert_allclose(path.start[2] + np.cumsum(rates), path.headings(at[1:]), atol=1e-9)


def test_the_intent_is_a_series_of_poses_until_the_end() -> None:
    path = shortest_path((0, 0, 0), (25, 0, 0), 10.0)
    intent = path.intent(3_000_000_000, 10.0, 1.0)
    assert intent.times.tolist() == [3_000_000_000, 4_000_000_000, 5_000_000_000, 5_500_000_000]
    np.testing.assert_allclose(intent.values[:, 0], [0, 10, 20, 25], atol=1e-12)


def test_beyond_the_end_it_goes_straight_on() -> None:
    path = shortest_path((0, 0, 0), (25, 0, 0), 10.0)
    np.testing.assert_allclose(path.poses([100.0]), [[100, 0, 0]], atol=1e-12)


def test_an_invalid_radius_is_refused() -> None:
    with pytest.raises(ValueError, match="radius"):
        shortest_path((0, 0, 0), (1, 1, 1), 0.0)
