"""Integration methods: explicit Euler and Runge-Kutta, for worlds and for predictions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.world.model import Model, columns, rows

Array = NDArray[np.float64]


def derivative(model: Model, state: Array, control_input: Array) -> Array:
    """Return the time derivative of states (n, nx) under control inputs (n, nu); shape (n, nx)."""
    return rows(model.derivative(columns(state), columns(control_input), np), len(state))


def euler(model: Model, state: Array, control_input: Array, step: float) -> Array:
    """Perform one step of the explicit Euler method; error O(step) over a fixed time."""
    return state + step * derivative(model, state, control_input)


def rk4(model: Model, state: Array, control_input: Array, step: float) -> Array:
    """Perform one step of the classical Runge-Kutta method; error O(step^4) over a fixed time."""
    stepped: Array = rk4_step(lambda each: derivative(model, each, control_input), state, step)
    return stepped


def rk4_step(rate: Callable[[Any], Any], state: Any, step: float) -> Any:
    """Perform a step of `rk4` for a function that returns the rate of a state; for arrays and symbols."""
    first = rate(state)
    second = rate(state + (0.5 * step) * first)
    third = rate(state + (0.5 * step) * second)
    fourth = rate(state + step * third)
    return state + (step / 6.0) * (first + 2.0 * (second + third) + fourth)


#: In closed form if the model has one, else as rk4; by Runge-Kutta of order 4; by the explicit Euler method.
Integrator = Literal["exact", "rk4", "euler"]


def integrate(
    model: Model, state: Array, control_input: Array, step: float, integrator: Integrator = "exact", parts: int = 1
) -> Array:
    """Advance states, of a model in discrete time always in closed form.

    Args:
        model: The dynamics.
        state: The states; shape (n, nx).
        control_input: The control inputs, constant over the step; shape (n, nu).
        step: Duration [s].
        integrator: The method.
        parts: The number of parts of the step, unless it is made in closed form.

    Returns:
        The states after the step, without noise; shape (n, nx).
    """
    if integrator == "exact" or model.time_step is not None:
        after = model.exact_step(state, control_input, step)
        if after is not None:
            return after
    method = euler if integrator == "euler" else rk4
    for _ in range(parts):
        state = method(model, state, control_input, step / parts)
    return state
