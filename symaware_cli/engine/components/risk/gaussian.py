"""Probabilities of Gaussian positions: that discs or balls collide, and integrals over polygons and bands.

Over polygons and bands they are in closed form, by Owen's T function: T(h, a) is the probability that a standard normal
x exceeds h while an independent one lies between 0 and a x (D. B. Owen, "Tables for computing bivariate normal
probabilities", Annals of Mathematical Statistics 27, 1956). It gives the integral over the region behind an edge as
seen from the mean, hence over polygons, and over quadrants.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import ndtr, owens_t

from symaware_cli.engine.components.relative_motion import dot
from symaware_cli.geometry import Array, Pieces, following

#: Replaces 0 as a divisor.
_TINY = 1e-200
#: Standard deviations below this part of a polygon's extent, or of a radius, are raised to it, so that a density is
#: never singular.
_FLOOR = 1e-7
#: Beyond this many standard deviations a density counts as zero: 2.6e-12 of it lies farther out.
_WIDTH = 7.0
#: Like _WIDTH, for vectors of up to three elements, with the trace in place of the greatest variance.
_CERTAIN = 8.0
#: The number of nodes of an integral is increased until two results differ by no more than this.
_TOLERANCE = 1e-6
_LEVELS = (16, 32, 64, 128, 256, 512, 1024)
#: The most values of an integrand to hold in memory at once.
_MOST_VALUES = 1 << 20


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
    along_u, along_v = following(u) - u, following(v) - v
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


def _sum(values: Array) -> Array:
    """Add up the elements of each row, in an order that does not depend on the number of rows."""
    total = values[:, 0].copy()
    for column in range(1, values.shape[1]):
        total += values[:, column]
    return total


def collision_probability(apart: Array, closing: Array, radius: Array, covariance: Array, horizon: float) -> Array:
    """Return the probability that two bodies come closer than a distance within a horizon.

    Relative motion is assumed to be rectilinear at the expected velocity, and the relative position Gaussian. The
    bodies then meet exactly if the relative position lies in the capsule that a ball of the given radius sweeps from
    the origin against the relative velocity for the horizon, and the probability is the integral of the Gaussian over
    the capsule: K. Foster and H. S. Estes, "A parametric analysis of orbital debris collision probability and maneuver
    rate for space vehicles", NASA JSC-25898, 1992, and F. K. Chan, "Spacecraft Collision Probability", 2008, for
    short-term encounters, with an infinite horizon. The integral across the motion uses Gauss-Legendre quadrature where
    the density is not negligible, that along the motion is in closed form. The error is below 1e-5, and up to 0.01 if
    the covariance is nearly singular and oblique to the motion.

    Args:
        apart: The expected relative position [m]; shape (d, m), d = 2 or 3.
        closing: The expected relative velocity [m/s]; shape (d, m).
        radius: The distance that counts as a collision [m]; shape (m,).
        covariance: Covariance of the relative position [m^2]; shape (m, d, d).
        horizon: Time horizon [s].

    Returns:
        Probabilities, shape (m,). Without uncertainty 1 for a distance below the radius within the horizon, else 0.
    """
    speed = np.sqrt(dot(closing, closing))
    length = speed * horizon
    time = closest_approach(apart, closing, horizon)
    depth = radius - np.sqrt(dot(*(2 * [apart + closing * time])))
    spread = np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 0.0))
    probability = np.where(depth > 0.0, 1.0, 0.0)
    rows = np.flatnonzero((np.abs(depth) <= _CERTAIN * spread) & (radius > 0.0))
    if len(rows):
        axes = _axes(closing[:, rows], speed[rows])
        mean = np.stack([dot(axis, apart[:, rows]) for axis in axes])
        rotated = np.stack([np.stack(list(axis), axis=1) for axis in axes], axis=1)
        turned = rotated @ covariance[rows] @ np.swapaxes(rotated, 1, 2)
        probability[rows] = _refined(mean, turned, radius[rows], length[rows])
    probability[radius <= 0.0] = 0.0
    return np.minimum(np.maximum(probability, 0.0), 1.0)


def closest_approach(apart: Array, closing: Array, horizon: float) -> Array:
    """Return the time at which two bodies are closest within a horizon [s]; shape (m,) for vectors (d, m)."""
    square = dot(closing, closing)
    moving = square > 0.0
    time = np.where(moving, -dot(apart, closing) / np.where(moving, square, 1.0), 0.0)
    return np.minimum(np.maximum(time, 0.0), horizon)


def _axes(closing: Array, speed: Array) -> list[Array]:
    """Return unit vectors across the motion and, as the last, along it; each of shape (d, m)."""
    moving = speed > 0.0
    along = np.where(moving, closing / np.where(moving, speed, 1.0), 0.0)
    along[0, ~moving] = 1.0
    if len(along) == 2:
        return [np.stack([-along[1], along[0]]), along]
    x, y, z = along
    # Any vector across serves; this one avoids cancellation (T. Duff et al., "Building an orthonormal basis,
    # revisited", J. Computer Graphics Techniques 6, 2017).
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return [np.stack([1.0 + sign * x * x * a, sign * b, -sign * x]), np.stack([b, sign + y * y * a, -y]), along]


def _refined(mean: Array, covariance: Array, radius: Array, length: Array) -> Array:
    """Integrate by `_capsule`, each row with as many nodes as it needs."""
    result = np.full(len(radius), np.inf)
    rows = np.arange(len(radius))
    # In space a second axis across squares the number of nodes.
    for count in _LEVELS if len(mean) == 2 else _LEVELS[:4]:
        nodes = _legendre(count)
        some = max(1, _MOST_VALUES // count ** (len(mean) - 1))
        for part in np.split(rows, range(some, len(rows), some)):
            before = result[part]
            result[part] = _capsule(mean[:, part], covariance[part], radius[part], length[part], nodes)
            rows = np.setdiff1d(rows, part[np.abs(result[part] - before) <= _TOLERANCE], assume_unique=True)
        if not len(rows):
            break
    return result


@cache
def _legendre(count: int) -> tuple[Array, Array]:
    """Return nodes and weights of the Gauss-Legendre quadrature on [-1, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights


def _capsule(mean: Array, covariance: Array, radius: Array, length: Array, nodes: tuple[Array, Array]) -> Array:
    """Integrate Gaussians over capsules from the origin to -length along the last axis.

    Args:
        mean: Means across the motion and, as the last, along it; shape (d, m).
        covariance: Covariances in the same axes; shape (m, d, d).
        radius: Radii; shape (m,).
        length: Lengths of the capsules; shape (m,).
        nodes: Nodes and weights from `_legendre`, for each axis across.
    """
    lower = _cholesky(covariance, _FLOOR * radius)
    # After each axis, the second dimension enumerates all nodes of the axes so far.
    half, weight = radius[:, None], np.ones((len(radius), 1))
    expected = [element[:, None] for element in mean]
    for axis in range(len(mean) - 1):
        deviation = lower[axis][axis][:, None]
        place, density = _quadrature(expected[axis], deviation, half, nodes)
        standard = (place - expected[axis][..., None]) / deviation[..., None]
        half = np.sqrt(np.maximum(half[..., None] ** 2 - place * place, 0.0)).reshape(len(radius), -1)
        weight = (weight[..., None] * density).reshape(len(radius), -1)
        for later in range(axis + 1, len(mean)):
            shifted = expected[later][..., None] + lower[later][axis][:, None, None] * standard
            expected[later] = shifted.reshape(len(radius), -1)
    deviation, middle = lower[-1][-1][:, None], expected[-1]
    inside = ndtr((half - middle) / deviation) - ndtr((-length[:, None] - half - middle) / deviation)
    return _pairwise_sum(weight * inside)


def _quadrature(mean: Array, deviation: Array, half: Array, nodes: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return nodes within [-half, half] where a normal density is not negligible, and density times weights.

    The nodes are spaced in the angle whose sine is the position over the half width, in which the round ends of a
    capsule are smooth.

    Args:
        mean: Means; shape (m, k).
        deviation: Standard deviations; shape (m, 1).
        half: Half widths; shape (m, k).
        nodes: Nodes and weights on [-1, 1].

    Returns:
        Both of shape (m, k, nodes).
    """
    safe = np.where(half > 0.0, half, 1.0)
    low = np.arcsin(np.minimum(np.maximum((mean - _WIDTH * deviation) / safe, -1.0), 1.0))
    high = np.arcsin(np.minimum(np.maximum((mean + _WIDTH * deviation) / safe, -1.0), 1.0))
    angle = (0.5 * (low + high))[..., None] + (0.5 * (high - low))[..., None] * nodes[0]
    place = half[..., None] * np.sin(angle)
    width = half[..., None] * np.cos(angle) * (0.5 * (high - low))[..., None] * nodes[1]
    standard = (place - mean[..., None]) / deviation[..., None]
    return place, width * np.exp(-0.5 * standard * standard) / (np.sqrt(2.0 * np.pi) * deviation[..., None])


def _cholesky(covariance: Array, floor: Array) -> list[list[Array]]:
    """Return the Cholesky factors of covariances, also of semidefinite ones.

    Returns:
        Element (i, j) of all of them, each of shape (m,).
    """
    size = covariance.shape[1]
    lower: list[list[Array]] = [[] for _ in range(size)]
    for row in range(size):
        for column in range(row):
            rest = 0.5 * (covariance[:, row, column] + covariance[:, column, row])
            for earlier in range(column):
                rest = rest - lower[row][earlier] * lower[column][earlier]
            lower[row].append(rest / lower[column][column])
        rest = covariance[:, row, row]
        for earlier in range(row):
            rest = rest - lower[row][earlier] * lower[row][earlier]
        lower[row].append(np.sqrt(np.maximum(rest, floor * floor)))
    return lower


def _pairwise_sum(values: Array) -> Array:
    """Add up the elements of each row, in an order that depends only on their number."""
    while values.shape[1] > 1:
        odd = values[:, -1:] if values.shape[1] % 2 else None
        paired = values.shape[1] // 2
        values = values[:, :paired] + values[:, paired : 2 * paired]
        if odd is not None:
            values = np.concatenate([values, odd], axis=1)
    return values[:, 0]
