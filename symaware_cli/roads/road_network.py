"""The network of lanes: coordinates of points along lanes, and the lanes ahead and behind.

Reasons: docs/decisions/0096-roads.md
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from symaware_cli.geometry import Array, Indices, lengths
from symaware_cli.roads.lane import Lane

#: The length beyond its ends that still belongs to a lane, to bridge gaps at the joints of lanes [m].
_JOINT = 0.2
#: The greatest number of lanes ahead of and behind a lane that are considered.
_MOST_AHEAD = 64


class LanePlaces(NamedTuple):
    """The coordinates of points in each lane; shape (u, L) each.

    Attributes:
        along: The distance along the centre line [m]; negative before its start, more than its length after its end.
        across: The distance from the centre line, positive to the left [m].
        segment: The nearest segment of the centre line.
    """

    along: Array
    across: Array
    segment: Indices


class LaneReach(NamedTuple):
    """The lanes ahead of and behind each lane, for each route; shape (r, L, C) each.

    Attributes:
        lane: The indices of these lanes.
        offset: The distance from the start of the lane to that of the other [m]; NaN for padding.
    """

    lane: Indices
    offset: Array


class RoadNetwork:
    """The lanes of a scenario, as components find them in `group.sections["roads"]`.

    Attributes:
        lanes: The lanes.
        index: The index of each lane by its name.
        length: The length of the centre line of each lane [m]; shape (L,).
        limit: The speed limit of each lane [m/s]; shape (L,).
        width: The mean width of each lane [m]; shape (L,).
        left: The index of the lane to the left of each lane, with the same direction; -1 for none; shape (L,).
        right: The index of the lane to the right of each lane, likewise; shape (L,).
    """

    def __init__(self, lanes: Sequence[Lane]) -> None:
        self.lanes = tuple(lanes)
        self.index = {lane.name: number for number, lane in enumerate(lanes)}
        self.limit = np.array([lane.speed_limit for lane in lanes])
        self.width = np.array([lane.width.mean() for lane in lanes])
        self.left, self.right = (
            np.array([-1 if name is None else self.index[name] for name in names])
            for names in ([lane.left_lane for lane in lanes], [lane.right_lane for lane in lanes])
        )
        self._successors = [[self.index[name] for name in lane.successors] for lane in lanes]
        centres = [lane.centre for lane in lanes]
        legs = [np.diff(centre, axis=0) for centre in centres]
        counts = np.array([len(each) for each in legs])
        self._lane = np.repeat(np.arange(len(lanes)), counts)
        self._first = np.concatenate([[0], np.cumsum(counts)])
        self._start = np.concatenate([centre[:-1] for centre in centres])
        leg = np.concatenate(legs)
        self._leg_length = lengths(leg)
        self._ahead = leg / self._leg_length[:, None]
        total = np.concatenate([[0.0], np.cumsum(self._leg_length)])
        #: The cumulative distance if all lanes lay one after the other [m].
        self._global = total[:-1]
        self._base = self._global[self._first[:-1]]
        self._along = self._global - self._base[self._lane]
        self.length = total[self._first[1:]] - self._base
        self._is_first = np.zeros(len(leg), bool)
        self._is_last = np.zeros(len(leg), bool)
        self._is_first[self._first[:-1]] = self._is_last[self._first[1:] - 1] = True
        self._heading, self._bend = self._headings(centres)

    def __len__(self) -> int:
        return len(self.lanes)

    def _headings(self, centres: Sequence[Array]) -> tuple[Array, Array]:
        """Return the heading at the start of each segment [rad], and its change over the segment."""
        heading, bend = np.empty(len(self._ahead)), np.empty(len(self._ahead))
        before: dict[int, list[int]] = {}
        for number, following in enumerate(self._successors):
            for each in following:
                before.setdefault(each, []).append(number)
        for number in range(len(self.lanes)):
            own = slice(self._first[number], self._first[number + 1])
            angles = np.unwrap(np.arctan2(self._ahead[own, 1], self._ahead[own, 0]))
            at = np.concatenate([angles[:1], 0.5 * (angles[1:] + angles[:-1]), angles[-1:]])
            # If one lane continues another, both have the same heading at the joint.
            for end, others, place in (
                (0, before.get(number, [])[:1], -1),
                (-1, self._successors[number][:1], 0),
            ):
                for other in others:
                    joint = centres[other][place] - centres[number][end]
                    if np.abs(joint).max() > _JOINT:
                        continue
                    beside = self._ahead[self._first[other + 1] - 1 if place else self._first[other]]
                    own_ahead = self._ahead[own][end]
                    turn = np.arctan2(
                        own_ahead[0] * beside[1] - own_ahead[1] * beside[0],
                        own_ahead[0] * beside[0] + own_ahead[1] * beside[1],
                    )
                    at[end] += 0.5 * turn
            heading[own], bend[own] = at[:-1], np.diff(at)
        return heading, bend

    def places(self, points: Array) -> LanePlaces:
        """Return the coordinates of points (u, 2) [m] in each lane."""
        x, y = points[:, :1] - self._start[:, 0], points[:, 1:2] - self._start[:, 1]
        ahead_x, ahead_y = self._ahead[:, 0], self._ahead[:, 1]
        along = x * ahead_x + y * ahead_y
        across = y * ahead_x - x * ahead_y
        clamped = np.minimum(np.maximum(along, 0.0), self._leg_length)
        over = along - clamped
        square = across * across + over * over
        least = np.minimum.reduceat(square, self._first[:-1], axis=1)
        is_least = square == np.repeat(least, np.diff(self._first), axis=1)
        number = np.where(is_least, np.arange(square.shape[1], 0, -1), 0)
        segment = square.shape[1] - np.maximum.reduceat(number, self._first[:-1], axis=1)
        rows = np.arange(len(points))[:, None]
        over, across = over[rows, segment], across[rows, segment]
        beyond = (self._is_first[segment] & (over < 0.0)) | (self._is_last[segment] & (over > 0.0))
        across = np.where(beyond, across, np.copysign(np.sqrt(least), across))
        found = np.where(beyond, along[rows, segment], clamped[rows, segment])
        return LanePlaces(self._along[segment] + found, across, segment)

    def heading(self, segment: Indices, along: Array) -> Array:
        """Return the heading of centre lines at distances along lanes [rad]."""
        share = (along - self._along[segment]) / self._leg_length[segment]
        heading: Array = self._heading[segment] + np.minimum(np.maximum(share, 0.0), 1.0) * self._bend[segment]
        return heading

    def curvature(self, segment: Indices) -> Array:
        """Return the mean curvature of segments [1/m]."""
        curvature: Array = self._bend[segment] / self._leg_length[segment]
        return curvature

    def directions(self, segment: Indices) -> Array:
        """Return the unit vectors of segments; shape (..., 2)."""
        directions: Array = self._ahead[segment]
        return directions

    def at(self, lane: Indices, along: Array) -> tuple[Array, Array]:
        """Return points at distances along lanes [m], and the directions there; shape (..., 2) each.

        Beyond its ends a lane is straight.
        """
        key = self._base[lane] + np.minimum(np.maximum(along, 0.0), self.length[lane])
        segment = np.searchsorted(self._global, key, side="right") - 1
        segment = np.minimum(np.maximum(segment, self._first[:-1][lane]), self._first[1:][lane] - 1)
        ahead = self._ahead[segment]
        rest = along - self._along[segment]
        return self._start[segment] + rest[..., None] * ahead, ahead

    def following(self, routes: Sequence[frozenset[str]]) -> Indices:
        """Return the lane that follows each lane on each route, -1 for none; shape (r, L).

        This is the first successor that is on the route, or else the first successor.
        """
        following = np.full((len(routes), len(self)), -1)
        for row, route in enumerate(routes):
            for number, successors in enumerate(self._successors):
                named = [each for each in successors if self.lanes[each].name in route]
                if successors:
                    following[row, number] = (named or successors)[0]
        return following

    def reach(self, following: Indices, distance: float) -> LaneReach:
        """Return the lanes within a distance ahead of the end, or behind the start, of each lane [m]."""
        before: list[list[int]] = [[] for _ in self.lanes]
        for number, successors in enumerate(self._successors):
            for each in successors:
                before[each].append(number)
        found: list[list[list[tuple[int, float]]]] = []
        for route in following.tolist():
            of_route = []
            for number in range(len(self)):
                chain, offset, lane = [(number, 0.0)], float(self.length[number]), route[number]
                while lane >= 0 and offset <= self.length[number] + distance and len(chain) < _MOST_AHEAD:
                    chain.append((lane, offset))
                    offset += float(self.length[lane])
                    lane = route[lane]
                waiting, ahead = [(each, 0.0) for each in before[number]], len(chain)
                while waiting and len(chain) < ahead + _MOST_AHEAD:
                    lane, start = waiting.pop(0)
                    start -= float(self.length[lane])
                    chain.append((lane, start))
                    if -start <= distance:
                        waiting += [(each, start) for each in before[lane]]
                of_route.append(chain)
            found.append(of_route)
        width = max(len(chain) for of_route in found for chain in of_route)
        lane_of = np.zeros((len(found), len(self), width), np.intp)
        offset_of = np.full(lane_of.shape, np.nan)
        for row, of_route in enumerate(found):
            for number, chain in enumerate(of_route):
                lane_of[row, number, : len(chain)] = [lane for lane, _ in chain]
                offset_of[row, number, : len(chain)] = [offset for _, offset in chain]
        return LaneReach(lane_of, offset_of)

    def covers(self, lane: Indices, along: Array) -> Array:
        """Whether distances along lanes lie between their ends."""
        covered: Array = (along >= -_JOINT) & (along <= self.length[lane] + _JOINT)
        return covered


class UnreadRoads:
    """A stand-in for roads with problems, which are reported; agents on them are not reported as further problems."""


def derived_links(lanes: Sequence[Lane], tolerance: float) -> list[tuple[int, int]]:
    """Return the successors of each lane: lanes that begin at its end, in about the same direction.

    Args:
        lanes: The lanes.
        tolerance: The greatest distance between the ends of the centre lines [m].
    """
    ends = np.array([lane.centre[-1] for lane in lanes])
    starts = np.array([lane.centre[0] for lane in lanes])
    out = np.array([lane.centre[-1] - lane.centre[-2] for lane in lanes])
    into = np.array([lane.centre[1] - lane.centre[0] for lane in lanes])
    apart = starts[None] - ends[:, None]
    near = np.sqrt((apart * apart).sum(axis=2)) <= tolerance
    ahead = (out[:, None] * into[None]).sum(axis=2) > 0.0
    return [(one, other) for one, other in np.argwhere(near & ahead).tolist()]


def derived_neighbours(lanes: Sequence[Lane]) -> list[tuple[int, int]]:
    """Return the lanes to the left and to the right of each lane, with the same direction; -1 for none.

    A lane is beside another if its middle is near the boundary of the other: nearer than a third of its width.
    """
    network = RoadNetwork([replace(lane, successors=(), left_lane=None, right_lane=None) for lane in lanes])
    number = np.arange(len(lanes))
    middle, ahead = network.at(number, 0.5 * network.length)
    width = network.width
    places = network.places(middle)
    same = (network.directions(places.segment) * ahead[:, None]).sum(axis=2) > 0.9
    beside = same & network.covers(number, places.along) & (number != number[:, None])
    off = np.abs(np.abs(places.across) - 0.5 * (width + width[:, None]))
    off = np.where(beside & (off < width / 3.0), off, np.inf)
    found = []
    for sign in (-1.0, 1.0):
        # The lane on the left must have the middle of this one on its right.
        cost = np.where(places.across * sign > 0.0, off, np.inf)
        best = cost.argmin(axis=1)
        found.append(np.where(np.isinf(cost[number, best]), -1, best))
    return list(zip(found[0].tolist(), found[1].tolist(), strict=True))
