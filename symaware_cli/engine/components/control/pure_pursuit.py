"""Pure pursuit: cars follow a path by steering towards a lookahead point on it."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.engine.components.control.steering import Approach, differing
from symaware_cli.geometry import Array, Indices, Mask, lengths


class WaypointLines(NamedTuple):
    """The polyline of each agent with its lengths. Shorter lines are padded with legs of length zero.

    Attributes:
        waypoints: The waypoints, as returned by `AgentGroup.known_lists`; shape (n, k, 2).
        counts: Their numbers; shape (n,). 0 for an agent that waits.
        corners: The ends of legs, with the first again at the end of a loop; shape (n, m + 1, 2).
        directions: The unit vector of each leg; shape (n, m, 2).
        length: The length of each leg [m]; shape (n, m).
        starts: The distance along the line of each corner [m]; shape (n, m + 1).
        total: The length of the line [m]; shape (n,).
    """

    waypoints: Array
    counts: Indices
    corners: Array
    directions: Array
    length: Array
    starts: Array
    total: Array


def _lines(waypoints: Array, counts: Indices, loop: bool) -> WaypointLines:
    """Compute the lines of waypoints.

    Raises:
        ValueError: The waypoints are no lines in the plane.
    """
    if waypoints.shape == (len(counts), 0):
        waypoints = np.zeros((len(counts), 2, 2))
    if waypoints.ndim != 3 or (counts == 1).any() or waypoints.shape[2] != 2:
        raise ValueError("the knowledge `waypoints` of each agent must be a list of at least 2 positions of 2 numbers")
    number = np.arange(waypoints.shape[1] + loop)
    following = np.where(number < counts[:, None], number, 0 if loop else counts[:, None] - 1)
    corners = waypoints[np.arange(len(counts))[:, None], following]
    legs = np.diff(corners, axis=1)
    length = lengths(legs.reshape(-1, 2)).reshape(legs.shape[:2])
    if not length[number[:-1] < counts[:, None] - 1 + loop].all():
        raise ValueError("two successive `waypoints` are equal (a loop closes by itself)")
    directions = legs / np.where(length > 0.0, length, 1.0)[:, :, None]
    starts = np.concatenate([np.zeros((len(counts), 1)), np.cumsum(length, axis=1)], axis=1)
    return WaypointLines(waypoints, counts, corners, directions, length, starts, starts[:, -1].copy())


class PursuitDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control inputs to request; shape (n, 2).
        intent: The positions ahead; shape (n, h, 2).
        lines: The lines to follow.
        begins: Whether the line of each agent is new; shape (n,).
        travelled: The distance of each agent along its line, laps included [m]; shape (n,).
        remaining: The distance from the end of the line [m]; shape (n,).
    """

    control_input: Array
    intent: Array
    lines: WaypointLines
    begins: Mask
    travelled: Array
    remaining: Array


