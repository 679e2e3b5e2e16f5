"""Car following: vehicles that keep to their lanes, and keep a distance from others ahead.

Reasons: docs/decisions/0096-roads.md
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Environment, Tracks
from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.roads.driver_model import Driver, idm_acceleration
from symaware_cli.roads.lane_keeping import Driving, LaneKeeping, LanePosition
from symaware_cli.roads.road_network import LanePlaces


class Extents(NamedTuple):
    """The extents of bodies from their positions, by index in the roster [m]; shape (N,) each."""

    front: Array
    rear: Array
    half_width: Array


def extents_of(environment: Environment) -> Extents:
    """Return the extents of the bodies of all agents, which every agent knows."""
    front, rear, half_width = [], [], []
    for group in environment.groups:
        shape = group.entity.shape
        # A body without a shape is a point.
        points = [] if shape is None else [(x, y, r) for piece, r in shape.pieces for x, y in piece]
        front.append(np.full(len(group), max((x + r for x, _, r in points), default=0.0)))
        rear.append(np.full(len(group), max((r - x for x, _, r in points), default=0.0)))
        half_width.append(np.full(len(group), max((abs(y) + r for _, y, r in points), default=0.0)))
    return Extents(np.concatenate(front), np.concatenate(rear), np.concatenate(half_width))


class Others(NamedTuple):
    """The others that agents are aware of, and their positions in each lane.

    Attributes:
        observers: The agent that is aware of the other, as a row of the group; shape (m,).
        others: The other agent, as an index in the roster; shape (m,).
        velocities: The believed velocity of the other [m/s]; shape (m, 2).
        places: The lane coordinates of the distinct positions; shape (u, L) each.
        place: The position of each row, as a row of `places`; shape (m,).
    """

    observers: Indices
    others: Indices
    velocities: Array
    places: LanePlaces
    place: Indices


class LaneNeighbours(NamedTuple):
    """The nearest others ahead and behind in a lane; shape (n,) each.

    Attributes:
        gap: The distance from the own body to the one ahead [m]; infinite if there is none, negative if both are side
            by side.
        speed: The speed of the other ahead along the lane [m/s].
        gap_behind: The distance from the own body to the one behind [m].
        speed_behind: The speed of the other behind along the lane [m/s].
    """

    gap: Array
    speed: Array
    gap_behind: Array
    speed_behind: Array


class CarFollowing(LaneKeeping):
    """Keeps to its lane like `control.lane-keeping`, and keeps a distance from others ahead.

    The acceleration is that of the intelligent driver model (IDM; M. Treiber, A. Hennecke, D. Helbing, "Congested
    traffic states in empirical observations and microscopic simulations", Physical Review E 62, 2000) behind the
    nearest agent ahead that is in the way: one whose body overlaps laterally, now or within ``anticipation``, with the
    own body or with its place in the lane. Behind a car of constant speed v the gap becomes (``standstill`` + v
    ``headway``) / sqrt(1 - (v / desired speed)^4).

    An agent uses its beliefs about others, without regard to their uncertainty, and ignores others that it is not aware
    of. It considers the lanes along its route, and the positions of others rather than the lanes that they follow, so a
    merging agent counts once its body is in the way. Bodies of the world that are no agents, and right of way at
    crossings, are not considered.
    """

    sees_world = True

    class Parameters(LaneKeeping.Parameters):
        """Gaps, and the limits for others that are in the way."""

        standstill: float = Field(2.0, gt=0, le=1e4, description="The gap to a standing car ahead, s0 [m].")
        headway: float = Field(1.5, ge=0, le=1e3, description="The time gap to a car ahead, T [s].")
        reach: float = Field(150.0, gt=0, le=1e5, description="Distance up to which others are considered [m].")
        margin: float = Field(0.2, ge=0, le=100, description="Distance to keep from others at the sides [m].")
        anticipation: float = Field(
            1.0, ge=0, le=100, description="Time for which the lateral motion of others is extrapolated [s]."
        )

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the sizes of all agents, and the lanes within reach."""
        super().initialise_component(group)
        self._extents = extents_of(self.environment)
        self._reach = self._network.reach(self._following, self.parameters.reach)
        self._shape = self._own_extents(group)

    def _own_extents(self, group: AgentGroup) -> tuple[float, float, float]:
        """Return the extents of the own bodies ahead, behind and to the side [m]."""
        place = self.environment.roster.start(group.name)
        front, rear, half_width = (float(each[place]) for each in self._extents)
        return front, rear, half_width

    @staticmethod
    def _driver_of(given: Any) -> Driver:
        return Driver(given.standstill, given.headway, given.acceleration, given.braking, given.hardest)

    def _compute(self) -> Driving:
        here = self._position()
        ahead = self._neighbours(self._others(), here, here.lane)
        return self._driven(here, here.lane, self._accelerations(here, here.lane, ahead))

    def _accelerations(self, here: LanePosition, lane: Indices, ahead: LaneNeighbours) -> Array:
        """Return the acceleration of each agent behind the nearest other ahead in a lane [m/s^2]; shape (n,)."""
        behind = idm_acceleration(here.speed, self._desired_here(lane), ahead.gap, ahead.speed, self._driver)
        free = self._free_acceleration(here)
        return np.where(np.isinf(ahead.gap), free, behind)

    def _others(self) -> Others:
        """Return the others that agents are aware of."""
        tracks: Tracks = self._group.others(self.parameters.reach)
        positions = tracks.positions[:, :2]
        # Many agents believe in the same position of another agent: each distinct position is looked up in the lanes
        # once.
        keys = np.ascontiguousarray(positions).view(np.complex128)[:, 0]
        _, first, place = np.unique(keys, return_index=True, return_inverse=True)
        places = self._network.places(positions[first])
        return Others(tracks.observers, tracks.others, tracks.velocities[:, :2], places, place)

    def _neighbours(self, others: Others, here: LanePosition, lane: Indices) -> LaneNeighbours:
        """Return the nearest others ahead of and behind each agent in a lane."""
        network, rows, observers = self._network, self._rows, others.observers
        front, rear, half_width = self._shape
        # The lanes around that of each observer, (m, C), and the position of the other in these.
        reached = self._reach.lane[self._route_of, lane][observers]
        offset = self._reach.offset[self._route_of, lane][observers]
        place = others.place[:, None]
        along, across = others.places.along[place, reached], others.places.across[place, reached]
        segment = others.places.segment[place, reached]
        tangent = network.directions(segment)
        vx, vy = others.velocities[:, :1], others.velocities[:, 1:2]
        speed = vx * tangent[..., 0] + vy * tangent[..., 1]
        sideways = vy * tangent[..., 0] - vx * tangent[..., 1]
        wide = (half_width + self._extents.half_width[others.others] + self.parameters.margin)[:, None]
        own = here.places.across[rows, lane][observers, None]
        later = across + self.parameters.anticipation * sideways
        # Within `anticipation`, the other blocks the lane, or the own body beside its centre.
        low, high = np.minimum(across, later), np.maximum(across, later)
        in_lane = (low < wide) & (high > -wide)
        in_way = in_lane | ((low < own + wide) & (high > own - wide))
        covered = network.covers(reached, along) & np.isfinite(offset)
        apart = offset + along - here.places.along[rows, lane][observers, None]
        first = np.where(covered & in_way & (apart > 0.0), apart, np.inf)
        gap, led = self._least(first, others, front + self._extents.rear[others.others], speed, len(rows))
        last = np.where(covered & in_lane & (apart <= 0.0), -apart, np.inf)
        back, followed = self._least(last, others, rear + self._extents.front[others.others], speed, len(rows))
        return LaneNeighbours(gap, led, back, followed)

    @staticmethod
    def _least(distance: Array, others: Others, bodies: Array, speed: Array, count: int) -> tuple[Array, Array]:
        """Return the least gap of each agent, and the speed of that other along the lane; shape (count,) each.

        Args:
            distance: The distance of each other in each lane [m], infinite if it does not count; shape (m, C).
            others: The others.
            bodies: The part of the distance that the bodies take up [m]; shape (m,).
            speed: The speed of the other along each lane [m/s]; shape (m, C).
            count: The number of agents.
        """
        least, found = np.full(count, np.inf), np.zeros(count)
        if not distance.size:
            return least, found
        column = distance.argmin(axis=1)
        row = np.arange(len(column))
        gap = distance[row, column] - bodies
        np.minimum.at(least, others.observers, gap)
        is_least: Mask = (gap == least[others.observers]) & np.isfinite(gap)
        found[others.observers[is_least]] = speed[row, column][is_least]
        return least, found
