"""Surfaces that a lidar sees: the returns of its last scan, where an agent believes them to be.

Reasons: docs/decisions/0087-sensing.md
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Parameters, Scan, ScenarioView
from symaware_cli.geometry import Array, Mask, Nearby

#: Obstacles are kept away by so many standard deviations more.
_DEVIATIONS = 3.0

#: For how many turns poses are remembered, to bound memory.
_MOST_POSES = 1000

#: Of the surface within this angle only the nearest point counts [rad].
_WINDOW = 0.35

#: Returns so near to the believed outline of another agent are that agent [m].
_SAME = 0.1


class ScanOptions(Parameters):
    """How obstacles are taken from a lidar."""

    unseen: Literal["free", "occupied"] = Field(
        "free",
        description="What counts where the lidar saw nothing at all: outside of its field of view, where rays were "
        "missed, and before the first scan. Occupied: the agent does not move in these directions.",
    )
    deviation: float = Field(
        0.0, ge=0, le=1e6, description="Standard deviation of distances to what is seen; 3 of it are kept as well [m]."
    )


class BelievedPose(NamedTuple):
    """Believed poses of the agents of a group.

    Attributes:
        position: Their positions [m]; shape (n, 2).
        heading: Their headings [rad]; 0 for models without one; shape (n,).
    """

    position: Array
    heading: Array


class ScanReturns(NamedTuple):
    """The returns of a scan, in the world as agents believe it. The rays go all the way around.

    Attributes:
        time: The instant of the scan [ns]; -1 if there is none yet.
        points: Where rays ended [m]; NaN if they did not; shape (n, k, 2).
        angles: The directions of the rays [rad]; shape (n, k).
        unseen: Whether nothing is known in the direction of the ray; shape (n, k).
        origins: Where the rays began [m]; shape (n, 2).
        range: How far the lidar sees [m].
    """

    time: int
    points: Array
    angles: Array
    unseen: Mask
    origins: Array
    range: float


class NearReturns(NamedTuple):
    """The returns of a scan as seen from where the agents are now.

    Attributes:
        angles: Their directions [rad]; shape (n, k).
        distances: Their distances [m], infinite without a return; shape (n, k).
    """

    angles: Array
    distances: Array


class SurfaceChains(NamedTuple):
    """The points of surfaces around agents, in the order of their directions, all the way around.

    Attributes:
        points: The points [m]; NaN where there is none; shape (n, k, 2).
        joined: Whether a surface goes on from each to the one after it; shape (n, k).
    """

    points: Array
    joined: Mask


class ScanSurfaces:
    """The surfaces around the agents of a group, as far as they know them by one of their lidars.

    Rays are taken to begin at the position that an agent believed to have when they were measured, and to be seen from
    the heading that it believed to have. Between two scans surfaces stay where they were seen.

    Returns between which a body does not fit are joined to a chain of straight surfaces. Each is a chain of points with
    a covariance along the ray; it is taken to be nearer by three standard deviations.
    """

    def __init__(self, scan: str, options: ScanOptions, clearance: float) -> None:
        """Start without a scan.

        Args:
            scan: The name of the lidar.
            options: How obstacles are taken from it.
            clearance: The distance that the middle of the body has to keep from surfaces [m].
        """
        self.scan = scan
        self.clearance = clearance
        self._is_occupied = options.unseen == "occupied"
        self._nearer = _DEVIATIONS * options.deviation
        #: The believed poses at past turns, by instant [ns].
        self._poses: dict[int, BelievedPose] = {}
        self._returns: ScanReturns | None = None

    def returns(self, group: AgentGroup, now: int) -> ScanReturns:
        """Return the last scan that is known; called in a turn, without changing anything."""
        scan = group.awareness.readings.get(self.scan)
        if not isinstance(scan, Scan):
            count = max(4, math.ceil(2 * math.pi / _WINDOW))
            angles = np.broadcast_to(2 * np.pi * np.arange(count) / count, (len(group), count))
            nothing, unseen = np.full((*angles.shape, 2), np.nan), np.ones(angles.shape, bool)
            return ScanReturns(-1, nothing, angles, unseen, believed_pose(group).position, 0.0)
        if self._returns is not None and self._returns.time == scan.time:
            return self._returns
        earlier = [instant for instant in self._poses if instant <= scan.time]
        pose = believed_pose(group) if scan.time >= now or not earlier else self._poses[max(earlier)]
        return _placed(scan, pose)

    def remember(self, group: AgentGroup, now: int, returns: ScanReturns) -> None:
        """Store the results of a turn, and the believed poses at its instant [ns]."""
        if returns.time >= 0:
            self._returns = returns
        self._poses[now] = believed_pose(group)
        for instant in [each for each in self._poses if each < returns.time] or list(self._poses)[:-_MOST_POSES]:
            del self._poses[instant]

    def near(self, returns: ScanReturns, position: Array) -> NearReturns:
        """Return the returns as seen from positions (n, 2) [m]; what counts as occupied is as near as it may be."""
        way = returns.points - position[:, None]
        distance = np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2)
        angles = np.arctan2(way[..., 1], way[..., 0])
        none = np.isnan(distance)
        distance = np.where(none, np.inf, np.maximum(distance - self._nearer, 0.0))
        if self._is_occupied:
            angles = np.where(returns.unseen, returns.angles, angles)
            distance = np.where(returns.unseen, self.clearance, distance)
        return NearReturns(np.where(np.isfinite(distance), angles, 0.0), distance)

    def nearest(self, group: AgentGroup, returns: ScanReturns, position: Array, reach: float, radii: Array) -> Nearby:
        """Return the nearest points of surfaces within reach, as `Scenery.nearest` does for known obstacles.

        Of a surface that goes on, only the points count that are the nearest within about 20 degrees to either side.
        Returns of other agents that an agent is aware of are left out.

        Args:
            group: The agents.
            returns: What `returns` returned.
            position: The positions from which distances are measured [m]; shape (n, 2).
            reach: The greatest distance [m].
            radii: The radii of all agents, as returned by `bounding_radii`.
        """
        points, joined = self.chains(group, returns, position, radii)
        following = np.roll(points, -1, axis=1)
        nearest = _on_lines(points, np.where(joined[..., None], following, points), position[:, None])
        way = nearest - position[:, None]
        distance = np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2)
        chosen = (distance <= reach + self._nearer) & _is_least(distance, joined)
        row, ray = np.nonzero(chosen)
        far = distance[row, ray]
        kept = np.maximum(far - self._nearer, np.minimum(far, 1e-6))
        point = position[row] + way[row, ray] * (kept / np.where(far > 0.0, far, 1.0))[:, None]
        return Nearby(row, np.zeros(len(row), np.intp), point, kept, np.zeros((len(row), 2)))

    def chains(self, group: AgentGroup, returns: ScanReturns, position: Array, radii: Array) -> SurfaceChains:
        """Return the points of surfaces, and which of them are joined; the arguments are those of `nearest`."""
        points = np.where(self.of_others(group, returns.points, radii)[..., None], np.nan, returns.points)
        if self._is_occupied:
            towards = np.stack([np.cos(returns.angles), np.sin(returns.angles)], axis=2)
            edge = position[:, None] + (self.clearance + self._nearer) * towards
            points = np.where(returns.unseen[..., None], edge, points)
        following = np.roll(points, -1, axis=1)
        # NaN compares as false: rays without a return join nothing.
        return SurfaceChains(points, ((following - points) ** 2).sum(axis=2) <= (2.0 * self.clearance) ** 2)

    @property
    def uncertainty(self) -> float:
        """The distance by which surfaces are taken to be nearer than they are seen [m]."""
        return self._nearer

    def of_others(self, group: AgentGroup, points: Array, radii: Array) -> Mask:
        """Return which returns are of agents that the agent is aware of; shape (n, k)."""
        theirs = np.zeros(points.shape[:2], bool)
        tracks = group.others(1e6)
        if len(tracks.others):
            apart = points[tracks.observers] - tracks.positions[:, None, :2]
            near = (apart**2).sum(axis=2) <= (radii.take(tracks.others) + _SAME + self._nearer)[:, None] ** 2
            np.logical_or.at(theirs, tracks.observers, near)
        return theirs


def believed_pose(group: AgentGroup) -> BelievedPose:
    """Return the poses that the agents of a group believe to have."""
    model, state = group.model, group.awareness.state
    heading = np.zeros(len(group)) if model.heading is None else state[:, model.heading].copy()
    return BelievedPose(model.positions(state)[:, :2].copy(), heading)


def check_scan(view: ScenarioView, scan: str | None) -> None:
    """Report a scan that no component of the agents makes."""
    if scan is None:
        return
    lidar = next((each for each in view.own_entries if each.name == scan), None)
    if lidar is None:
        names = [each.name for each in view.own_entries if each.use == "perception.lidar"]
        view.report_unknown("component", scan, "with", "scan", known=names)
        return
    where = getattr(lidar.components[0].parameters, "position", (0.0, 0.0))
    if any(where[:2]):
        said = f"`{scan}` does not sit at the position of its agent, where its rays are taken to begin"
        view.report(said, "with", "position", section=lidar.section)


def _placed(scan: Scan, pose: BelievedPose) -> ScanReturns:
    """Return the returns of a scan from poses, with rays in the directions that the lidar does not look at."""
    angles, distances = scan.angles, scan.distances
    step = angles[1] - angles[0] if len(angles) > 1 else _WINDOW
    more = math.floor((2 * math.pi - (angles[-1] - angles[0])) / step + 1e-9) - 1
    if more > 0:
        angles = np.concatenate([angles, angles[-1] + step * np.arange(1, more + 1)])
        distances = np.concatenate([distances, np.full((len(distances), more), np.nan)], axis=1)
    facing = pose.heading[:, None] + angles
    finite = np.isfinite(distances)
    reached = np.where(finite, distances, np.nan)
    points = np.stack(
        [
            pose.position[:, 0, None] + reached * np.cos(facing),
            pose.position[:, 1, None] + reached * np.sin(facing),
        ],
        axis=2,
    )
    return ScanReturns(scan.time, points, facing, np.isnan(distances), pose.position, scan.range)


def _on_lines(starts: Array, ends: Array, points: Array) -> Array:
    """Return the points of straight lines that are nearest to points."""
    along = ends - starts
    square = (along * along).sum(axis=2)
    share = ((points - starts) * along).sum(axis=2) / np.where(square > 0.0, square, 1.0)
    nearest: Array = starts + np.clip(share, 0.0, 1.0)[..., None] * along
    return nearest


def _is_least(distance: Array, joined: Mask) -> Mask:
    """Return which lines of a chain are nearer than those around them; shape (n, k)."""
    count = distance.shape[1]
    least = np.ones(distance.shape, bool)
    ahead, behind = np.ones(distance.shape, bool), np.ones(distance.shape, bool)
    for offset in range(1, min(count - 1, max(1, round(_WINDOW * count / (2 * math.pi)))) + 1):
        ahead &= np.roll(joined, 1 - offset, axis=1)
        behind &= np.roll(joined, offset, axis=1)
        least &= ~ahead | (distance <= np.roll(distance, -offset, axis=1))
        least &= ~behind | (distance < np.roll(distance, offset, axis=1))
    return least
