"""A controller that passes waypoints in order."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.engine.components.control.steering import Approach, differing, directions
from symaware_cli.geometry import Array, Indices, Mask, lengths


class WaypointDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control inputs to request; shape (n, nu).
        intent: The positions ahead; shape (n, h, d).
        waypoints: The waypoints of each agent; shape (n, k, d).
        counts: Their numbers; shape (n,).
        begins: Whether an agent starts at the first waypoint because they are new; shape (n,).
        number: The waypoint that each agent was heading for; shape (n,).
        reached: Whether it reached that one; shape (n,).
        upcoming: The waypoint that each agent is heading for now; shape (n,).
    """

    control_input: Array
    intent: Array
    waypoints: Array
    counts: Indices
    begins: Mask
    number: Indices
    reached: Mask
    upcoming: Indices


class Waypoints(Approach):
    """Passes the positions ``waypoints`` in order, then stops at the last or starts again.

    An agent heads straight for the next waypoint at cruise speed and turns to the one after it as soon as it is within
    the tolerance; before the last one its speed decreases in proportion to the distance. The intent is the path ahead,
    along the waypoints, over the horizon. After a change of its waypoints an agent starts at the first new one. While
    the list is empty, as that of a planner without a path, it stays where it is.
    """

    batchable = True

    knowledge: ClassVar = {"waypoints": "where to pass, as a list of positions [m]"}
    events: ClassVar = {
        "waypoint-reached": "An agent came within the tolerance of its next waypoint; `number` counts them from 0.",
        "goal-reached": "An agent came within the tolerance of its last waypoint, for the first time.",
        "goal-changed": "An agent that had reached its last waypoint has other ones, which count as not reached.",
    }

    class Parameters(Approach.Parameters):
        """Parameters of the approach, and whether to repeat."""

        loop: bool = Field(False, description="Whether to begin again after the last waypoint.")

    def check(self, group: AgentGroup) -> None:
        """Check that waypoints are positions, and that the model can follow a velocity."""
        self._known(group)
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Start at the first waypoints."""
        super().initialise_component(group)
        self._waypoints, self._counts = self._known(group)
        self._rows = np.arange(len(group))
        self._next: Indices = np.zeros(len(group), np.intp)
        self._finished = np.zeros(len(group), bool)

    def _known(self, group: AgentGroup) -> tuple[Array, Indices]:
        """Return the present waypoints of each agent, (n, k, d), and their numbers, (n,)."""
        waypoints, counts = group.known_lists("waypoints")
        dimensions = len(group.model.position)
        if waypoints.shape == (len(group), 0):
            return np.zeros((len(group), 1, dimensions)), np.zeros(len(group), np.intp)
        if waypoints.ndim != 3 or waypoints.shape[1] < 1 or waypoints.shape[2] != dimensions:
            raise ValueError(
                f"the knowledge `waypoints` of each agent must be a list of positions of {dimensions} numbers"
            )
        return waypoints, counts

    def _compute(self) -> WaypointDecision:
        model, state = self._group.model, self._group.awareness.state
        known, counts = self._known(self._group)
        begins = differing(self._waypoints, known) | (counts != self._counts)
        number = np.where(begins, 0, self._next)
        position = model.positions(state)
        waiting = counts == 0
        waypoints = np.where(waiting[:, None, None], position[:, None], known) if waiting.any() else known
        reached = lengths(waypoints[self._rows, number] - position) <= self.parameters.tolerance
        reached &= ~waiting
        upcoming = self._after(number, reached, counts)
        way = waypoints[self._rows, upcoming] - position
        distance = lengths(way)
        speed = np.full(len(distance), self.parameters.speed)
        if not self.parameters.loop:
            ends = upcoming >= counts - 1
            speed[ends] = self._slowing(distance[ends])
        velocity = directions(way, distance) * speed[:, None]
        intent = self._path_ahead(waypoints, counts, position, upcoming, speed)
        control_input = model.follow_velocity(state, velocity)
        return WaypointDecision(control_input, intent, known, counts, begins, number, reached, upcoming)

    def _update(self, value: WaypointDecision) -> None:
        self._steer(value.control_input, value.intent)
        self._waypoints, self._counts = value.waypoints, value.counts
        for row in np.flatnonzero(value.begins & self._finished).tolist():
            self.emit_for(row, "goal-changed", "has other waypoints than those it passed")
        self._finished = self._finished & ~value.begins
        for row in np.flatnonzero(value.reached & ~self._finished).tolist():
            number = int(value.number[row])
            self.emit_for(row, "waypoint-reached", f"reached its waypoint {number}", number=number)
            if number == value.counts[row] - 1 and not self.parameters.loop:
                self._finished[row] = True
                self.emit_for(row, "goal-reached", "reached its last waypoint")
        self._next = value.upcoming

    def _after(self, number: Indices, step: Mask | Indices, counts: Indices) -> Indices:
        """Return the next waypoint; after the last one the first of a loop, else the last."""
        following, counts = number + step, np.maximum(counts, 1)
        return following % counts if self.parameters.loop else np.minimum(following, counts - 1)

    def _path_ahead(self, waypoints: Array, counts: Indices, position: Array, upcoming: Indices, speed: Array) -> Array:
        """Return each agent's positions at the instants of the intent if it keeps its speed; shape (n, h, d)."""
        # A loop ends at its first waypoint.
        steps = np.minimum(np.arange(waypoints.shape[1] + self.parameters.loop), counts[:, None])
        numbers = self._after(upcoming[:, None], steps, counts[:, None])
        corners = np.concatenate([position[:, None], waypoints[self._rows[:, None], numbers]], axis=1)
        legs = np.diff(corners, axis=1)
        length = lengths(legs.reshape(-1, legs.shape[2])).reshape(legs.shape[:2])
        passed = np.concatenate([np.zeros((len(length), 1)), np.cumsum(length, axis=1)], axis=1)
        way = speed[:, None] * self._ahead
        if self.parameters.loop:
            first, around = passed[:, 1:2], passed[:, -1:] - passed[:, 1:2]
            beyond = np.remainder(way - first, np.where(around > 0.0, around, 1.0))
            way = np.where(way > passed[:, -1:], first + beyond, way)
        way = np.minimum(way, passed[:, -1:])
        leg = np.minimum((passed[:, None, 1:] < way[:, :, None]).sum(axis=2), length.shape[1] - 1)
        rows = self._rows[:, None]
        part = (way - passed[rows, leg]) / np.maximum(length[rows, leg], 1e-12)
        places: Array = corners[rows, leg] + legs[rows, leg] * part[:, :, None]
        return places
