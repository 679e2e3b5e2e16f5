"""Lanes: strips of road between two lines, driven in one direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symaware_cli.geometry import Array, RegionShape, lengths

#: The overlap of the areas of a lane, so that there is no point between two of them that lies in neither [m].
_OVERLAP = 0.01
#: The margin of the areas beyond the boundaries of the lane, for the same reason, as lanes share boundaries [m].
_BESIDE = 0.001
#: Points nearer than this to the straight line between their neighbours are left out [m].
_STRAIGHT = 1e-4


@dataclass(frozen=True)
class Lane:
    """A lane.

    Attributes:
        name: The name of the lane.
        left: Points of the left boundary, in the direction of travel [m]; shape (k, 2).
        right: Points of the right boundary, each opposite to a point of the left one [m]; shape (k, 2).
        speed_limit: The speed limit [m/s]; infinite without one.
        successors: The names of the lanes that continue it. The first is the default.
        left_lane: The name of the lane to its left with the same direction; None if there is none.
        right_lane: The name of the lane to its right with the same direction; None if there is none.
    """

    name: str
    left: Array
    right: Array
    speed_limit: float = np.inf
    successors: tuple[str, ...] = ()
    left_lane: str | None = None
    right_lane: str | None = None

    @property
    def centre(self) -> Array:
        """The centre line [m]; shape (k, 2)."""
        return 0.5 * (self.left + self.right)

    @property
    def width(self) -> Array:
        """The width at each point of the centre line [m]; shape (k,)."""
        return lengths(self.left - self.right)

    def strip(self, reach: float) -> Lane:
        """Return the strip within a distance of the centre line, as a lane [m]."""
        centre = self.centre
        legs = lengths(np.diff(centre, axis=0))
        centre = centre[np.concatenate([[True], legs > 0.0])]
        left, right = lane_sides(centre, np.full(len(centre), 2.0 * reach))
        return replace(self, left=left, right=right)

    def areas(self) -> list[RegionShape]:
        """Return convex areas whose union is the lane; they overlap by a centimetre, and are a millimetre wider.

        If an area has four corners, the first two are on the right boundary, and the others on the left one.
        """
        areas = []
        for one, other in zip(range(len(self.left)), range(1, len(self.left)), strict=False):
            corners = np.array([self.right[one], self.right[other], self.left[other], self.left[one]])
            along = corners[[1, 1, 2, 2]] - corners[[0, 0, 3, 3]]
            length = lengths(along)
            ahead = along / np.where(length > 0.0, length, 1.0)[:, None]
            outwards = corners - corners[[3, 2, 1, 0]]
            outwards = outwards / lengths(outwards)[:, None]
            corners = corners + _OVERLAP * np.array([-1.0, 1.0, 1.0, -1.0])[:, None] * ahead + _BESIDE * outwards
            if _is_convex(corners):
                areas.append(_area(corners))
            else:
                areas += [_area(corners[each]) for each in _triangles(corners)]
        return areas


def _area(corners: Array) -> RegionShape:
    return RegionShape(polygon=tuple(tuple(corner) for corner in corners.tolist()))


def _turns(corners: Array) -> Array:
    """Return twice the signed areas of the triangles at the corners of a polygon [m^2]."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turns: Array = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return turns


def _is_convex(corners: Array) -> bool:
    return bool((_turns(corners) > 1e-9).all())


def _triangles(corners: Array) -> list[list[int]]:
    """Return the triangles of a quadrilateral that is not convex, without those of area 0."""
    for split in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]):
        if all(_turns(corners[each])[0] >= 0.0 for each in split):
            return [each for each in split if _turns(corners[each])[0] > 1e-9]
    return [each for each in ([0, 1, 2], [0, 2, 3]) if _turns(corners[each])[0] > 1e-9]


