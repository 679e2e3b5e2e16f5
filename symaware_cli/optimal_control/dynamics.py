"""Discrete dynamics: the model's own motion over one step, for arrays and for symbols alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core import Model
from symaware_cli.world.integration import euler, rk4

Array = NDArray[np.float64]
Integrator = Literal["exact", "rk4", "euler"]


class Dynamics:
    """How a state changes over one step under a constant control input, x+ = F(x, u).

    It is the arithmetic of the kinematic world, so that a prediction is what happens there: in closed form where the
    model has one, else by Runge-Kutta, or by the method that is asked for. Models in discrete time are never
    integrated; each substep must be a step of theirs.

    Attributes:
        model: The dynamics in continuous time, or the map.
        step: Time [s].
        integrator: ``exact``, ``rk4`` or ``euler``, as of the kinematic world.
        substeps: Into how many equal parts the step is divided.
    """

    __slots__ = ("_part", "integrator", "model", "step", "substeps")

    def __init__(self, model: Model, step: float, integrator: Integrator = "exact", substeps: int = 1) -> None:
        """Choose the step and the method.

        Raises:
            ValueError: There is no such step, or no such integrator.
        """
        if not (np.isfinite(step) and step > 0.0) or substeps < 1:
            raise ValueError(f"a step of {step:g} s in {substeps} parts is none")
        if integrator not in _METHODS:
            raise ValueError(f"the integrator must be one of {', '.join(_METHODS)}, not {integrator}")
        self.model = model
        self.step = float(step)
        self.integrator = integrator
        self.substeps = substeps
        self._part = self.step / substeps

    def __call__(self, state: Array, control_input: Array) -> Array:
        """The states (n, nx) after one step under control inputs (n, nu), without noise; shape (n, nx)."""
        model, part = self.model, self._part
        for _ in range(self.substeps):
            after = model.exact_step(state, control_input, part) if self._closed else None
            state = _METHODS[self.integrator][0](model, state, control_input, part) if after is None else after
        return state

    def symbolic(self, state: Any, control_input: Any) -> Any:
        """The state after one step as a CasADi expression, of columns of symbols of state and control input."""
        model, part = self.model, self._part

        def rate(x: Any) -> Any:
            return casadi.vertcat(*model.derivative(x, control_input, casadi))

        for _ in range(self.substeps):
            after = model.successor(state, control_input, part, casadi) if self._closed else None
            state = _METHODS[self.integrator][1](rate, state, part) if after is None else casadi.vertcat(*after)
        return state

    def rollout(self, state: ArrayLike, inputs: ArrayLike) -> Array:
        """The states that a sequence of control inputs (N, nu) leads to from a state (nx,); shape (N + 1, nx)."""
        sequence = np.array(inputs, float)
        states = np.empty((len(sequence) + 1, len(self.model.state)))
        states[0] = state
        for k, control_input in enumerate(sequence):
            states[k + 1] = self(states[k : k + 1], control_input[None])[0]
        return states

    @property
    def _closed(self) -> bool:
        """Whether the model is asked for its closed form."""
        return self.integrator == "exact" or self.model.time_step is not None


def _euler(rate: Callable[[Any], Any], state: Any, step: float) -> Any:
    return state + step * rate(state)


def _rk4(rate: Callable[[Any], Any], state: Any, step: float) -> Any:
    first = rate(state)
    second = rate(state + (0.5 * step) * first)
    third = rate(state + (0.5 * step) * second)
    fourth = rate(state + step * third)
    return state + (step / 6.0) * (first + 2.0 * (second + third) + fourth)


#: The same method for arrays, of a model, and for symbols, of a rate.
_METHODS: Mapping[str, tuple[Callable[[Model, Array, Array, float], Array], Callable[..., Any]]] = {
    "exact": (rk4, _rk4),
    "rk4": (rk4, _rk4),
    "euler": (euler, _euler),
}
