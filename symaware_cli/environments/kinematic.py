"""The kinematic world: models integrated as they are, with neither forces nor friction."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import AgentGroup, Contact, Environment, EnvironmentParameters, Model, Obstacle, Snapshot
from symaware_cli.environments.contact import ContactDetector

Array = NDArray[np.float64]


def _derivative(model: Model, state: Array, control_input: Array) -> Array:
    rates = np.empty_like(state)
    for column, rate in enumerate(model.derivative(state.T, control_input.T, np)):
        rates[:, column] = rate
    return rates


def euler(model: Model, state: Array, control_input: Array, step: float) -> Array:
    """One step of the explicit Euler method; error O(step) over a fixed time."""
    return state + step * _derivative(model, state, control_input)


def rk4(model: Model, state: Array, control_input: Array, step: float) -> Array:
    """One step of the classical Runge-Kutta method; error O(step^4) over a fixed time."""
    first = _derivative(model, state, control_input)
    second = _derivative(model, state + (0.5 * step) * first, control_input)
    third = _derivative(model, state + (0.5 * step) * second, control_input)
    fourth = _derivative(model, state + step * third, control_input)
    return state + (step / 6.0) * (first + 2.0 * (second + third) + fourth)


_INTEGRATORS: Mapping[str, Callable[[Model, Array, Array, float], Array]] = {"euler": euler, "rk4": rk4}


class KinematicEnvironment(Environment):
    """Moves every group by its own model; bodies pass through each other, and their contacts are reported."""

    class Parameters(EnvironmentParameters):
        """How the kinematic world moves."""

        integrator: Literal["euler", "rk4"] = Field(
            "rk4", description="How the dynamics are integrated: explicit Euler, or Runge-Kutta of order 4."
        )

    def initialise(self, groups: Sequence[AgentGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Put everybody in place."""
        super().initialise(groups, obstacles, seed)
        self._integrate = _INTEGRATORS[self.parameters.integrator]
        self._number = {group.name: number for number, group in enumerate(self.groups)}
        self._states = [group.initial_state for group in self.groups]
        self._applied = [group.control_input for group in self.groups]
        self._models = [group.model for group in self.groups]
        self._time = 0
        self._snapshot: Snapshot | None = None
        radii = [group.entity.radius for group in self.groups for _ in group.ids]
        self._detector = ContactDetector(self.roster.ids, radii, self.obstacles, self.proximity)
        self._contacts: Sequence[Contact] = self._detector.update(self.snapshot().positions)

    def step(self) -> None:
        """Advance every group by its model under its saturated control input."""
        step = self.parameters.time_step
        for number, group in enumerate(self.groups):
            applied = group.model.limit(group.control_input)
            state = self._integrate(group.model, self._states[number], applied, step)
            applied.flags.writeable = False
            state.flags.writeable = False
            self._applied[number], self._states[number] = applied, state
        self._time += self.time_step
        self._snapshot = None
        self._contacts = self._detector.update(self.snapshot().positions)

    def state(self, group: AgentGroup) -> Array:
        """The true states of a group, read-only; shape (n, nx)."""
        return self._states[self._number[group.name]]

    def applied_input(self, group: AgentGroup) -> Array:
        """The control inputs of the last step after saturation, read-only; shape (n, nu)."""
        return self._applied[self._number[group.name]]

    def snapshot(self) -> Snapshot:
        """The whole world now."""
        if self._snapshot is None:
            self._snapshot = Snapshot(self._time, self.roster, self._models, self._states, self._applied)
        return self._snapshot

    def contacts(self) -> Sequence[Contact]:
        """The contacts that began or ended with the last step."""
        return self._contacts
