"""Places of the labels of regions: each within its own region, not in another one, and not on another label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: The number of places that are considered in each direction, besides the preferred one.
_PLACES = 33

#: The points of a label at which it is checked, relative to its centre and half its size.
_POINTS = np.array([[0, 0], *([x, y] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 1.0)), [-1, 0], [1, 0]])


class LabelledRegion(NamedTuple):
    """A region and its label.

    Attributes:
        outlines: The corners of its convex pieces, each (m, 2) counter-clockwise [m].
        size: The width and the height of the label (2,) [m]; zeros for a region without one.
        preferred: Where its centre should be, if that is possible (2,) [m].
    """

    outlines: Sequence[Array]
    size: Array
    preferred: Array


def label_places(regions: Sequence[LabelledRegion], low: Array, high: Array) -> list[Array | None]:
    """Find a place for the label of each region.

    A region that lies wholly in another one is labelled there; otherwise a label avoids other regions. If a label is
    larger than the space that is left, its centre at least is in its region.

    Args:
        regions: The regions.
        low: The corner of the visible area with the least coordinates (2,) [m].
        high: The opposite corner.

    Returns:
        The centre of each label (2,) [m]; None where there is no label, or nothing of the region is visible.
    """
    taken: list[tuple[Array, Array]] = []
    found: list[Array | None] = []
    for number, region in enumerate(regions):
        place = None
        if region.size.any():
            place = _place(region, [each for other, each in enumerate(regions) if other != number], taken, low, high)
        if place is not None:
            taken.append((place, region.size))
        found.append(place)
    return found


def _place(
    region: LabelledRegion,
    others: Sequence[LabelledRegion],
    taken: Sequence[tuple[Array, Array]],
    low: Array,
    high: Array,
) -> Array | None:
    """Return the best place for the label of a region, given those that are taken; None if there is none."""
    corners = np.concatenate(region.outlines)
    first, last = np.maximum(low, corners.min(axis=0)), np.minimum(high, corners.max(axis=0))
    grid = np.meshgrid(*(np.linspace(first[axis], last[axis], _PLACES) for axis in range(2)))
    places = np.concatenate([region.preferred[None], np.stack(grid, axis=-1).reshape(-1, 2)])
    visible = ((places >= low) & (places <= high)).all(axis=1)
    places = places[visible & _inside(places, region.outlines)]
    if not len(places):
        return None
    points = places[:, None] + _POINTS * (region.size / 2.0)
    on_labels = np.zeros(len(places))
    for centre, size in taken:
        on_labels += (np.abs(places - centre) < (region.size + size) / 2.0).all(axis=1)
    in_others = sum((_inside(points, other.outlines).sum(axis=1) for other in others), np.zeros(len(places)))
    kept = _inside(points, region.outlines) & ((points >= low) & (points <= high)).all(axis=2)
    away = np.linalg.norm(places - region.preferred, axis=1)
    best = np.lexsort((away, len(_POINTS) - kept.sum(axis=1), in_others, on_labels))[0]
    place: Array = places[best]
    return place


def _inside(points: Array, outlines: Sequence[Array]) -> NDArray[np.bool_]:
    """Return which of some points (..., 2) are in any of the convex pieces of a region, edges included."""
    found = np.zeros(points.shape[:-1], bool)
    for outline in outlines:
        edges = np.roll(outline, -1, axis=0) - outline
        apart = points[..., None, :] - outline
        found |= (edges[:, 0] * apart[..., 1] - edges[:, 1] * apart[..., 0] >= -1e-9).all(axis=-1)
    return found