def lane_sides(centre: Array, width: Array) -> tuple[Array, Array]:
    """Return the left and the right boundary of a strip around a line; shape (k, 2) each.

    Args:
        centre: The line [m]; shape (k, 2).
        width: The width at each point [m]; shape (k,).
    """
    legs = np.diff(centre, axis=0)
    ahead = legs / lengths(legs)[:, None]
    before, after = np.concatenate([ahead[:1], ahead]), np.concatenate([ahead, ahead[-1:]])
    middle = before + after
    # The boundaries of both legs meet on the line that halves the angle between them. A very sharp bend is cut off.
    square = np.maximum((middle * middle).sum(axis=1), 0.5)
    normal = np.stack([-middle[:, 1], middle[:, 0]], axis=1) * (2.0 / square)[:, None]
    side = 0.5 * width[:, None] * normal
    return centre + side, centre - side


def simplified(left: Array, right: Array) -> tuple[Array, Array]:
    """Leave out points of two boundaries where both are straight; shape (k, 2) each in and out."""
    kept = [0]
    for place in range(1, len(left) - 1):
        if not all(_is_straight(side, kept[-1], place) for side in (left, right)):
            kept.append(place)
    kept.append(len(left) - 1)
    return left[kept], right[kept]


def _is_straight(side: Array, first: int, place: int) -> bool:
    """Whether the points of a line from the first to one after a place lie on the chord between these."""
    chord = side[place + 1] - side[first]
    length = np.sqrt((chord * chord).sum())
    if not length > 0.0:
        return False
    between = side[first + 1 : place + 1] - side[first]
    off = np.abs(between[:, 1] * chord[0] - between[:, 0] * chord[1]) / length
    return bool(off.max() <= _STRAIGHT)


def resampled(line: Array, shares: Array) -> Array:
    """Return points at shares of the length of a line; shape (k, 2)."""
    legs = lengths(np.diff(line, axis=0))
    along = np.concatenate([[0.0], np.cumsum(legs)])
    return np.stack([np.interp(shares * along[-1], along, line[:, axis]) for axis in (0, 1)], axis=1)


def shares_of(line: Array) -> Array:
    """Return the share of the length of a line at each of its points; shape (k,)."""
    along = np.concatenate([[0.0], np.cumsum(lengths(np.diff(line, axis=0)))])
    shares: Array = along / along[-1]
    return shares


def crossing(line: Array) -> int | None:
    """Return the number of a leg of a line that crosses an earlier one; None if it does not cross itself."""
    starts, legs = line[:-1], np.diff(line, axis=0)
    for number in range(2, len(legs)):
        apart = starts[: number - 1] - starts[number]
        one, other = legs[number], legs[: number - 1]
        det = one[0] * other[:, 1] - one[1] * other[:, 0]
        # Of parallel legs, the determinant is rounding, and places of a crossing would be arbitrary.
        parallel = np.abs(det) <= 1e-9 * np.hypot(*one) * lengths(other)
        safe = np.where(parallel, 1.0, det)
        share = (apart[:, 0] * other[:, 1] - apart[:, 1] * other[:, 0]) / safe
        there = (apart[:, 0] * one[1] - apart[:, 1] * one[0]) / safe
        hits = ~parallel & (share >= 0.0) & (share <= 1.0) & (there >= 0.0) & (there <= 1.0)
        # A line that ends where it began closes, and does not cross itself.
        if number == len(legs) - 1 and np.abs(line[0] - line[-1]).max() < 1e-6:
            hits[0] = False
        if hits.any():
            return number
    return None


def outline(parts: Sequence[RegionShape]) -> tuple[Array, Array]:
    """Return the ends of the edges of a lane's areas on its right and on its left; shape (m, 2, 2) each [m]."""
    quads = np.array([each.polygon for each in parts if each.polygon is not None and len(each.polygon) == 4])
    if not len(quads):
        return np.empty((0, 2, 2)), np.empty((0, 2, 2))
    return quads[:, [0, 1]], quads[:, [3, 2]]