class PurePursuit(Approach):
    """Drives along the line through the positions ``waypoints``, steering towards a point ahead on it.

    The circle that is tangent to the heading at the rear axle and passes through that point has the curvature
    2 sin(a) / d, with the point at a distance d and an angle a off the heading (R. C. Coulter, Implementation of the
    Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, 1992); the steering angle is that of a car without slip on
    this circle. A longer lookahead cuts corners, a shorter one oscillates. If the point lies behind the car, it steers
    at its limit.

    An agent remembers its progress along the line and searches for its position only a little ahead of it, so a line
    may cross itself. It stops at the last waypoint, or starts the next lap. After a change of its waypoints it searches
    the whole new line. While the list is empty, as that of a planner without a path, it stands still.
    """

    batchable = True

    knowledge: ClassVar = {"waypoints": "where to pass, as a list of at least 2 positions [m]"}
    events: ClassVar = {
        "lap-completed": "An agent came round to its first waypoint; `number` counts the laps from 1.",
        "goal-reached": "An agent came within the tolerance of its last waypoint, for the first time.",
        "goal-changed": "An agent that had reached its last waypoint has other ones, which count as not reached.",
    }

    class Parameters(Approach.Parameters):
        """Lookahead and laps."""

        lookahead: float = Field(0.5, gt=0, description="Least distance of the point to steer for [m].")
        lookahead_time: float = Field(0.5, ge=0, description="Additional distance for each m/s of speed [s].")
        loop: bool = Field(False, description="Whether the last waypoint leads to the first.")

    def check(self, group: AgentGroup) -> None:
        """Check that the model is a car, and that successive waypoints are different positions in the plane."""
        names = [quantity.name for quantity in group.model.control_input]
        if names != ["speed", "steering_angle"] or not hasattr(group.model, "wheelbase"):
            raise ValueError("it steers cars, whose control input is a speed and a steering angle")
        _lines(*group.known_lists("waypoints"), self.parameters.loop)
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the line of each agent."""
        super().initialise_component(group)
        self._lines = _lines(*group.known_lists("waypoints"), self.parameters.loop)
        self._travelled = np.zeros(len(group))
        self._started = np.zeros(len(group), bool)
        self._finished = np.zeros(len(group), bool)
        self._rows = np.arange(len(group))

    def _present_lines(self) -> tuple[WaypointLines, Mask]:
        """Return the present lines, and which of them have changed since the previous turn."""
        waypoints, counts = self._group.known_lists("waypoints")
        before = self._lines
        if waypoints is before.waypoints:
            return before, np.zeros(len(counts), bool)
        changed = differing(before.waypoints, waypoints) | (counts != before.counts)
        return _lines(waypoints, counts, self.parameters.loop), changed

    def _compute(self) -> PursuitDecision:
        model, parameters, state = self._group.model, self.parameters, self._group.awareness.state
        lines, begins = self._present_lines()
        position = model.positions(state)
        rolling = lengths(model.velocity(state, self._group.control_input))
        ahead = parameters.lookahead + parameters.lookahead_time * rolling
        travelled = self._progress(lines, begins, position, ahead)
        target = self._at(lines, travelled + ahead)
        way = target - position
        distance = np.maximum(lengths(way), 1e-6)
        off = np.arctan2(way[:, 1], way[:, 0]) - state[:, model.heading]
        sine = np.sin(off)
        # A circle through a point behind would be as wide as its distance: the car turns at its limit instead.
        behind = np.cos(off) < 0.0
        curvature = 2.0 * sine / distance
        remaining = lengths(lines.corners[:, -1] - position)
        speed = np.full(len(state), parameters.speed)
        if not parameters.loop:
            ends = lines.total - travelled <= ahead
            # An agent past the end does not turn back.
            past = ends & (lines.total - travelled <= 1e-6)
            speed = np.where(past, 0.0, np.where(ends, self._slowing(remaining), speed))
        waiting = lines.counts == 0
        speed[waiting] = 0.0
        control_input = np.empty((len(state), 2))
        control_input[:, 0] = speed
        angle = np.arctan(model.wheelbase * curvature)  # type: ignore[attr-defined]
        control_input[:, 1] = np.where(behind, np.copysign(model.input_bounds()[1][1], sine), angle)
        intent = np.stack([self._at(lines, travelled + speed * later) for later in self._ahead], axis=1)
        if waiting.any():
            intent[waiting] = position[waiting, None]
        return PursuitDecision(control_input, intent, lines, begins, travelled, remaining)

    def _update(self, value: PursuitDecision) -> None:
        lines, travelled = value.lines, value.travelled
        self._steer(value.control_input, value.intent)
        for row in np.flatnonzero(value.begins & self._finished).tolist():
            self.emit_for(row, "goal-changed", "has other waypoints than those it passed")
        self._finished = self._finished & ~value.begins
        if self.parameters.loop:
            then, now = (np.where(each.counts > 0, each.total, 1.0) for each in (self._lines, lines))
            before = np.where(value.begins, 0.0, np.floor_divide(self._travelled, then))
            laps = np.floor_divide(travelled, now)
            for row in np.flatnonzero(laps > before).tolist():
                number = int(laps[row])
                self.emit_for(row, "lap-completed", f"completed lap {number}", number=number)
        else:
            near = (value.remaining <= self.parameters.tolerance) & (lines.total - travelled <= 1.0)
            arrived = near & ~self._finished & (lines.counts > 0)
            self._finished = self._finished | arrived
            for row in np.flatnonzero(arrived).tolist():
                self.emit_for(row, "goal-reached", "reached its last waypoint")
        self._lines, self._travelled = lines, travelled
        self._started = np.ones(len(travelled), bool)

    def _progress(self, lines: WaypointLines, begins: Mask, position: Array, ahead: Array) -> Array:
        """Return the distance of each agent along its line, laps included [m]; shape (n,)."""
        before, started = np.where(begins, 0.0, self._travelled), self._started & ~begins
        from_start = position[:, None, :] - lines.corners[:, :-1]
        along = from_start[..., 0] * lines.directions[..., 0] + from_start[..., 1] * lines.directions[..., 1]
        along = np.clip(along, 0.0, lines.length)
        nearest = lines.corners[:, :-1] + along[..., None] * lines.directions
        apart = position[:, None, :] - nearest
        distance = apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1]
        there = lines.starts[:, :-1] + along
        if self.parameters.loop:
            laps = np.floor_divide(before, np.where(lines.counts > 0, lines.total, 1.0))
            there = there + (laps * lines.total)[:, None]
            there = np.where(there < before[:, None] - 1e-9, there + lines.total[:, None], there)
        else:
            there = np.maximum(there, before[:, None])
        # Only positions a little ahead count, but at the start the whole line.
        far = there > (before + 2.0 * ahead)[:, None]
        distance = np.where(far & started[:, None], np.inf, distance)
        best = distance.argmin(axis=1)
        return np.where(np.isinf(distance[self._rows, best]), before, there[self._rows, best])

    def _at(self, lines: WaypointLines, travelled: Array) -> Array:
        """Return the points at given distances along the lines [m]; shape (n, 2)."""
        if self.parameters.loop:
            travelled = np.remainder(travelled, np.where(lines.counts > 0, lines.total, 1.0))
        travelled = np.minimum(travelled, lines.total)
        leg = np.minimum((lines.starts[:, 1:] < travelled[:, None]).sum(axis=1), lines.length.shape[1] - 1)
        rest = travelled - lines.starts[self._rows, leg]
        points: Array = lines.corners[self._rows, leg] + rest[:, None] * lines.directions[self._rows, leg]
        return points
