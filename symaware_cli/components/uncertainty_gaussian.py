"""Uncertainty as Gaussian beliefs: of oneself by the model, of others by what one sees of them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.components.kalman import Belief, corrected, predicted
from symaware_cli.components.tracker import Tracker
from symaware_cli.core import AgentGroup, GroupComponent, Parameters, Quantity, Tracks
from symaware_cli.core.time import nanoseconds

Array = NDArray[np.float64]
NotNegative = Annotated[float, Field(ge=0)]


class GaussianUncertainty(GroupComponent):
    """Estimates the own state and those of others by Kalman filters, with the covariance of each estimate.

    Of oneself: an extended Kalman filter over the agent's own model, its process noise, and the control input that was
    applied since the last turn. Of each other that is or was in sight: a Kalman filter for a body that goes straight
    on, but for white noise of acceleration. Both are corrected whenever perception has seen something
    (`perception.range` says how exactly it measures); if that is late, the filter is corrected then and predicted to
    now, through the control inputs in between.

    It updates the state (the estimate), the uncertainty (at this instant the covariance of the state, row by row) and
    the tracks, with covariances and ages. Put it after a perception. Without an observation to correct it, it reckons
    on from the initial state.
    """

    sees_world = True

    class Parameters(Parameters):
        """What is assumed of oneself at the start, and of others."""

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
        """A list of deviations has one for each element of the state."""
        deviations, model = np.shape(self.parameters.initial_deviation), group.model
        if deviations not in ((), (len(model.state),)):
            names = ", ".join(quantity.name for quantity in model.state)
            raise ValueError(
                f"`initial_deviation` is a list of {deviations[0]}, and the state has {len(model.state)} elements: "
                f"{names}"
            )

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """The uncertainty is the covariance of the state, row by row."""
        state = group.model.state
        covariance = [
            Quantity(f"cov_{one.name}_{other.name}", f"{one.unit}*{other.unit}") for one in state for other in state
        ]
        return {"uncertainty": covariance}

    def initialise_component(self, group: AgentGroup) -> None:
        """Begin with what is believed at the start."""
        super().initialise_component(group)
        parameters, environment = self.parameters, self.environment
        deviation = np.broadcast_to(np.asarray(parameters.initial_deviation, float), len(group.model.state))
        state = group.awareness.state.copy()
        if deviation.any():
            state = state + deviation * self.random.standard_normal(len(deviation))
        self._belief = Belief(state, np.tile(np.diag(np.square(deviation)), (len(group), 1, 1)))
        #: The instant of that belief, and the control inputs since then, each with the end of its time.
        self._believed_at = self._turned_at = self.now
        self._inputs: deque[tuple[int, Array]] = deque()
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

    def _compute(self) -> tuple[Belief, Tracks]:
        now, observation = self.now, self._group.awareness.observation
        self._remember_input(now)
        if observation is not None and observation is not self._observation:
            self._observation = observation
            self._lag = max(self._lag, now - observation.time)
            if observation.time >= self._believed_at and observation.state is not None:
                self._advance(observation.time)
                self._belief = corrected(
                    self._group.model, self._belief, observation.state, observation.state_deviation
                )
            if observation.time >= self._tracker.time:
                self._tracker.observe(observation)
        latest = now - self._lag
        # Nothing that is still to come is older than this.
        self._advance(latest)
        return self._at_present(), self._tracker.tracks(now, latest)

    def _update(self, value: tuple[Belief, Tracks]) -> None:
        belief, tracks = value
        awareness = self._group.awareness
        awareness.state = belief.state
        awareness.uncertainty.set(self.now, belief.covariance.reshape(len(self._group), 1, -1))
        if self._observation is not None or awareness.world is None:
            awareness.seen = tracks  # who sees everybody without error has nothing to estimate of others

    def _remember_input(self, now: int) -> None:
        """Note the control input that was applied since the last turn, in steps such as the world makes."""
        applied, step = self.environment.applied_input(self._group), self.environment.time_step
        while self._turned_at < now:
            self._turned_at = min(self._turned_at + step, now)
            self._inputs.append((self._turned_at, applied))

    def _advance(self, time: int) -> None:
        """Carry the belief forward to an instant, unless it is there already, and forget the inputs until then."""
        while self._inputs and self._believed_at < time:
            end, control_input = self._inputs[0]
            until = min(end, time)
            self._belief = self._predicted(self._belief, control_input, until - self._believed_at)
            self._believed_at = until
            if until == end:
                self._inputs.popleft()

    def _at_present(self) -> Belief:
        """The belief carried forward through all control inputs."""
        belief, time = self._belief, self._believed_at
        for end, control_input in self._inputs:
            belief = self._predicted(belief, control_input, end - time)
            time = end
        return belief

    def _predicted(self, belief: Belief, control_input: Array, duration: int) -> Belief:
        return predicted(self._group.model, belief, control_input, duration / 1e9)
