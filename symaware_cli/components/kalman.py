"""The extended Kalman filter for agents that measure their own state: prediction and correction.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", Wiley 2001,
chapter 5 (the linear filter) and chapter 10 (the extended filter). One call serves all agents of a group.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.world.integration import integrate
from symaware_cli.world.model import Model

Array = NDArray[np.float64]


class Belief(NamedTuple):
    """Estimates of agents' own states; the arrays are never changed in place.

    Attributes:
        state: The mean; shape (n, nx).
        covariance: Symmetric, positive semidefinite; shape (n, nx, nx).
    """

    state: Array
    covariance: Array


def predicted(model: Model, belief: Belief, control_input: Array, step: float) -> Belief:
    """Predict beliefs: x through the model, P as F P F' + Q with the model's process noise.

    Args:
        model: The dynamics.
        belief: The beliefs at the beginning of the step.
        control_input: The applied control inputs, constant over the step; shape (n, nu).
        step: Duration [s].
    """
    state = integrate(model, belief.state, control_input, step)
    transition = transition_of(model, belief.state, state, control_input, step)
    covariance = transition @ belief.covariance @ transition.transpose(0, 2, 1)
    covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
    noise = model.noise_covariance(step)
    if noise is not None:
        covariance += noise
    return Belief(state, covariance)


def transition_of(model: Model, before: Array, after: Array, control_input: Array, step: float) -> Array:
    """Return the transition matrices of errors of the state over a step, to first order.

    This is the matrix exponential of A = J(x, u) step, at the midpoint between both states, as I + A + A^2/2 + A^3/6 +
    A^4/24, which equals a Runge-Kutta step of a linear model. For integrators and vehicles with a heading A^2 = 0, so
    it is I + J step; for models in discrete time it is so by their definition of J.

    Args:
        model: The dynamics.
        before: The states at the beginning of the step; shape (n, nx).
        after: The states at its end; shape (n, nx).
        control_input: The control inputs, constant over the step; shape (n, nu).
        step: Duration [s].

    Returns:
        Shape (n, nx, nx).
    """
    identity = np.eye(before.shape[1])
    if model.time_step is not None:
        return identity + model.jacobian(before, control_input) * step
    change = after - before
    for element in model.angles:
        change[:, element] = wrapped(change[:, element])
    rate = model.jacobian(before + 0.5 * change, control_input) * step
    square = rate @ rate
    if not square.any():
        return identity + rate
    transition: Array = identity + rate + square @ (identity / 2 + rate / 6 + square / 24)
    return transition


def wrapped(angle: Array) -> Array:
    """Wrap angles to [-pi, pi) [rad]."""
    turned: Array = np.remainder(angle + np.pi, 2 * np.pi) - np.pi
    return turned


def corrected(model: Model, belief: Belief, measured: Array, deviation: Array) -> Belief:
    """Correct beliefs by a measurement of the whole state.

    The errors of its elements are independent of each other, so they are applied one after the other, which equals
    applying them all at once and inverts no matrix. With p the column of element j and r the variance of its error, the
    covariance becomes P - p p' / (P_jj + r). Its row and column j are computed as r / (P_jj + r) times their previous
    values: like Joseph's form, this avoids differences of nearly equal numbers, and it is exactly 0 for r = 0.

    Args:
        model: The model, which declares the elements that are angles; their innovations are wrapped.
        belief: The beliefs before the measurement.
        measured: The measured states; shape (n, nx).
        deviation: Standard deviation of the errors of each element; shape (nx,). Elements of 0 are known exactly.
    """
    if not deviation.any():
        return Belief(measured, np.zeros_like(belief.covariance))
    state, covariance = belief.state.copy(), belief.covariance
    for element, variance in enumerate(np.square(deviation).tolist()):
        column = covariance[:, :, element]
        total = column[:, element] + variance
        # If both the belief and the measurement are exact, the gain is 0/0: the measurement is used.
        weight = 1.0 / np.where(total > 0.0, total, 1.0)
        innovation = measured[:, element] - state[:, element]
        if element in model.angles:
            innovation = wrapped(innovation)
        state += column * (weight * innovation)[:, None]
        if variance == 0.0:
            state[:, element] = measured[:, element]
        explained = column * np.sqrt(weight)[:, None]
        remaining = column * (variance * weight)[:, None]
        covariance = covariance - explained[:, :, None] * explained[:, None, :]
        covariance[:, element, :] = covariance[:, :, element] = remaining
    diagonal = np.arange(len(deviation))
    covariance[:, diagonal, diagonal] = np.maximum(covariance[:, diagonal, diagonal], 0.0)
    return Belief(state, covariance)
