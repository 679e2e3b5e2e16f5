"""Integrals of Gaussians in the plane in closed form, by Owen's T function.

T(h, a) is the probability that a standard normal x exceeds h while an independent one lies between 0 and a x (D. B.
Owen, "Tables for computing bivariate normal probabilities", Annals of Mathematical Statistics 27, 1956). It gives the
integral over all that lies behind an edge as seen from the mean, hence over polygons, and over quadrants.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, owens_t

from symaware_cli.geometry.pieces import Pieces

Array = NDArray[np.float64]

#: Takes the place of 0 where that would divide.
_TINY = 1e-200
#: Standard deviations below this part of a polygon's extent are raised to it, so that a density is never a spike.
_FLOOR = 1e-7


def polygon_probability(mean: Array, covariance: Array, polygons: Pieces) -> Array:
    """Return the probabilities that Gaussian points lie in convex polygons, row by row.

    With the coordinates changed so that the Gaussian is the standard one around the origin, what lies behind an edge
    as seen from there, at the distance h from its line and from s to e along it, has the probability T(h, e / h) - T(h,
    s / h). The polygon is all, or nothing, less what lies behind the edges that face away, and with what lies behind
    those that face the mean, whose h is negative.

    Args:
        mean: Shape (m, 2) [m].
        covariance: Shape (m, 2, 2) [m^2]; may be singular.
        polygons: Cores counter-clockwise, edges without length allowed; their rounding is left out of account.

    Returns:
        Shape (m,); errs by about 1e-14.
    """
    vertices, normals = polygons.vertices, polygons.normals
    x, y = vertices[..., 0] - mean[:, 0, None], vertices[..., 1] - mean[:, 1, None]
    floor = _FLOOR * np.sqrt(np.ptp(vertices[..., 0], axis=1) ** 2 + np.ptp(vertices[..., 1], axis=1) ** 2) + _TINY
    # Cholesky's triangle of the covariance, and of one that is only semidefinite.
    one = np.sqrt(np.maximum(covariance[:, 0, 0], floor * floor))
    cross = 0.5 * (covariance[:, 0, 1] + covariance[:, 1, 0]) / one
    other = np.sqrt(np.maximum(covariance[:, 1, 1] - cross * cross, floor * floor))
    one, cross, other = one[:, None], cross[:, None], other[:, None]
    real = np.isfinite(polygons.offsets)
    # In the old coordinates, where nothing cancels: the distance of an edge by the deviation across it.
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
    """Return the probabilities that something that moves straight on is ever between two bounds.

    It never is if it is above both times, or below both times, and is otherwise.

    Args:
        means: Where it is expected at the first time and at the last; any shape each.
        variances: Of where it is at these.
        covariance: Between the two.
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
    """The probability that two standard normals of some correlation lie below two bounds (Owen, 1956, (2.1))."""
    one, other = (np.where(np.abs(each) < _TINY, _TINY, np.clip(each, -40.0, 40.0)) for each in (one, other))
    rest = np.sqrt(np.maximum((1.0 - correlation) * (1.0 + correlation), 1e-30))
    owen = owens_t(one, (other / one - correlation) / rest) + owens_t(other, (one / other - correlation) / rest)
    both: Array = 0.5 * (ndtr(one) + ndtr(other)) - owen - np.where(one * other < 0.0, 0.5, 0.0)
    return np.minimum(np.maximum(both, 0.0), 1.0)


def _next(values: Array) -> Array:
    return np.concatenate([values[:, 1:], values[:, :1]], axis=1)


def _sum(values: Array) -> Array:
    """Add up the elements of each row, in an order that does not depend on how many rows there are."""
    total = values[:, 0].copy()
    for column in range(1, values.shape[1]):
        total += values[:, column]
    return total
