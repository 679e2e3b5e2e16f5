"""Whether a box in the plane lies within a region, and whether they overlap."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Region, RegionShape

Array = NDArray[np.float64]

#: Tolerance of comparisons of coordinates [m], so that boxes that were computed and share a side do not overlap.
_TOLERANCE = 1e-9


def lies_within(box: Array, region: RegionShape, regions: Mapping[str, Region]) -> bool:
    """Whether all of a box surely lies in a region.

    Args:
        box: Least and greatest coordinate for each axis [m]; shape (2, 2).
        region: The region.
        regions: All regions by name.

    Returns:
        Exact for boxes, circles and polygons. Of a union, one member has to contain the box.
    """
    members = [regions[each] if isinstance(each, str) else each for each in region.members]
    if region.complement is not None:
        return not overlaps(box, members[0], regions)
    if members:
        every = [lies_within(box, each, regions) for each in members]
        return any(every) if region.union is not None else all(every)
    if region.dimensions > 2:
        return False
    return bool((region.depth(_corners(box)) >= -_TOLERANCE).all())  # a convex region contains what its corners do


def overlaps(box: Array, region: RegionShape, regions: Mapping[str, Region]) -> bool:
    """Whether a box and a region may share more than a boundary; see `lies_within`.

    Returns:
        Exact for boxes, circles and polygons. Of an intersection, true if the box overlaps every member.
    """
    members = [regions[each] if isinstance(each, str) else each for each in region.members]
    if region.complement is not None:
        return not lies_within(box, members[0], regions)
    if members:
        every = [overlaps(box, each, regions) for each in members]
        return any(every) if region.union is not None else all(every)
    if region.circle is not None:
        centre = np.array(region.circle.centre[:2])
        apart = centre - np.clip(centre, box[:, 0], box[:, 1])
        return bool(np.sqrt(apart @ apart) < region.circle.radius - _TOLERANCE)
    if region.box is not None:
        bounds = np.array(region.box).reshape(-1, 2)[:2]
        polygon = _corners(bounds) if len(bounds) > 1 else _corners(np.array([bounds[0], box[1]]))
    else:
        polygon = np.array(region.polygon)
    # Convex sets overlap unless an axis across a side of one of them separates them.
    sides = np.roll(polygon, -1, axis=0) - polygon
    axes = np.concatenate([np.eye(2), np.stack([-sides[:, 1], sides[:, 0]], axis=1)])
    for axis in axes / np.sqrt((axes * axes).sum(axis=1))[:, None]:
        one, other = _corners(box) @ axis, polygon @ axis
        if one.max() <= other.min() + _TOLERANCE or other.max() <= one.min() + _TOLERANCE:
            return False
    return True


def _corners(box: Array) -> Array:
    """Return the corners of a box, counter-clockwise; shape (4, 2)."""
    (left, right), (bottom, top) = box
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
