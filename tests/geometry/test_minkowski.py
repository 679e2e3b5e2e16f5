"""Meeting places and times, against Shapely and dense sampling."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from outlines import distance, placed, random_core, random_shape
from shapely import Polygon

from symaware_cli.geometry.minkowski import cornered, loosened, overlap_region, within
from symaware_cli.geometry.pieces import Pieces, separation_from_points

seeds = st.integers(0, 2**32 - 1)


def random_pieces(random: np.random.Generator, count: int) -> tuple[Pieces, list[tuple[NDArray[np.float64], float]]]:
    """Discs, capsules, boxes and polygons around the origin, turned anyhow; as pieces and as cores."""
    listed = []
    for _ in range(count):
        kind = random.integers(3)
        if kind == 0:
            listed.append((random_core(random, 2) * 0.7, random.uniform(0, 0.5)))
        else:
            ((core, rounding),) = placed(random_shape(random), (0, 0), random.uniform(-4, 4))
            listed.append((core, rounding + (random.uniform(0, 0.3) if kind == 1 else 0.0)))
    return Pieces.of(listed), listed


def shape_of(core: NDArray[np.float64], rounding: float) -> Polygon:
    hull = shapely.MultiPoint(core).convex_hull
    return hull.buffer(rounding, quad_segs=256) if rounding else hull


@settings(max_examples=40)
@given(seeds)
def test_two_bodies_overlap_where_one_lies_in_the_overlap_region_of_the_other(seed: int) -> None:
    random = np.random.default_rng(seed)
    (first, ones), (second, others) = random_pieces(random, 8), random_pieces(random, 8)
    places = random.uniform(-3, 3, (8, 2))
    found = separation_from_points(places, np.zeros(8), overlap_region(first, second)).distance
    expected = [
        distance(one, (core + place, rounding))
        for one, (core, rounding), place in zip(ones, others, places, strict=True)
    ]
    np.testing.assert_allclose(found, expected, atol=1e-9)


@settings(max_examples=40)
@given(seeds)
def test_polygons_around_rounded_pieces_contain_them_tightly(seed: int) -> None:
    pieces, listed = random_pieces(np.random.default_rng(seed), 8)
    for vertices, (core, rounding) in zip(cornered(pieces).vertices, listed, strict=True):
        # Edges without length are no matter to Shapely.
        polygon, exact = shapely.Polygon(vertices).buffer(1e-9), shape_of(core, rounding)
        assert polygon.contains(exact)
        assert polygon.hausdorff_distance(exact) <= 0.01 * rounding + 1e-6


@settings(max_examples=40)
@given(seeds)
def test_a_loosened_piece_contains_the_piece_at_each_angle(seed: int) -> None:
    random = np.random.default_rng(seed)
    pieces, _ = random_pieces(random, 8)
    angles = random.choice([0.0, 0.05, 0.4, 2.0, np.pi, 9.0], 8)
    wide = loosened(pieces, angles)
    for share in np.linspace(-1, 1, 9):
        turned = pieces.placed(np.zeros((8, 2)), share * np.minimum(angles, np.pi))
        for corner in range(turned.vertices.shape[1]):
            inside = separation_from_points(turned.vertices[:, corner], turned.rounding, wide).distance
            assert (inside + 2 * turned.rounding <= 1e-9).all()


@settings(max_examples=60)
@given(seeds)
def test_a_point_is_within_a_piece_from_when_until_when_dense_sampling_finds_it_there(seed: int) -> None:
    random = np.random.default_rng(seed)
    (first, _), (second, _) = random_pieces(random, 16), random_pieces(random, 16)
    pieces = overlap_region(first, second)
    points, velocities = random.uniform(-4, 4, (16, 2)), random.normal(size=(16, 2))
    velocities[0] = 0.0
    velocities[1:6] = -points[1:6] * random.uniform(0.2, 1.0)
    start, end = within(points, velocities, pieces)
    times = np.linspace(-20, 20, 4001)
    # All instants at once.
    places = (points + times[:, None, None] * velocities).reshape(-1, 2)
    of_each = pieces.take(np.tile(np.arange(16), len(times)))
    apart = separation_from_points(places, np.zeros(len(places)), of_each).distance.reshape(-1, 16)
    said = (start <= times[:, None]) & (times[:, None] <= end)
    assert ((apart < 0.0) == said)[np.abs(apart) > 1e-9].all()


def test_intervals_are_empty_for_points_that_pass_by_and_infinite_for_resting_ones_within() -> None:
    box = Pieces.of([([(-1, -1), (1, -1), (1, 1), (-1, 1)], 0.0)] * 3)
    start, end = within(np.array([[-5, 1.5], [0, 0], [5, 0]]), np.array([[1.0, 0], [0, 0], [-1, 0]]), box)
    assert start[0] > end[0]
    assert (start[1], end[1]) == (-np.inf, np.inf)
    assert (start[2], end[2]) == pytest.approx((4.0, 6.0))
