"""The controller of robots that have bodies: it moves them along a plan of positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli import AgentGroup, Component, Parameters, Quantity, Signal, nanoseconds

Array = NDArray[np.float64]


class TrackingDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control input to request; shape (nu,).
        error: The distance from the plan [m]; None without a plan.
    """

    control_input: Array
    error: float | None


class IntentTracking(Component):
    """Moves a robot along its own intent, on straight lines from one planned position to the next.

    The requested velocity is that along the path, plus `gain` times the vector to the point on the path where the robot
    should be. The feedback is proportional, so a model with a heading, such as a differential drive, leaves the path
    where it turns, and catches up. Put it after `warehouse.plan`. Without an intent the robot stands still.
    """

    signals = (Signal("tracking", columns=[Quantity("error", "m")], description="how far the robot is from its plan"),)

    class Parameters(Parameters):
        """The feedback."""

        gain: float = Field(2.0, gt=0, description="Velocity for each metre from the plan [1/s].")
        max_speed: float = Field(8.0, gt=0, description="Greatest requested speed [m/s].")
        lead: float = Field(
            0.0, ge=0, description="Time ahead on the path at which the velocity is taken [s], as turning takes time."
        )

    def check(self, group: AgentGroup) -> None:
        """Check that the model can follow a velocity in the plane."""
        model = group.model
        if len(model.position) != 2:
            raise ValueError("plans are for robots that move in a plane")
        model.follow_velocity(np.zeros((1, len(model.state))), np.zeros((1, 2)))

    def _compute(self) -> TrackingDecision:
        agent, limits = self._agent, self.parameters
        state, intent, model = agent.self_state, agent.self_awareness.intent, agent.group.model
        velocity, error = np.zeros(2), None
        if len(intent.times):
            position = state[list(model.position)]
            wanted = _at(intent.times, intent.values, self.now)
            later = self.now + nanoseconds(limits.lead)
            way = _at(intent.times, intent.values, later + 1_000_000) - _at(intent.times, intent.values, later)
            velocity = 1e3 * way + limits.gain * (wanted - position)
            speed, error = float(np.hypot(*velocity)), float(np.hypot(*(wanted - position)))
            velocity *= min(1.0, limits.max_speed / max(speed, 1e-9))
        return TrackingDecision(model.follow_velocity(state[None], velocity[None])[0], error)

    def _update(self, value: TrackingDecision) -> None:
        self._agent.model.control_input = value.control_input
        if value.error is not None:
            self.record(self.signals[0], np.array([value.error]))


def _at(times: NDArray[np.int64], values: Array, now: int) -> Array:
    """Return the position on the path at an instant [ns]; beyond its ends, that at the end."""
    since = (times - times[0]) / 1e9
    at = (now - int(times[0])) / 1e9
    return np.array([np.interp(at, since, column) for column in values.T])
