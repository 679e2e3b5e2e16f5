"""Camera orientation in the world."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def line_of_sight(position: ArrayLike, target: ArrayLike) -> Array:
    """Return the axes of a level camera that looks from one point to another.

    Args:
        position: (3,) [m].
        target: (3,) [m].

    Returns:
        Its axes to the right, upwards and ahead, of length 1; (3, 3).
    """
    ahead = np.asarray(target, float) - np.asarray(position, float)
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    # For a camera that looks straight up or down, the upward direction is arbitrary.
    upwards = np.array([1.0, 0.0, 0.0]) if abs(ahead[2]) > 1 - 1e-9 else np.array([0.0, 0.0, 1.0])
    aside = np.cross(ahead, upwards)
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(aside, ahead), ahead])
