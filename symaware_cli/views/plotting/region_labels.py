"""Places of the labels of regions: each within its region, outside of other regions, and clear of other labels."""

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
        preferred: The preferred centre of the label (2,) [m].
    """

    outlines: Sequence[Array]
    size: Array
    preferred: Array


def label_places(
    regions: Sequence[LabelledRegion], low: Array, high: Array, avoided: Array | None = None
) -> list[Array | None]:
    """Find a place for the label of each region.

    A region within another one is labelled inside both; otherwise a label avoids other regions. If a label is larger
    than the available space, at least its centre is in its region.

    Args:
        regions: The regions.
        low: The corner of the visible area with the least coordinates (2,) [m].
        high: The opposite corner.
        avoided: Points that labels should not cover, such as bodies (m, 2) [m]; None for none.

    Returns:
        The centre of each label (2,) [m]; None if there is no label, or no part of the region is visible.
    """
    taken: list[tuple[Array, Array]] = []
    found: list[Array | None] = []
    for number, region in enumerate(regions):
        place = None
        if region.size.any():
            others = [each for other, each in enumerate(regions) if other != number]
            place = _place(region, others, taken, low, high, np.empty((0, 2)) if avoided is None else avoided)
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
    avoided: Array,
) -> Array | None:
    """Return the best place for the label of a region, given the places that are taken; None if there is none."""
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
    # At the distance of a label from a point, its body or goal stays visible as well.
    apart = np.abs(places[:, None] - avoided)
    covered = (apart < region.size * np.array([1.1, 2.0])).all(axis=2).sum(axis=1)
    in_others = sum((_inside(points, other.outlines).sum(axis=1) for other in others), np.zeros(len(places)))
    kept = _inside(points, region.outlines) & ((points >= low) & (points <= high)).all(axis=2)
    away = np.linalg.norm(places - region.preferred, axis=1)
    best = np.lexsort((away, len(_POINTS) - kept.sum(axis=1), covered, in_others, on_labels))[0]
    place: Array = places[best]
    return place


def _inside(points: Array, outlines: Sequence[Array]) -> NDArray[np.bool_]:
    """Return whether each of some points (..., 2) is in a convex piece of a region, edges included."""
    found = np.zeros(points.shape[:-1], bool)
    for outline in outlines:
        edges = np.roll(outline, -1, axis=0) - outline
        apart = points[..., None, :] - outline
        found |= (edges[:, 0] * apart[..., 1] - edges[:, 1] * apart[..., 0] >= -1e-9).all(axis=-1)
    return found
