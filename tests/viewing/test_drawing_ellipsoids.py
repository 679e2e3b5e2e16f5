"""What holds 95 % of a normal distribution."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from symaware_cli.viewing.scene.uncertainties import DEVIATIONS, ellipsoids


@pytest.mark.parametrize("dimension", [2, 3])
def test_they_reach_as_far_as_the_chi_square_distribution_says(dimension: int) -> None:
    assert DEVIATIONS[dimension] == pytest.approx(np.sqrt(chi2.ppf(0.95, dimension)), abs=1e-4)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_the_turned_half_sizes_make_the_covariance_again(seed: int, dimension: int) -> None:
    factors = np.random.default_rng(seed).normal(size=(4, dimension, dimension))
    covariances = factors @ factors.swapaxes(1, 2)
    half_sizes, quaternions = ellipsoids(covariances)
    axes = Rotation.from_quat(quaternions).as_matrix()
    made = axes @ (np.eye(3) * (half_sizes[:, None] / DEVIATIONS[dimension]) ** 2) @ axes.swapaxes(1, 2)
    np.testing.assert_allclose(made[:, :dimension, :dimension], covariances, atol=1e-9)
    if dimension == 2:
        assert (half_sizes[:, 2] == 0).all()


def test_what_is_not_known_has_no_size() -> None:
    half_sizes, quaternions = ellipsoids(np.array([np.full((2, 2), np.nan), np.eye(2)]))
    assert half_sizes[0].tolist() == [0, 0, 0]
    assert np.isfinite(quaternions).all()
    assert half_sizes[1, :2].tolist() == [DEVIATIONS[2]] * 2
