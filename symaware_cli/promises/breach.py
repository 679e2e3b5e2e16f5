"""The probability that a promise is broken, from the believed position of the agent that made it."""

from __future__ import annotations

import numpy as np
from scipy.special import erfc

from symaware_cli.geometry import Array, Pieces, separation_from_points


def breach_probability(means: Array, covariances: Array, sets: Pieces) -> Array:
    """Return a lower bound of the probability that normally distributed positions are outside of convex sets.

    A convex set lies within each of its supporting half planes, so the probability of lying beyond any of them is a
    lower bound, and the greatest is taken: over the sides of the set, and the tangent at its nearest point to the mean.
    The bound is exact for half planes, and near a single side of a box or a polygon, except for the probability of
    lying beyond other sides alone. Positions that are known exactly are outside with probability 0 or 1.

    Args:
        means: The believed positions [m]; shape (m, 2).
        covariances: The covariances of the positions [m^2]; shape (m, 2, 2).
        sets: The convex set of each position; m rows.

    Returns:
        Shape (m,).
    """
    nearest = separation_from_points(means, np.zeros(len(means)), sets)
    away = np.sign(nearest.distance)[:, None] * (means - nearest.second)
    length = np.sqrt(away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1])
    on_edge = length == 0.0
    # For points on the outline, the sides of the set serve as tangents; for a disc, the direction of the radius.
    middle = means - sets.vertices.mean(axis=1)
    away = np.where(on_edge[:, None], middle, away)
    length = np.sqrt(away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1])
    tangent = away / np.where(length > 0.0, length, 1.0)[:, None]
    beyond = np.where((length > 0.0) & (~on_edge | (sets.vertices.shape[1] == 1)), nearest.distance, -np.inf)
    normals = np.concatenate([sets.normals, tangent[:, None, :]], axis=1)
    sides = (sets.normals * means[:, None, :]).sum(axis=2) - sets.offsets - sets.rounding[:, None]
    depths = np.concatenate([sides, beyond[:, None]], axis=1)
    x, y = normals[..., 0], normals[..., 1]
    cov = covariances[:, None]
    variance = x * x * cov[..., 0, 0] + x * y * (cov[..., 0, 1] + cov[..., 1, 0]) + y * y * cov[..., 1, 1]
    deviation = np.sqrt(np.maximum(variance, 0.0))
    certain = deviation == 0.0
    probability = 0.5 * erfc(-depths / (np.sqrt(2.0) * np.where(certain, 1.0, deviation)))
    probability = np.where(certain, (depths > 0.0).astype(float), probability)
    greatest: Array = probability.max(axis=1)
    return greatest
