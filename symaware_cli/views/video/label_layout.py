"""Places of labels beside bodies: they cover no body and no other label, and change as little as possible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: The places of a label around a body, by preference: directions from the centre of the body.
_DIRECTIONS: Array = np.array([(0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1)], float)


def labels_beside(
    centres: Array, extents: Array, labelled: Sequence[int], sizes: Array, before: NDArray[np.intp] | None = None
) -> tuple[Array, NDArray[np.intp]]:
    """Choose the places of labels at k instants; the choice for each label holds for all of them.

    Labels are placed one after the other, each at the first place around its body where it covers no body and no
    earlier label at any of the instants. A label without such a place is left out.

    Args:
        centres: (k, n, 2) the centres of the bodies; NaN for absent bodies.
        extents: (n,) half the width of each body.
        labelled: (m,) the bodies that have labels.
        sizes: (m, 2) width and height of the labels.
        before: (m,) the places chosen before, which are preferred; -1 for none.

    Returns:
        The centres of the labels (k, m, 2), NaN where there is no place; and the numbers of the places (m,), or -1.
    """
    count = len(labelled)
    found, chosen = np.full((len(centres), count, 2), np.nan), np.full(count, -1, np.intp)
    for number, body in enumerate(labelled):
        order = list(range(len(_DIRECTIONS)))
        if before is not None and before[number] >= 0:
            order.remove(int(before[number]))
            order.insert(0, int(before[number]))
        for place in order:
            offset = _DIRECTIONS[place] * (extents[body] + 0.55 * sizes[number])
            middle = centres[:, body] + offset
            if _is_free(middle, sizes[number], centres, extents, found[:, :number], sizes[:number]):
                found[:, number], chosen[number] = middle, place
                break
    return found, chosen


def _is_free(middle: Array, size: Array, centres: Array, extents: Array, labels: Array, sizes: Array) -> bool:
    """Return whether a label (k, 2) of a size (2,) covers no body and no label at any instant."""
    half = 0.5 * size
    apart = np.maximum(np.abs(centres - middle[:, None]) - half, 0.0)
    if (np.hypot(apart[..., 0], apart[..., 1]) < 0.95 * extents).any():
        return False
    return not bool((np.abs(labels - middle[:, None]) < 0.5 * (sizes + size)).all(axis=2).any())
