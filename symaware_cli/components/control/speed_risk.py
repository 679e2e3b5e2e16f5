"""The risk of violating specifications at several speeds, for `control.risk-aware`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.risk.body_pairs import state_covariance
from symaware_cli.components.risk.invariants import ExpectedMotion, InvariantWindows
from symaware_cli.components.risk.state_conditions import Tail, propagated
from symaware_cli.core import AgentGroup
from symaware_cli.specification.predicted_scope import PredictedAgentScope
from symaware_cli.world.integration import integrate
from symaware_cli.world.time import SECOND, nanoseconds

Array = NDArray[np.float64]

#: The parts of the requested speed that are compared.
FACTORS: Array = np.linspace(0.0, 1.0, 21)


class RiskOfSpeeds(NamedTuple):
    """The risk at each of the `FACTORS`.

    Attributes:
        risks: Bounds of the probabilities that each invariant does not hold at each instant of the horizon; shape
            (invariants, instants, n, factors).
        share: The part of the remaining risk that the horizon may have; shape (n,).
    """

    risks: Array
    share: Array

    @property
    def total(self) -> Array:
        """Bounds of the risk over the horizon; shape (n, factors)."""
        total: Array = self.risks.sum(axis=(0, 1))
        return np.minimum(total, 1.0)

    @property
    def next(self) -> Array:
        """Bounds of the risk until the next instant; shape (n, factors)."""
        total: Array = self.risks[:, 0].sum(axis=0)
        return np.minimum(total, 1.0)


class SpeedRisk:
    """Predicts the agents of a group at parts of the speed that they request."""

    uncaptured: ClassVar[Collection[str]] = "*"  # no state between calls

    def __init__(self, group: AgentGroup, specifications: Sequence[str], horizon: float, tail: Tail) -> None:
        """Prepare.

        Args:
            group: The group; its model is linear.
            specifications: The names of the specifications to keep.
            horizon: How far ahead to look [s].
            tail: What is assumed about deviations.
        """
        environment = group.surroundings.environment
        self._group = group
        self._tail = tail
        self._step = environment.time_step
        self._steps = max(1, round(nanoseconds(horizon) / self._step))
        self._windows = InvariantWindows(group, specifications, self._step)
        self._scope = PredictedAgentScope(group, environment, environment.groups, group.regions)
        self._noise = group.model.noise_covariance(self._step / SECOND)

    def of(self, requested: Array, now: int) -> RiskOfSpeeds:
        """Return the risk of going on at each of the `FACTORS` of the requested speed over the horizon.

        Args:
            requested: The control inputs that are requested; shape (n, nu).
            now: The present time [ns].
        """
        group, count, choices = self._group, len(self._group), len(FACTORS)
        end = group.surroundings.clock.end
        times = now + self._step * np.arange(1, self._steps + 1)
        counting = self._windows.counting(times, now, end)
        remaining = self._windows.remaining(now, end)
        agents = np.repeat(np.arange(count), choices)
        states, requests = group.awareness.state[agents], requested[agents]
        factors = np.tile(FACTORS, count)
        size = states.shape[1]
        believed = state_covariance(group)
        covariance = np.zeros((len(agents), size, size)) if believed is None else believed[agents]
        applied = self._inputs(states, requests, factors)
        risks = np.zeros((len(self._windows.invariants), self._steps, count, choices))
        for number, time in enumerate(times.tolist()):
            # The first control input is known; later ones answer to the state.
            inputs = applied if number == 0 else self._inputs(states, requests, factors)
            after = self._after(states, inputs)
            transition = np.empty(covariance.shape)
            for column, unit in enumerate(np.eye(size)):
                moved = states + unit
                answer = applied if number == 0 else self._inputs(moved, requests, factors)
                transition[:, :, column] = self._after(moved, answer) - after
            states, covariance = after, propagated(covariance, transition)
            if self._noise is not None:
                covariance = covariance + self._noise
            instants = np.full(len(agents), time / SECOND)
            moments = ExpectedMotion(instants, states, inputs, agents).moments(covariance, self._scope)
            for place, each in enumerate(self._windows.invariants):
                counts = counting[place, :, number]
                if counts.any():
                    fails = each.condition.failure(moments, self._tail).reshape(count, choices)
                    risks[place, number] = np.where(counts[:, None], fails, 0.0)
        return RiskOfSpeeds(risks, np.minimum(1.0, self._steps / np.maximum(remaining, 1)))

    def unkept(self, risks: Array, allowed: float, now: int) -> tuple[str, float]:
        """Return the specification that is not kept, and the instant [s] from which on it is not.

        Args:
            risks: The risks of an agent at its speed; shape (invariants, instants).
            allowed: What their sum may be; it is more.
            now: The present time [ns].
        """
        total = np.cumsum(risks, axis=1)
        instant = int(np.flatnonzero(total.sum(axis=0) > allowed)[0])
        name = self._windows.invariants[int(total[:, instant].argmax())].specification
        return name, (now + (instant + 1) * self._step) / SECOND

    def _inputs(self, states: Array, requested: Array, factors: Array) -> Array:
        model = self._group.model
        limited: Array = model.limit(model.slowed(states, requested, factors))
        return limited

    def _after(self, states: Array, inputs: Array) -> Array:
        return integrate(self._group.model, states, inputs, self._step / SECOND)
