"""Gaussian uncertainty: Kalman filters for the own state and for other agents."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, GroupComponent, Model, Observation, Parameters, Quantity, Tracks
from symaware_cli.engine.components.kalman import Belief, Tracker, corrected, predicted
from symaware_cli.geometry import Array
from symaware_cli.world import nanoseconds

NotNegative = Annotated[float, Field(ge=0)]


class OwnFilter:
    """The extended Kalman filter of the own states of a group; a shallow copy is independent.

    Attributes:
        time: The instant of the belief, in nanoseconds.
    """

    def __init__(self, model: Model, belief: Belief, now: int) -> None:
        """Start with a belief.

        Args:
            model: The model of the agents.
            belief: The belief of their states.
            now: The present time, in nanoseconds.
        """
        self.time = now
        self._model = model
        self._belief = belief
        self._turned_at = now
        #: The control inputs since the belief, each with the end of its time [ns].
        self._inputs: tuple[tuple[int, Array], ...] = ()

    def remember_input(self, now: int, applied: Array, step: int) -> None:
        """Store the control input applied since the last turn, for each step of the world [ns]."""
        ends = [*range(self._turned_at + step, now, step), now] if self._turned_at < now else []
        self._inputs += tuple((end, applied) for end in ends)
        self._turned_at = now

    def advance(self, time: int) -> None:
        """Predict the belief to an instant, unless it is as late already, and forget the inputs until then."""
        inputs = list(self._inputs)
        while inputs and self.time < time:
            end, control_input = inputs[0]
            until = min(end, time)
            self._belief = self._predicted(self._belief, control_input, until - self.time)
            self.time = until
            if until == end:
                del inputs[0]
        self._inputs = tuple(inputs)

    def correct(self, measured: Array, deviation: Array) -> None:
        """Correct the belief by a measurement of the states; arguments as in `corrected`."""
        self._belief = corrected(self._model, self._belief, measured, deviation)

    def at_present(self) -> Belief:
        """Return the belief predicted through all stored control inputs."""
        belief, time = self._belief, self.time
        for end, control_input in self._inputs:
            belief = self._predicted(belief, control_input, end - time)
            time = end
        return belief

    def _predicted(self, belief: Belief, control_input: Array, duration: int) -> Belief:
        return predicted(self._model, belief, control_input, duration / 1e9)


class Estimate(NamedTuple):
    """The result of a turn: the beliefs, and the filters after it.

    Attributes:
        belief: The belief of the own states.
        tracks: The tracks of others.
        own: The filter of the own states.
        tracker: The filters of others.
        observation: The last observation that was used.
        lag: The greatest delay of observations so far, in nanoseconds.
    """

    belief: Belief
    tracks: Tracks
    own: OwnFilter
    tracker: Tracker
    observation: Observation | None
    lag: int


class GaussianUncertainty(GroupComponent):
    """Estimates the own state and the states of others by Kalman filters, with the covariance of each estimate.

    The own state has an extended Kalman filter over the agent's model, its process noise, and the control input applied
    since the last turn. Each other agent that is or was in sight has a Kalman filter of constant velocity, disturbed by
    white noise of acceleration. Both are corrected by each new observation (`perception.range` states its accuracy); if
    that is delayed, the filter is corrected at the time of the observation and predicted to the present, through the
    control inputs in between.

    It updates the state (the estimate), the uncertainty (at this instant the covariance of the state, row by row) and
    the tracks, with covariances and ages. It belongs after a perception; without observations it predicts from the
    initial state.
    """

    batchable = True

    sees_world = True

    class Parameters(Parameters):
        """Assumptions about the initial state, and about others."""

        initial_deviation: NotNegative | tuple[NotNegative, ...] = Field(
            0.0,
            description="Standard deviation of the error of what each agent believes of its own state at the start, in "
            "its units: one number for all elements, or a list with one for each. The error is drawn accordingly.",
        )
        acceleration_noise: NotNegative = Field(
            0.5,
            description="Root of the power spectral density of the acceleration of others, along each axis "
            "[m/s^2/sqrt(Hz)]: left to itself for a time T [s], a velocity becomes uncertain by this times sqrt(T).",
        )
        memory: NotNegative = Field(5.0, description="For how long another who is out of sight is remembered [s].")
        max_deviation: float | None = Field(
            None,
            gt=0,
            description="Standard deviation of the position, along an axis, beyond which another is given up [m]; "
            "no limit if null.",
        )

    def check(self, group: AgentGroup) -> None:
        """Check that a list of deviations has one for each element of the state."""
        deviations, model = np.shape(self.parameters.initial_deviation), group.model
        if deviations not in ((), (len(model.state),)):
            names = ", ".join(quantity.name for quantity in model.state)
            raise ValueError(
                f"`initial_deviation` is a list of {deviations[0]}, and the state has {len(model.state)} elements: "
                f"{names}"
            )

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the uncertainty as the covariance of the state, row by row."""
        state = group.model.state
        covariance = [
            Quantity(f"cov_{one.name}_{other.name}", f"{one.unit}*{other.unit}") for one in state for other in state
        ]
        return {"uncertainty": covariance}

    def initialise_component(self, group: AgentGroup) -> None:
        """Start the filters with the initial belief."""
        super().initialise_component(group)
        parameters, environment = self.parameters, self.environment
        deviation = np.broadcast_to(np.asarray(parameters.initial_deviation, float), len(group.model.state))
        state = group.awareness.state.copy()
        if deviation.any():
            state = state + deviation * self.random.standard_normal(len(deviation))
        belief = Belief(state, np.tile(np.diag(np.square(deviation)), (len(group), 1, 1)))
        self._own = OwnFilter(group.model, belief, self.now)
        self._observation = group.awareness.observation
        self._lag = 0
        self._tracker = Tracker(
            len(group),
            len(environment.roster),
            environment.snapshot().positions.shape[1],
            parameters.acceleration_noise**2,
            nanoseconds(parameters.memory),
            math.inf if parameters.max_deviation is None else parameters.max_deviation,
        )

    def _compute(self) -> Estimate:
        now, observation, lag = self.now, self._group.awareness.observation, self._lag
        own, tracker = copy(self._own), copy(self._tracker)
        own.remember_input(now, self.environment.applied_input(self._group), self.environment.time_step)
        if observation is not None and not observation.repeats(self._observation):
            lag = max(lag, now - observation.time)
            if observation.time >= own.time and observation.state is not None:
                own.advance(observation.time)
                own.correct(observation.state, observation.state_deviation)
            if observation.time >= tracker.time:
                tracker.observe(observation)
        latest = now - lag
        # No observation to come is older than this.
        own.advance(latest)
        return Estimate(own.at_present(), tracker.tracks(now, latest), own, tracker, observation, lag)

    def _update(self, value: Estimate) -> None:
        self._own, self._tracker, self._observation, self._lag = value.own, value.tracker, value.observation, value.lag
        awareness = self._group.awareness
        awareness.state = value.belief.state
        covariance = value.belief.covariance.reshape(len(self._group), 1, -1)
        awareness.uncertainty.set(self.computed_at, covariance)
        if value.observation is not None or awareness.world is None:
            awareness.seen = value.tracks  # with perfect perception of others nothing is estimated
