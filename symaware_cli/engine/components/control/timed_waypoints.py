"""A controller that is at each of its waypoints at the time that belongs to it."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.engine.components.control.steering import Steering, differing
from symaware_cli.geometry import Array, Indices, Mask, lengths
from symaware_cli.world import SECOND


class TimedDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control inputs to request; shape (n, nu).
        intent: The positions ahead; shape (n, h, d).
        timed: The times and positions of each agent; shape (n, k, 1 + d).
        counts: Their numbers; shape (n,).
        begins: Whether they are new; shape (n,).
        arrived: Whether an agent is at its last position, and its time has come; shape (n,).
    """

    control_input: Array
    intent: Array
    timed: Array
    counts: Indices
    begins: Mask
    arrived: Mask


class TimedWaypoints(Steering):
    """Follows the positions ``timed_waypoints`` in time: between two of them an agent is to move evenly.

    The desired velocity is the mean velocity of the schedule until the next turn, plus `gain` times the vector to where
    the agent is to be. So a model without inertia keeps to the schedule exactly if it begins on it. Before the first
    time an agent is to be at the first position, after the last at the last. While the list is empty it stays where it
    is. Planners of teams write such schedules (`planning.cbs`, `planning.prioritised`).
    """

    knowledge: ClassVar = {
        "timed_waypoints": "when to be where, as a list of [t, x, y]: simulated time [s], position [m]"
    }
    events: ClassVar = {
        "goal-reached": "An agent came within the tolerance of its last position, and the time of that has come.",
        "goal-changed": "An agent that had reached its last position has a new schedule, which counts as not reached.",
    }

    class Parameters(Steering.Parameters):
        """Gain and tolerance."""

        gain: float = Field(2.0, ge=0, description="Speed for each metre from the schedule [1/s].")
        tolerance: float = Field(0.1, gt=0, description="Distance at which the last position counts as reached [m].")

    def check(self, group: AgentGroup) -> None:
        """Check that times ascend, and that the model can follow a velocity."""
        self._known(group)
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Start with the first schedule."""
        super().initialise_component(group)
        self._timed, self._counts = self._known(group)
        self._rows = np.arange(len(group))
        self._finished = np.zeros(len(group), bool)
        self._span = (self.period or self.environment.time_step) / SECOND

    def _known(self, group: AgentGroup) -> tuple[Array, Indices]:
        """Return the present schedules, (n, k, 1 + d), and their lengths, (n,)."""
        timed, counts = group.known_lists("timed_waypoints")
        dimensions = len(group.model.position)
        if timed.shape == (len(group), 0):
            return np.zeros((len(group), 1, 1 + dimensions)), np.zeros(len(group), np.intp)
        if timed.ndim != 3 or timed.shape[2] != 1 + dimensions:
            raise ValueError(
                "the knowledge `timed_waypoints` of each agent must be a list of times with positions of "
                f"{dimensions} numbers"
            )
        later = np.diff(timed[:, :, 0], axis=1) > 0.0
        if not later[np.arange(1, timed.shape[1]) < counts[:, None]].all():
            raise ValueError("the times in the knowledge `timed_waypoints` must ascend")
        return timed, counts

    def _compute(self) -> TimedDecision:
        model, state, now = self._group.model, self._group.awareness.state, self.time
        timed, counts = self._known(self._group)
        begins = differing(self._timed, timed) | (counts != self._counts)
        position, waiting = model.positions(state), counts == 0
        here = self._at(timed, now)
        velocity = (self._at(timed, now + self._span) - here) / self._span + self.parameters.gain * (here - position)
        velocity[waiting] = 0.0
        intent = np.stack([self._at(timed, now + later) for later in self._ahead.tolist()], axis=1)
        intent[waiting] = position[waiting, None]
        last = timed[:, -1]
        arrived = (now >= last[:, 0] - 1e-9) & (lengths(last[:, 1:] - position) <= self.parameters.tolerance) & ~waiting
        # A planner that found no plan says so by the cost, and its schedule ends where the agent stops.
        arrived &= np.array([known.get("path_cost", 0.0) != -1.0 for known in self._group.knowledge])
        return TimedDecision(model.follow_velocity(state, velocity), intent, timed, counts, begins, arrived)

    def _update(self, value: TimedDecision) -> None:
        self._steer(value.control_input, value.intent)
        self._timed, self._counts = value.timed, value.counts
        for row in np.flatnonzero(value.begins & self._finished).tolist():
            self.emit_for(row, "goal-changed", "has another schedule than the one it followed")
        self._finished = self._finished & ~value.begins
        for row in np.flatnonzero(value.arrived & ~self._finished).tolist():
            self.emit_for(row, "goal-reached", "reached its last position")
        self._finished = self._finished | value.arrived

    def _at(self, timed: Array, time: float) -> Array:
        """Return where each agent is to be at a time [s]; shape (n, d)."""
        times = timed[:, :, 0]
        leg = np.clip((times <= time).sum(axis=1) - 1, 0, max(timed.shape[1] - 2, 0))
        following = np.minimum(leg + 1, timed.shape[1] - 1)
        start, end = timed[self._rows, leg], timed[self._rows, following]
        span = end[:, 0] - start[:, 0]
        share = np.clip((time - start[:, 0]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)
        places: Array = start[:, 1:] + share[:, None] * (end[:, 1:] - start[:, 1:])
        return places
