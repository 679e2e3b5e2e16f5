"""Places of labels beside bodies: they cover no body and no other label, and change as little as possible."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: The places of a label around a body, by preference: directions from the centre of the body.
_DIRECTIONS: Array = np.array([(0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1)], float)


class PlacedLabels(NamedTuple):
    """Labels with places.

    Attributes:
        middles: (k, m, 2) their centres at k instants; NaN for a label that is left out.
        sizes: (m, 2) width and height.
    """

    middles: Array
    sizes: Array


def labels_beside(
    centres: Array,
    extents: Array,
    labelled: Sequence[int],
    sizes: Array,
    before: NDArray[np.intp] | None = None,
    others: PlacedLabels | None = None,
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
        others: Labels that have places already, and are not covered either.

    Returns:
        The centres of the labels (k, m, 2), NaN where there is no place; and the numbers of the places (m,), or -1.
    """
    offsets = [_DIRECTIONS * (extents[body] + 0.55 * size) for body, size in zip(labelled, sizes, strict=True)]
    candidates = [
        centres[:, body] + offset[:, None] for body, offset in zip(labelled, offsets, strict=True)
    ]  # of each label (c, k, 2)
    return _chosen(candidates, sizes, centres, extents, before, others)


def labels_among(
    candidates: Sequence[Array], sizes: Array, centres: Array, extents: Array, before: NDArray[np.intp] | None = None
) -> tuple[Array, NDArray[np.intp]]:
    """Choose each label's place among some that are given, as `labels_beside` does.

    Args:
        candidates: For each of m labels its possible centres (c, k, 2), by preference.
        sizes: (m, 2) width and height of the labels.
        centres: See `labels_beside`.
        extents: See `labels_beside`.
        before: See `labels_beside`.

    Returns:
        See `labels_beside`.
    """
    return _chosen(candidates, sizes, centres, extents, before, None)


def _chosen(
    candidates: Sequence[Array],
    sizes: Array,
    centres: Array,
    extents: Array,
    before: NDArray[np.intp] | None,
    others: PlacedLabels | None,
) -> tuple[Array, NDArray[np.intp]]:
    """Choose the first free one of the candidates (c, k, 2) of each label."""
    count, instants = len(candidates), len(centres)
    others = others or PlacedLabels(np.empty((instants, 0, 2)), np.empty((0, 2)))
    first = len(others.sizes)
    everywhere = np.concatenate([others.middles, np.full((instants, count, 2), np.nan)], axis=1)
    extent = np.concatenate([others.sizes, np.reshape(sizes, (-1, 2))])
    chosen = np.full(count, -1, np.intp)
    for number, places in enumerate(candidates):
        order = list(range(len(places)))
        if before is not None and before[number] >= 0:
            order.remove(int(before[number]))
            order.insert(0, int(before[number]))
        taken = first + number
        for place in order:
            if _is_free(places[place], sizes[number], centres, extents, everywhere[:, :taken], extent[:taken]):
                everywhere[:, taken], chosen[number] = places[place], place
                break
    return everywhere[:, first:], chosen


def _is_free(middle: Array, size: Array, centres: Array, extents: Array, labels: Array, sizes: Array) -> bool:
    """Return whether a label (k, 2) of a size (2,) covers no body and no label at any instant."""
    half = 0.5 * size
    apart = np.maximum(np.abs(centres - middle[:, None]) - half, 0.0)
    if (np.hypot(apart[..., 0], apart[..., 1]) < 0.95 * extents).any():
        return False
    return not bool((np.abs(labels - middle[:, None]) < 0.5 * (sizes + size)).all(axis=2).any())
