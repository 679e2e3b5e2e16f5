"""Integration methods: explicit Euler and Runge-Kutta, for worlds and for predictions."""

from __future__ import annotations

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
    first = derivative(model, state, control_input)
    second = derivative(model, state + (0.5 * step) * first, control_input)
    third = derivative(model, state + (0.5 * step) * second, control_input)
    fourth = derivative(model, state + step * third, control_input)
    return state + (step / 6.0) * (first + 2.0 * (second + third) + fourth)


def integrate(model: Model, state: Array, control_input: Array, step: float) -> Array:
    """Advance states in closed form if the model has one, else by Runge-Kutta.

    Args:
        model: The dynamics.
        state: The states; shape (n, nx).
        control_input: The control inputs, constant over the step; shape (n, nu).
        step: Duration [s].

    Returns:
        The states after the step, without noise; shape (n, nx).
    """
    exact = model.exact_step(state, control_input, step)
    return rk4(model, state, control_input, step) if exact is None else exact
