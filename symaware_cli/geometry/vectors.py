"""Types of arrays, and row-wise operations on vectors.

The operations work element by element, so that no bit of a row depends on the other rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


def lengths(vectors: Array) -> Array:
    """Return the Euclidean lengths of vectors; (n, d) to (n,)."""
    total = vectors[:, 0] * vectors[:, 0]
    for axis in range(1, vectors.shape[1]):
        total += vectors[:, axis] * vectors[:, axis]
    return np.asarray(np.sqrt(total))
