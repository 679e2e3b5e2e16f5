"""Types of arrays, and row-wise operations on vectors.

The operations work element by element, so that no bit of a row depends on the other rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry.compiled_functions import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


@compiled
def lengths(vectors: Array) -> Array:
    """Return the Euclidean lengths of vectors; (n, d) to (n,)."""
    squares = vectors * vectors
    total = squares[:, 0]
    for axis in range(1, vectors.shape[1]):
        total = total + squares[:, axis]
    lengths: Array = np.sqrt(total)
    return lengths


def relative(points: Array, origin: Array, heading: float | Array | None) -> Array:
    """Return the coordinates of points in the frame of an agent.

    Args:
        points: Points in the world; shape (n, d).
        origin: The agent's position; shape (k,), or (n, k) with one for each point. Missing coordinates are 0.
        heading: The direction of the frame's x axis [rad], or one for each point; None if the frame does not turn.
    """
    moved = points.copy()
    shared = min(points.shape[1], origin.shape[-1])
    moved[:, :shared] -= origin[..., :shared]
    if heading is None:
        return moved
    cosine, sine = np.cos(heading), np.sin(heading)
    turned = moved.copy()
    turned[:, 0] = cosine * moved[:, 0] + sine * moved[:, 1]
    turned[:, 1] = cosine * moved[:, 1] - sine * moved[:, 0]
    return turned
