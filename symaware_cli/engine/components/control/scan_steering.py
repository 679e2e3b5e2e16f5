"""Base class of controllers that drive by a lidar: along waypoints or to a goal, past seen surfaces."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, ScenarioView
from symaware_cli.engine.components.control.steering import Approach, along, differing
from symaware_cli.engine.components.scan_surfaces import NearReturns, ScanOptions, ScanReturns, ScanSurfaces, check_scan
from symaware_cli.geometry import Array, DiscRadius, Indices, Mask, lengths


class PathLines(NamedTuple):
    """The lines that agents follow: one point, or several that are joined; padded by repeating the last.

    Attributes:
        corners: The points [m]; shape (n, k, 2).
        counts: Their numbers; shape (n,).
        starts: The distance along the line of each point [m]; shape (n, k).
    """

    corners: Array
    counts: Indices
    starts: Array


class ScanDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control inputs to request; shape (n, nu).
        intent: The positions ahead; shape (n, h, 2).
        returns: The scan that was used.
        lines: The lines to follow.
        begins: Whether the line of each agent is new; shape (n,).
        travelled: How far along its line each agent is [m]; shape (n,).
        reached: Whether each agent is at the end; shape (n,).
        memory: The memory of the controller; shape (n,).
    """

    control_input: Array
    intent: Array
    returns: ScanReturns
    lines: PathLines
    begins: Mask
    travelled: Array
    reached: Mask
    memory: Array


