"""The probability of a broken promise, compared with exact values and with samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from symaware_cli.geometry import Pieces
from symaware_cli.promises.breach import breach_probability

BOX = ([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)], 0.0)
DISC = ([(0.0, 0.0)], 1.0)


def probability(mean: tuple[float, float], covariance: list[list[float]], piece: object) -> float:
    found = breach_probability(np.array([mean]), np.array([covariance]), Pieces.of([piece]))  # type: ignore[list-item]
    return float(found[0])


def test_beyond_one_side_the_bound_is_that_of_a_half_plane() -> None:
    for x in (0.7, 0.95, 1.0, 1.2):
        exact = norm.cdf((x - 1.0) / 0.1)
        assert probability((x, 0.0), [[0.01, 0.0], [0.0, 0.01]], BOX) == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("piece", [BOX, DISC, ([(-1.0, 0.0), (1.0, 0.0)], 0.5)])
def test_the_bound_is_never_above_the_share_of_samples_outside(piece: object) -> None:
    random = np.random.default_rng(5)
    pieces = Pieces.of([piece])  # type: ignore[list-item]
    from symaware_cli.geometry import separation_from_points

    for _ in range(40):
        mean, root = random.uniform(-1.6, 1.6, 2), random.normal(0.0, 0.3, (2, 2))
        covariance = root @ root.T
        samples = mean + random.standard_normal((4000, 2)) @ root.T
        outside = separation_from_points(samples, np.zeros(4000), pieces.take(np.zeros(4000, np.intp))).distance > 0.0
        share = outside.mean()
        tolerance = 4.0 * np.sqrt(max(share * (1.0 - share), 1.0 / 4000) / 4000)
        assert probability((mean[0], mean[1]), covariance.tolist(), piece) <= share + tolerance


def test_at_a_corner_the_bound_is_below_the_exact_probability_of_a_box() -> None:
    mean, covariance = (0.95, 0.95), [[0.04, 0.02], [0.02, 0.04]]
    normal = multivariate_normal(mean, covariance)
    inside = normal.cdf([1, 1]) - normal.cdf([-1, 1]) - normal.cdf([1, -1]) + normal.cdf([-1, -1])
    found = probability(mean, covariance, BOX)
    assert 0.5 * (1.0 - inside) < found < 1.0 - inside


@pytest.mark.parametrize("piece", [BOX, DISC])
def test_an_exact_position_is_inside_or_outside(piece: object) -> None:
    nothing = [[0.0, 0.0], [0.0, 0.0]]
    for mean, expected in (((0.0, 0.0), 0.0), ((1.0, 0.0), 0.0), ((1.0 + 1e-9, 0.0), 1.0), ((3.0, 3.0), 1.0)):
        assert probability(mean, nothing, piece) == expected, mean
