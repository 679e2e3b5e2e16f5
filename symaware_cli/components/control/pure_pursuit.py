"""Pure pursuit: cars that follow a path by steering for a point ahead on it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.components.control.steering import Approach, lengths
from symaware_cli.core import AgentGroup

Array = NDArray[np.float64]


class PurePursuit(Approach):
    """Drives along the line that joins the positions known as ``waypoints``, steering for a point ahead on it.

    The circle that touches the heading at the rear axle and goes through that point has the curvature 2 sin(a) / d,
    with the point at a distance d and an angle a off the heading (R. C. Coulter, Implementation of the Pure Pursuit
    Path Tracking Algorithm, CMU-RI-TR-92-01, 1992); the steering angle is the one that a car without slip takes it
    with. A longer look ahead cuts corners, a shorter one swings. Who has the point behind it steers as far as it can.

    An agent knows how far along the line it is and looks for itself only ahead of that, so a line may cross itself. It
    stops at the last waypoint, or goes round.
    """

    knowledge: ClassVar = {"waypoints": "where to pass, as a list of at least 2 positions [m], as many for each agent"}
    events: ClassVar = {
        "lap-completed": "An agent came round to its first waypoint; `number` counts the laps from 1.",
        "goal-reached": "An agent came within the tolerance of its last waypoint, for the first time.",
    }

    class Parameters(Approach.Parameters):
        """How to follow a path."""

        lookahead: float = Field(0.5, gt=0, description="Least distance of the point to steer for [m].")
        lookahead_time: float = Field(0.5, ge=0, description="What is added to that for each m/s of speed [s].")
        loop: bool = Field(False, description="Whether the last waypoint leads to the first.")

    def check(self, group: AgentGroup) -> None:
        """The model is a car in the plane, and waypoints are positions of which no two that follow are the same."""
        names = [quantity.name for quantity in group.model.control_input]
        if names != ["speed", "steering_angle"] or not hasattr(group.model, "wheelbase"):
            raise ValueError("it steers cars, whose control input is a speed and a steering angle")
        waypoints = group.known("waypoints")
        if waypoints.ndim != 3 or waypoints.shape[1] < 2 or waypoints.shape[2] != 2:
            raise ValueError(
                "the knowledge `waypoints` of each agent must be a list of at least 2 positions of 2 numbers"
            )
        if not self._legs(waypoints)[1].all():
            raise ValueError("two of the `waypoints` that follow each other are the same (a loop closes by itself)")
        super().check(group)

    def _legs(self, waypoints: Array) -> tuple[Array, Array]:
        """The corners of each line, closed if it is a loop, (n, k + 1, 2), and the lengths of its legs, (n, k)."""
        corners = np.concatenate([waypoints, waypoints[:, :1]], axis=1) if self.parameters.loop else waypoints
        legs = np.diff(corners, axis=1)
        return corners, lengths(legs.reshape(-1, 2)).reshape(legs.shape[:2])

    def initialise_component(self, group: AgentGroup) -> None:
        """Measure the line of each agent."""
        super().initialise_component(group)
        self._corners, length = self._legs(group.known("waypoints"))
        self._directions = np.diff(self._corners, axis=1) / length[:, :, None]
        self._length = length
        self._starts = np.concatenate([np.zeros((len(group), 1)), np.cumsum(length, axis=1)], axis=1)
        self._total = self._starts[:, -1].copy()
        self._travelled = np.zeros(len(group))
        self._started = np.zeros(len(group), bool)
        self._finished = np.zeros(len(group), bool)
        self._rows = np.arange(len(group))

    def _compute(self) -> tuple[Array, Array, Array, Array]:
        model, parameters, state = self._group.model, self.parameters, self._group.awareness.state
        position = model.positions(state)
        rolling = lengths(model.velocity(state, self._group.control_input))
        ahead = parameters.lookahead + parameters.lookahead_time * rolling
        travelled = self._progress(position, ahead)
        target = self._at(travelled + ahead)
        way = target - position
        distance = np.maximum(lengths(way), 1e-6)
        off = np.arctan2(way[:, 1], way[:, 0]) - state[:, model.heading]
        sine = np.sin(off)
        # A circle through a point behind would be as wide as that is far: who has to turn round does so at once.
        behind = np.cos(off) < 0.0
        curvature = 2.0 * sine / distance
        remaining = lengths(self._corners[:, -1] - position)
        speed = np.full(len(state), parameters.speed)
        if not parameters.loop:
            ends = self._total - travelled <= ahead
            # Who is past the end does not turn back.
            past = ends & (self._total - travelled <= 1e-6)
            speed = np.where(past, 0.0, np.where(ends, self._slowing(remaining), speed))
        control_input = np.empty((len(state), 2))
        control_input[:, 0] = speed
        angle = np.arctan(model.wheelbase * curvature)  # type: ignore[attr-defined]
        control_input[:, 1] = np.where(behind, np.copysign(model.input_bounds()[1][1], sine), angle)
        intent = np.stack([self._at(travelled + speed * later) for later in self._ahead], axis=1)
        return control_input, intent, travelled, remaining

    def _update(self, value: tuple[Array, Array, Array, Array]) -> None:
        control_input, intent, travelled, remaining = value
        self._steer(control_input, intent)
        if self.parameters.loop:
            laps = np.floor_divide(travelled, self._total)
            for row in np.flatnonzero(laps > np.floor_divide(self._travelled, self._total)).tolist():
                number = int(laps[row])
                self.emit_for(row, "lap-completed", f"completed lap {number}", number=number)
        else:
            arrived = (remaining <= self.parameters.tolerance) & (self._total - travelled <= 1.0) & ~self._finished
            self._finished |= arrived
            for row in np.flatnonzero(arrived).tolist():
                self.emit_for(row, "goal-reached", "reached its last waypoint")
        self._travelled = travelled

    def _progress(self, position: Array, ahead: Array) -> Array:
        """How far along its line each agent is, laps included [m]; shape (n,)."""
        from_start = position[:, None, :] - self._corners[:, :-1]
        along = from_start[..., 0] * self._directions[..., 0] + from_start[..., 1] * self._directions[..., 1]
        along = np.clip(along, 0.0, self._length)
        nearest = self._corners[:, :-1] + along[..., None] * self._directions
        apart = position[:, None, :] - nearest
        distance = apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1]
        there = self._starts[:, :-1] + along
        if self.parameters.loop:
            laps = np.floor_divide(self._travelled, self._total)
            there = there + (laps * self._total)[:, None]
            there = np.where(there < self._travelled[:, None] - 1e-9, there + self._total[:, None], there)
        else:
            there = np.maximum(there, self._travelled[:, None])
        # Only what lies a little ahead counts, but at the start all of the line.
        far = there > (self._travelled + 2.0 * ahead)[:, None]
        distance = np.where(far & self._started[:, None], np.inf, distance)
        best = distance.argmin(axis=1)
        found: Array = np.where(np.isinf(distance[self._rows, best]), self._travelled, there[self._rows, best])
        self._started[:] = True
        return found

    def _at(self, travelled: Array) -> Array:
        """The points that lie so far along the lines [m]; shape (n, 2)."""
        if self.parameters.loop:
            travelled = np.remainder(travelled, self._total)
        travelled = np.minimum(travelled, self._total)
        leg = np.minimum((self._starts[:, 1:] < travelled[:, None]).sum(axis=1), self._length.shape[1] - 1)
        rest = travelled - self._starts[self._rows, leg]
        points: Array = self._corners[self._rows, leg] + rest[:, None] * self._directions[self._rows, leg]
        return points
