"""Discrete dynamics: a model integrated over one step, for arrays and symbols."""

from __future__ import annotations

from typing import Any, get_args

import casadi
import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.core import Model
from symaware_cli.geometry import Array
from symaware_cli.world import Integrator, integrate, rk4_step


class Dynamics:
    """The state after one step under a constant control input, x+ = F(x, u).

    It uses the arithmetic of the kinematic world, so predictions are exact there: in closed form where the model has
    one, else by Runge-Kutta, or by the requested method. Models in discrete time are never
    integrated; each substep must be a step of theirs.

    Attributes:
        model: The model in continuous or discrete time.
        step: Duration [s].
        integrator: ``exact``, ``rk4`` or ``euler``, as of the kinematic world.
        substeps: The number of equal parts of a step.
    """

    __slots__ = ("_part", "integrator", "model", "step", "substeps")

    def __init__(self, model: Model, step: float, integrator: Integrator = "exact", substeps: int = 1) -> None:
        """Choose the step and the method.

        Raises:
            ValueError: The step, the number of parts or the integrator is invalid.
        """
        if not (np.isfinite(step) and step > 0.0) or substeps < 1:
            raise ValueError(f"invalid step: {step:g} s in {substeps} parts")
        if integrator not in get_args(Integrator):
            raise ValueError(f"the integrator must be one of {', '.join(get_args(Integrator))}, not {integrator}")
        self.model = model
        self.step = float(step)
        self.integrator = integrator
        self.substeps = substeps
        self._part = self.step / substeps

    def __call__(self, state: Array, control_input: Array) -> Array:
        """Return the states (n, nx) after one step under control inputs (n, nu), without noise; shape (n, nx)."""
        for _ in range(self.substeps):
            state = integrate(self.model, state, control_input, self._part, self.integrator)
        return state

    def symbolic(self, state: Any, control_input: Any) -> Any:
        """Return the state after one step as a CasADi expression, for symbols of state and control input."""
        model, part = self.model, self._part

        def rate(x: Any) -> Any:
            return casadi.vertcat(*model.derivative(x, control_input, casadi))

        is_closed = self.integrator == "exact" or model.time_step is not None
        for _ in range(self.substeps):
            after = model.successor(state, control_input, part, casadi) if is_closed else None
            if after is not None:
                state = casadi.vertcat(*after)
            else:
                state = state + part * rate(state) if self.integrator == "euler" else rk4_step(rate, state, part)
        return state

    def rollout(self, state: ArrayLike, inputs: ArrayLike) -> Array:
        """Return the states from a state (nx,) under control inputs (N, nu); shape (N + 1, nx)."""
        sequence = np.array(inputs, float)
        states = np.empty((len(sequence) + 1, len(self.model.state)))
        states[0] = state
        for k, control_input in enumerate(sequence):
            states[k + 1] = self(states[k : k + 1], control_input[None])[0]
        return states
