"""Controllers of several places, one after the other."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.components.control.steering import Approach, directions, lengths
from symaware_cli.core import AgentGroup

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class Waypoints(Approach):
    """Passes the positions known as ``waypoints`` in their order, then stops at the last or begins again.

    An agent heads straight for the next waypoint at cruise speed and turns to the one after it as soon as it is within
    the tolerance; before the last one its speed falls in proportion to the distance. The intent is the way ahead, along
    the waypoints, over the horizon.
    """

    knowledge: ClassVar = {"waypoints": "where to pass, as a list of positions [m], as many for each agent"}
    events: ClassVar = {
        "waypoint-reached": "An agent came within the tolerance of its next waypoint; `number` counts them from 0.",
        "goal-reached": "An agent came within the tolerance of its last waypoint, for the first time.",
    }

    class Parameters(Approach.Parameters):
        """How to pass waypoints."""

        loop: bool = Field(False, description="Whether to begin again after the last waypoint.")

    def check(self, group: AgentGroup) -> None:
        """Waypoints are positions, and the model can be steered by a velocity."""
        dimensions = len(group.model.position)
        shape = group.known("waypoints").shape
        if len(shape) != 3 or shape[1] < 1 or shape[2] != dimensions:
            raise ValueError(
                f"the knowledge `waypoints` of each agent must be a list of positions of {dimensions} numbers"
            )
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Read each agent's waypoints from its knowledge."""
        super().initialise_component(group)
        self._waypoints = group.known("waypoints")
        self._rows = np.arange(len(group))
        self._next: Indices = np.zeros(len(group), np.intp)
        self._finished = np.zeros(len(group), bool)

    def _compute(self) -> tuple[Array, Array, NDArray[np.bool_], Indices]:
        model, state = self._group.model, self._group.awareness.state
        position = model.positions(state)
        reached = lengths(self._waypoints[self._rows, self._next] - position) <= self.parameters.tolerance
        upcoming = self._after(self._next, reached)
        way = self._waypoints[self._rows, upcoming] - position
        distance = lengths(way)
        speed = np.full(len(distance), self.parameters.speed)
        if not self.parameters.loop:
            ends = upcoming == self._waypoints.shape[1] - 1
            speed[ends] = self._slowing(distance[ends])
        velocity = directions(way, distance) * speed[:, None]
        intent = self._way_ahead(position, upcoming, speed)
        return model.follow_velocity(state, velocity), intent, reached, upcoming

    def _update(self, value: tuple[Array, Array, NDArray[np.bool_], Indices]) -> None:
        control_input, intent, reached, upcoming = value
        self._steer(control_input, intent)
        last = self._waypoints.shape[1] - 1
        for row in np.flatnonzero(reached & ~self._finished).tolist():
            number = int(self._next[row])
            self.emit_for(row, "waypoint-reached", f"reached its waypoint {number}", number=number)
            if number == last and not self.parameters.loop:
                self._finished[row] = True
                self.emit_for(row, "goal-reached", "reached its last waypoint")
        self._next = upcoming

    def _after(self, number: Indices, step: NDArray[np.bool_] | int) -> Indices:
        """The waypoint that follows, which after the last is the first of a loop, else the last."""
        count = self._waypoints.shape[1]
        following = number + step
        limited: Indices = following % count if self.parameters.loop else np.minimum(following, count - 1)
        return limited

    def _way_ahead(self, position: Array, upcoming: Indices, speed: Array) -> Array:
        """Where each agent is at the instants of the intent if it keeps its speed; shape (n, h, d)."""
        count = self._waypoints.shape[1]
        # A loop is closed by the waypoint it begins with.
        numbers = self._after(upcoming[:, None], np.arange(count + self.parameters.loop))
        corners = np.concatenate([position[:, None], self._waypoints[self._rows[:, None], numbers]], axis=1)
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
