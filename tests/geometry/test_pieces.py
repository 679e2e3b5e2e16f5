"""Distances, overlaps and lines of sight, against the Minkowski difference, dense sampling, and Shapely."""

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from outlines import distance, outline, placed, random_core, random_shape

from symaware_cli.geometry.pieces import Pieces, separation

seeds = st.integers(0, 2**32 - 1)


def random_pieces(random: np.random.Generator, count: int, corners: int) -> list[tuple[NDArray[np.float64], float]]:
    """Pieces of at most so many corners, not far from the origin; some have the same place, or stand in a row."""
    pieces = []
    for _ in range(count):
        number = int(random.integers(1, corners + 1))
        place = random.choice([random.uniform(-1.5, 1.5, 2), np.round(random.uniform(-1.5, 1.5, 2)), np.zeros(2)])
        core = random_core(random, number) + place
        if number <= 2 or random.random() < 0.3:
            core = np.round(core, 1)
        if number > 2 and shapely.MultiPoint(core).convex_hull.area < 0.01:
            core = random_core(random, 1) + place
        elif number > 2:
            core = np.array(shapely.MultiPoint(core).convex_hull.exterior.normalize().reverse().coords)[:-1]
        elif number == 2 and (core[0] == core[1]).all():
            core = core[:1]
        pieces.append((core, random.choice([0.0, random.uniform(0, 0.5)])))
    return pieces


@settings(max_examples=60)
@given(seeds, st.sampled_from([1, 2, 8]), st.sampled_from([1, 2, 8]))
def test_two_pieces_are_as_far_apart_as_their_minkowski_difference_is_from_the_origin(
    seed: int, some: int, others: int
) -> None:
    random = np.random.default_rng(seed)
    first, second = random_pieces(random, 20, some), random_pieces(random, 20, others)
    found = separation(Pieces.of(first), Pieces.of(second))
    expected = [distance(one, other) for one, other in zip(first, second, strict=True)]
    np.testing.assert_allclose(found.distance, expected, atol=1e-9)
    # The points lie on the outlines, as far apart as the pieces are.
    for one, other, at_one, at_other in zip(first, second, found.first, found.second, strict=True):
        assert abs(distance(one, (at_one[None], 0.0))) < 1e-9
        assert abs(distance(other, (at_other[None], 0.0))) < 1e-9
    apart = np.linalg.norm(found.second - found.first, axis=1)
    np.testing.assert_allclose(apart, np.abs(expected), atol=1e-9)


@given(seeds)
def test_moved_apart_by_their_overlap_two_pieces_just_touch(seed: int) -> None:
    random = np.random.default_rng(seed)
    first, second = random_pieces(random, 20, 6), random_pieces(random, 20, 6)
    found = separation(Pieces.of(first), Pieces.of(second))
    shifts = found.first - found.second
    moved = [(core + shift, rounding) for (core, rounding), shift in zip(second, shifts, strict=True)]
    np.testing.assert_allclose(separation(Pieces.of(first), Pieces.of(moved)).distance, 0.0, atol=1e-9)


@settings(max_examples=10)
@given(seeds)
def test_no_two_points_of_two_outlines_are_nearer_than_the_distance(seed: int) -> None:
    random = np.random.default_rng(seed)
    one, other = (random_core(random, 5), 0.0), (random_core(random, 2) + np.array([3.0, 0.0]), 0.3)
    found = separation(Pieces.of([one]), Pieces.of([other])).distance[0]
    between = np.linalg.norm(outline(one)[:, None] - outline(other)[None], axis=2)
    assert found > 0.0
    assert found - 1e-4 < between.min() < found + 0.02


def test_the_points_of_parallel_edges_are_in_their_middle() -> None:
    lower = ([(0, 0), (4, 0), (4, 1), (0, 1)], 0.0)
    upper = ([(3, 2), (9, 2), (9, 3), (3, 3)], 0.0)
    found = separation(Pieces.of([lower, upper]), Pieces.of([upper, lower]))
    np.testing.assert_allclose(found.distance, [1, 1])
    np.testing.assert_allclose(found.first, [(3.5, 1), (3.5, 2)])
    np.testing.assert_allclose(found.second, [(3.5, 2), (3.5, 1)])


def test_pieces_in_one_line_overlap_only_where_they_do() -> None:
    line, point = ([(0, 0), (1, 0)], 0.0), ([(3, 0)], 0.25)
    behind, within = ([(2, 0), (5, 0)], 0.0), ([(0.5, 0), (9, 0)], 0.0)
    found = separation(Pieces.of([line] * 3), Pieces.of([point, behind, within]))
    np.testing.assert_allclose(found.distance, [1.75, 1.0, 0.0])
    np.testing.assert_allclose(found.second, [(2.75, 0), (2, 0), (0.75, 0)])


@given(seeds)
def test_a_placed_piece_is_turned_about_the_origin_and_then_moved(seed: int) -> None:
    random = np.random.default_rng(seed)
    shape, position, heading = random_shape(random), random.uniform(-9, 9, 2), random.uniform(-9, 9)
    turned = Pieces.of(shape.pieces).placed(position[None], np.array([heading]))
    fresh = Pieces.of(placed(shape, position, heading))
    for name in ("vertices", "normals", "offsets", "rounding"):
        np.testing.assert_allclose(getattr(turned, name), getattr(fresh, name), atol=1e-12)
