"""Integrals of Gaussians over polygons and bands, against SciPy and sampling."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from outlines import random_core
from scipy.stats import multivariate_normal, norm

from symaware_cli.engine.components.risk.gaussian import _below_both, band_probability, polygon_probability
from symaware_cli.geometry.minkowski import overlap_region
from symaware_cli.geometry.pieces import Pieces

seeds = st.integers(0, 2**32 - 1)


def box(x: float, y: float, *, low: tuple[float, float] = (0.0, 0.0)) -> Pieces:
    return Pieces.of([([low, (x, low[1]), (x, y), (low[0], y)], 0.0)])


@settings(max_examples=60)
@given(seeds, st.floats(0, 6.3))
def test_the_probability_of_a_box_is_the_product_of_two_normals(seed: int, turn: float) -> None:
    random = np.random.default_rng(seed)
    low, size = random.uniform(-2, 1, 2), random.uniform(0.1, 3, 2)
    deviations = 10.0 ** random.uniform(-4, 1, 2)
    sides = norm.cdf((low + size) / deviations) - norm.cdf(low / deviations)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    corners = low + size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    polygon = Pieces.of([(corners @ rotation.T, 0.0)])
    covariance = rotation @ np.diag(deviations**2) @ rotation.T
    found = polygon_probability(np.zeros((1, 2)), covariance[None], polygon)
    assert found[0] == pytest.approx(sides.prod(), abs=2e-9)


@settings(max_examples=40)
@given(seeds)
def test_the_probability_of_a_polygon_is_the_sum_of_those_of_its_halves(seed: int) -> None:
    random = np.random.default_rng(seed)
    corners = random_core(random, 6, 2.0)
    square = random.normal(size=(2, 2))
    mean, covariance = random.uniform(-2, 2, (1, 2)), (square @ square.T)[None]
    parts = [corners, corners[:4], np.concatenate([corners[3:], corners[:1]])]
    whole, *halves = (polygon_probability(mean, covariance, Pieces.of([(part, 0.0)]))[0] for part in parts)
    assert sum(halves) == pytest.approx(whole, abs=1e-12)


def test_where_nothing_is_uncertain_the_probability_is_one_inside_and_none_outside() -> None:
    polygon = overlap_region(box(1, 1), box(0.5, 0.2), np.array([[3.0, 0.0]]))
    nothing = np.zeros((1, 2, 2))
    assert polygon_probability(np.array([[0.5, 0.5]]), nothing, polygon) == [1.0]
    assert polygon_probability(np.array([[0.5, 1.0001]]), nothing, polygon) == [0.0]
    blade = np.array([[[1.0, 1.0], [1.0, 1.0]]])
    assert polygon_probability(np.array([[0.5, 0.5]]), blade, box(1, 1)) == pytest.approx(2 * norm.cdf(0.5) - 1)


@pytest.mark.parametrize("correlation", [-0.999, -0.5, 0.0, 0.3, 0.99999])
def test_the_probability_of_a_quadrant_is_that_of_scipy(correlation: float) -> None:
    values = np.array([-3.0, -0.7, 0.0, 1e-9, 0.4, 2.5])
    one, other = (each.ravel() for each in np.meshgrid(values, values))
    found = _below_both(one, other, np.full(len(one), correlation))
    exact = multivariate_normal(cov=[[1, correlation], [correlation, 1]]).cdf(np.stack([one, other], axis=1))
    np.testing.assert_allclose(found, exact, atol=1e-6)


def test_a_band_is_crossed_as_often_as_sampling_finds() -> None:
    random = np.random.default_rng(3)
    for _ in range(30):
        mean, square = random.normal(size=2) * 2, random.normal(size=(2, 2))
        covariance, (low, high) = square @ square.T, np.sort(random.normal(size=2))
        first, last = random.multivariate_normal(mean, covariance, size=200_000).T
        sampled = 1 - ((first > high) & (last > high)).mean() - ((first < low) & (last < low)).mean()
        arguments = (*zip(mean, np.diag(covariance), strict=True), covariance[0, 1], low, high)
        (m0, v0), (m1, v1), cross, *bounds = arguments
        found = band_probability(
            (np.array([m0]), np.array([m1])), (np.array([v0]), np.array([v1])), np.array([cross]), *bounds
        )
        assert found[0] == pytest.approx(sampled, abs=0.005)