class ScanSteering(Approach):
    """A controller that drives by the returns of a lidar alone; it knows no obstacle and no other agent.

    It follows the line through the ``waypoints`` of its agents, if they know any, towards a point ahead on it, and else
    heads for the ``goal``. While the list of waypoints is empty, as that of a planner without a path, it waits.
    """

    knowledge: ClassVar = {"goal": "where to go, as a position [m]; `waypoints` lead there, if an agent knows any"}
    events: ClassVar = {
        "goal-reached": "An agent came within the tolerance of its goal or last waypoint, for the first time.",
        "goal-changed": "An agent that had reached its goal has another one, which counts as not reached.",
    }

    class Parameters(Approach.Parameters, ScanOptions):
        """The lidar, and the distances to keep."""

        scan: str = Field(description="The name of the lidar.")
        radius: DiscRadius = None
        margin: float = Field(0.1, ge=0, description="Distance to keep from what is seen [m].")
        range: float = Field(3.0, gt=0, description="What is seen farther away does not count [m].")
        lookahead: float = Field(1.0, gt=0, description="How far ahead on the line through waypoints to head [m].")

    def check(self, group: AgentGroup) -> None:
        """Check that agents move in the plane, to a place that they know."""
        if len(group.model.position) != 2:
            raise ValueError("it works in the plane, and the model moves in space")
        self._lines_of(group)
        super().check(group)

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that the scan exists."""
        check_scan(view, self.parameters.scan)

    def initialise_component(self, group: AgentGroup) -> None:
        """Start at the beginning of the line, without a scan."""
        super().initialise_component(group)
        given = self.parameters
        self._surfaces = ScanSurfaces(given.scan, given, (given.radius or group.entity.radius) + given.margin)
        self._lines = self._lines_of(group)
        self._travelled = np.zeros(len(group))
        self._finished = np.zeros(len(group), bool)
        #: What the controller remembers of its last decision, NaN at first; shape (n,).
        self._memory = np.full(len(group), np.nan)
        self._rows = np.arange(len(group))

    def _steer_by(self, target: Array, speed: Array, near: NearReturns) -> tuple[Array, Array, Array]:
        """Return the control inputs, the velocity of the intent (n, 2), and what to remember, shape (n,).

        Args:
            target: Where to head for [m]; shape (n, 2).
            speed: How fast at most [m/s]; shape (n,).
            near: The returns within the range.
        """
        raise NotImplementedError

    def _compute(self) -> ScanDecision:
        group = self._group
        position = group.model.positions(group.awareness.state)
        lines, before = self._lines_of(group), self._lines
        begins = differing(before.corners, lines.corners) | (before.counts != lines.counts)
        travelled = self._progress(lines, begins, position)
        # An agent without any waypoint, such as one without a path, waits where it is.
        waiting = lines.counts == 0
        target = np.where(waiting[:, None], position, self._at(lines, travelled + self.parameters.lookahead))
        remaining = np.where(waiting, 0.0, lengths(lines.corners[:, -1] - position))
        returns = self._surfaces.returns(group, self.now)
        near = self._surfaces.near(returns, position)
        # What lies beyond the target does not keep an agent from it.
        beyond = (
            near.distances
            > np.minimum(self.parameters.range, lengths(target - position) + self._surfaces.clearance)[:, None]
        )
        near = NearReturns(near.angles, np.where(beyond, np.inf, near.distances))
        reached = (
            (remaining <= self.parameters.tolerance)
            & ~waiting
            & (lines.starts[:, -1] - travelled <= self.parameters.lookahead)
        )
        control_input, velocity, memory = self._steer_by(target, self._slowing(remaining), near)
        intent = along(position, velocity, np.broadcast_to(self._ahead, (len(position), len(self._ahead))))
        return ScanDecision(control_input, intent, returns, lines, begins, travelled, reached, memory)

    def _update(self, value: ScanDecision) -> None:
        self._steer(value.control_input, value.intent)
        self._surfaces.remember(self._group, self.computed_at, value.returns)
        for row in np.flatnonzero(value.begins & self._finished).tolist():
            self.emit_for(row, "goal-changed", "has another goal than the one it reached")
        finished = self._finished & ~value.begins
        for row in np.flatnonzero(value.reached & ~finished).tolist():
            self.emit_for(row, "goal-reached", "reached its goal")
        self._finished = finished | value.reached
        self._lines, self._travelled, self._memory = value.lines, value.travelled, value.memory

    def _lines_of(self, group: AgentGroup) -> PathLines:
        """Return the present lines.

        Raises:
            ValueError: The goals or waypoints in the knowledge of the agents are not positions in the plane.
        """
        if all("waypoints" in known for known in group.knowledge):
            corners, counts = group.known_lists("waypoints")
            if corners.shape == (len(group), 0):
                corners = np.zeros((len(group), 1, 2))
            if corners.ndim != 3 or corners.shape[1] < 1 or corners.shape[2] != 2:
                raise ValueError("the knowledge `waypoints` of each agent must be a list of positions of 2 numbers")
        else:
            goal = group.known("goal")
            if goal.shape != (len(group), 2):
                raise ValueError("the knowledge `goal` of each agent must be a position of 2 numbers")
            corners, counts = goal[:, None, :], np.ones(len(group), np.intp)
        legs = np.diff(corners, axis=1)
        starts = np.zeros(corners.shape[:2])
        starts[:, 1:] = np.cumsum(np.sqrt((legs * legs).sum(axis=2)), axis=1)
        return PathLines(corners, counts, starts)

    def _progress(self, lines: PathLines, begins: Mask, position: Array) -> Array:
        """Return how far along its line each agent is: at the nearest point not far from where it was [m]."""
        before = np.where(begins, 0.0, self._travelled)
        if lines.corners.shape[1] == 1:
            return before
        starts, legs = lines.corners[:, :-1], np.diff(lines.corners, axis=1)
        length = np.diff(lines.starts, axis=1)
        square = np.where(length > 0.0, length * length, 1.0)
        share = np.clip(((position[:, None] - starts) * legs).sum(axis=2) / square, 0.0, 1.0)
        apart = position[:, None] - (starts + share[..., None] * legs)
        there = lines.starts[:, :-1] + share * length
        window = 3.0 * self.parameters.lookahead
        near = (there >= before[:, None] - 1e-9) & (there <= before[:, None] + window)
        distance = np.where(near, (apart * apart).sum(axis=2), np.inf)
        best = distance.argmin(axis=1)
        found = np.isfinite(distance[self._rows, best])
        return np.where(found, there[self._rows, best], before)

    def _at(self, lines: PathLines, travelled: Array) -> Array:
        """Return the points at distances along the lines [m]; the ends beyond them; shape (n, 2)."""
        last = lines.corners.shape[1] - 1
        if not last:
            return lines.corners[:, 0]
        travelled = np.minimum(travelled, lines.starts[:, -1])
        leg = np.minimum((lines.starts[:, 1:] < travelled[:, None]).sum(axis=1), last - 1)
        start, end = lines.starts[self._rows, leg], lines.starts[self._rows, leg + 1]
        share = (travelled - start) / np.where(end > start, end - start, 1.0)
        one, other = lines.corners[self._rows, leg], lines.corners[self._rows, leg + 1]
        points: Array = one + share[:, None] * (other - one)
        return points
