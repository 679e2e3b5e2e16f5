"""Integrals of Gaussians over polygons and bands in closed form, by Owen's T function.

T(h, a) is the probability that a standard normal x exceeds h while an independent one lies between 0 and a x (D. B.
Owen, "Tables for computing bivariate normal probabilities", Annals of Mathematical Statistics 27, 1956). It gives the
integral over the region behind an edge as seen from the mean, hence over polygons, and over quadrants.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, owens_t

from symaware_cli.geometry.pieces import Pieces

Array = NDArray[np.float64]

#: Replaces 0 as a divisor.
_TINY = 1e-200
#: Standard deviations below this part of a polygon's extent are raised to it, so that a density is never singular.
_FLOOR = 1e-7


def polygon_probability(mean: Array, covariance: Array, polygons: Pieces) -> Array:
    """Return the probabilities that Gaussian points lie in convex polygons, row by row.

    In coordinates in which the Gaussian is standard and centred at the origin, the region behind an edge as seen from
    there, at the distance h from its line and from s to e along it, has the probability T(h, e / h) - T(h, s / h). The
    polygon has the probability one, or zero, minus the regions behind the edges that face away, plus those behind the
    edges that face the mean, whose h is negative.

    Args:
        mean: Means [m]; shape (m, 2).
        covariance: Covariances [m^2], possibly singular; shape (m, 2, 2).
        polygons: Cores counter-clockwise, edges without length allowed; roundings are ignored.

    Returns:
        Shape (m,); with an error of about 1e-14.
    """
    vertices, normals = polygons.vertices, polygons.normals
    x, y = vertices[..., 0] - mean[:, 0, None], vertices[..., 1] - mean[:, 1, None]
    floor = _FLOOR * np.sqrt(np.ptp(vertices[..., 0], axis=1) ** 2 + np.ptp(vertices[..., 1], axis=1) ** 2) + _TINY
    # The Cholesky factor of the covariance, also if it is only semidefinite.
    one = np.sqrt(np.maximum(covariance[:, 0, 0], floor * floor))
    cross = 0.5 * (covariance[:, 0, 1] + covariance[:, 1, 0]) / one
    other = np.sqrt(np.maximum(covariance[:, 1, 1] - cross * cross, floor * floor))
    one, cross, other = one[:, None], cross[:, None], other[:, None]
    real = np.isfinite(polygons.offsets)
    # In the original coordinates, which avoids cancellation: the distance of an edge over the deviation across it.
    across = np.hypot(one * normals[..., 0] + cross * normals[..., 1], other * normals[..., 1])
    height = (normals[..., 0] * x + normals[..., 1] * y) / np.where(real, across, 1.0)
    height = np.where(np.abs(height) < _TINY, _TINY, height)
    u = x / one
    v = (y - cross * u) / other
    along_u, along_v = _next(u) - u, _next(v) - v
    length = np.hypot(along_u, along_v)
    scale = np.where(length > 0.0, length, 1.0)
    along_u, along_v = along_u / scale, along_v / scale
    start = u * along_u + v * along_v
    behind = owens_t(height, (start + length) / height) - owens_t(height, start / height)
    inside = (~real | (height > 0.0)).all(axis=1)
    probability: Array = inside - _sum(np.where(real, behind, 0.0))
    return np.minimum(np.maximum(probability, 0.0), 1.0)


def band_probability(
    means: tuple[Array, Array], variances: tuple[Array, Array], covariance: Array, low: Array, high: Array
) -> Array:
    """Return the probabilities that a value with a constant rate is ever between two bounds.

    It is never between them if it is above at both times, or below at both times; otherwise it is.

    Args:
        means: The expected values at the first time and the last; any shape each.
        variances: The variances at these times.
        covariance: The covariance between the two.
        low: The lower bound.
        high: The upper bound.
    """
    first, last = (np.sqrt(np.maximum(each, 0.0)) + _TINY for each in variances)
    correlation = np.clip(covariance / first / last, -1.0, 1.0)
    above = _below_both((means[0] - high) / first, (means[1] - high) / last, correlation)
    below = _below_both((low - means[0]) / first, (low - means[1]) / last, correlation)
    probability: Array = 1.0 - above - below
    return np.minimum(np.maximum(probability, 0.0), 1.0)


def _below_both(one: Array, other: Array, correlation: Array) -> Array:
    """Return the probability that two correlated standard normals lie below two bounds (Owen, 1956, (2.1))."""
    one, other = (np.where(np.abs(each) < _TINY, _TINY, np.clip(each, -40.0, 40.0)) for each in (one, other))
    rest = np.sqrt(np.maximum((1.0 - correlation) * (1.0 + correlation), 1e-30))
    owen = owens_t(one, (other / one - correlation) / rest) + owens_t(other, (one / other - correlation) / rest)
    both: Array = 0.5 * (ndtr(one) + ndtr(other)) - owen - np.where(one * other < 0.0, 0.5, 0.0)
    return np.minimum(np.maximum(both, 0.0), 1.0)


def _next(values: Array) -> Array:
    return np.concatenate([values[:, 1:], values[:, :1]], axis=1)


def _sum(values: Array) -> Array:
    """Add up the elements of each row, in an order that does not depend on the number of rows."""
    total = values[:, 0].copy()
    for column in range(1, values.shape[1]):
        total += values[:, column]
    return total
