"""Kalman filters: an extended one of own states that are measured, and trackers of other agents.

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", Wiley 2001,
chapter 5 (the linear filter) and chapter 10 (the extended filter). All agents of a group are filtered together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Observation, Tracks
from symaware_cli.geometry import Array, Indices, Mask, wrapped
from symaware_cli.world import Model, integrate


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
    return identity + rate + square @ (identity / 2 + rate / 6 + square / 24)


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


class Tracker:
    """Tracks all others that the agents of a group perceive or have perceived, each by a Kalman filter.

    Others are assumed to move with constant velocity, disturbed by white noise of acceleration (Y. Bar-Shalom, X. R.
    Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", Wiley 2001, section 6.2.2, the
    continuous white noise acceleration model). With intensity q, over a time T, and for each axis:

        F = [1 T; 0 1],   Q = q [T^3/3 T^2/2; T^2/2 T]

    Two steps of this equal one step over the sum of their times, so tracks are stored at the instant of the latest
    observation and predicted from there on demand, without loss of accuracy by delays or times out of sight.

    Position and velocity are measured along each axis with the same errors. Hence all axes always have the same
    covariance, without correlation between axes, and each track stores three numbers instead of a matrix.

    Attributes:
        time: The instant of the latest observation, in nanoseconds.
    """

    def __init__(
        self, agents: int, roster_size: int, dimensions: int, intensity: float, memory: int, limit: float
    ) -> None:
        """Start without tracks.

        Args:
            agents: The number of agents that track others.
            roster_size: The number of agents in the roster.
            dimensions: The number of coordinates of a position.
            intensity: Power spectral density of the acceleration, q [m^2/s^3].
            memory: How long an agent that is out of sight is remembered, in nanoseconds.
            limit: Standard deviation of the position, along an axis, beyond which a track is dropped [m].
        """
        self.time = 0
        self._agents = agents
        self._roster_size = roster_size
        self._intensity = intensity
        self._memory = memory
        self._limit = limit * limit
        #: The tracked pairs: agent * roster_size + other, ascending.
        self._keys = np.empty(0, np.int64)
        self._seen = np.empty(0, np.int64)
        self._positions, self._velocities = np.empty((2, 0, dimensions))
        #: Variance of the position, covariance with the velocity, variance of the velocity, along any axis; (3, m).
        self._spread = np.empty((3, 0))

    def observe(self, observation: Observation) -> None:
        """Correct the tracks by an observation, at an instant not before that of the latest one."""
        seen = observation.tracks
        self._positions, self._spread = self._predicted(observation.time - self.time)
        self.time = observation.time
        keys = seen.observers * self._roster_size + seen.others
        indices = np.searchsorted(self._keys, keys)
        known = np.zeros(len(keys), bool)
        inside = indices < len(self._keys)
        known[inside] = self._keys[indices[inside]] == keys[inside]
        if known.all():
            self._correct(indices, seen.positions, seen.velocities, observation)
        else:
            self._correct(indices[known], seen.positions[known], seen.velocities[known], observation)
        kept = self._remembered(self.time, self._spread)
        if not (known.all() and kept.all()):
            self._rearrange(kept, ~known, keys, observation)

    def tracks(self, now: int, latest: int) -> Tracks:
        """Return the present tracks of all others that are remembered.

        Args:
            now: The present time, in nanoseconds.
            latest: The latest instant that an observation can have, in nanoseconds.
        """
        positions, spread = self._predicted(now - self.time)
        kept = self._remembered(latest, spread)
        keys, velocities, seen = self._keys, self._velocities, self._seen
        if not kept.all():
            keys, seen = keys[kept], seen[kept]
            positions, velocities, spread = positions[kept], velocities[kept], spread[:, kept]
        pointers = np.searchsorted(keys, np.arange(self._agents + 1) * self._roster_size)
        covariances, ages = _matrices(spread, positions.shape[1]), (now - seen) / 1e9
        for array in (positions, velocities, covariances, ages):
            array.flags.writeable = False  # spares the tracks a copy; nothing here is changed in axis anyway
        return Tracks(now, pointers, keys % self._roster_size, positions, velocities, covariances, ages)

    def _predicted(self, duration: int) -> tuple[Array, Array]:
        """Return positions and spread after a duration; velocities stay the same."""
        if duration == 0:
            return self._positions, self._spread
        time = duration / 1e9
        position, between, velocity = self._spread
        spread = np.empty_like(self._spread)
        spread[0] = position + time * (2.0 * between + time * velocity) + self._intensity * time**3 / 3.0
        spread[1] = between + time * velocity + self._intensity * time**2 / 2.0
        spread[2] = velocity + self._intensity * time
        return self._positions + time * self._velocities, spread

    def _correct(self, rows: Indices, positions: Array, velocities: Array, observation: Observation) -> None:
        """Apply the measured positions, then the velocities; their errors are independent, so this is exact."""
        if not len(rows):
            return
        believed, moving, spread = self._positions[rows], self._velocities[rows], self._spread[:, rows]
        position, between, velocity = spread
        position, between, velocity, gain, other_gain = _measured(
            position, between, velocity, observation.position_deviation**2
        )
        innovation = positions - believed
        believed = believed + gain[:, None] * innovation
        moving = moving + other_gain[:, None] * innovation
        velocity, between, position, gain, other_gain = _measured(
            velocity, between, position, observation.velocity_deviation**2
        )
        innovation = velocities - moving
        moving += gain[:, None] * innovation
        believed += other_gain[:, None] * innovation
        # Arrays that were handed out stay unchanged.
        self._positions, self._velocities = self._positions.copy(), self._velocities.copy()
        self._spread, self._seen = self._spread.copy(), self._seen.copy()
        self._positions[rows] = believed
        self._velocities[rows] = moving
        self._spread[:, rows] = position, between, velocity
        self._seen[rows] = observation.time

    def _remembered(self, latest: int, spread: Array) -> Mask:
        kept: Mask = (latest - self._seen <= self._memory) & (spread[0] <= self._limit)
        return kept

    def _rearrange(self, kept: Mask, new: Mask, keys: NDArray[np.int64], observation: Observation) -> None:
        """Drop tracks, and begin new ones from one measurement each."""
        seen, count = observation.tracks, int(new.sum())
        merged = np.concatenate([self._keys[kept], keys[new]])
        order = np.argsort(merged, kind="stable")
        first = np.array([observation.position_deviation**2, 0.0, observation.velocity_deviation**2])
        self._keys = merged[order]
        self._positions = np.concatenate([self._positions[kept], seen.positions[new]])[order]
        self._velocities = np.concatenate([self._velocities[kept], seen.velocities[new]])[order]
        self._seen = np.concatenate([self._seen[kept], np.full(count, observation.time)])[order]
        begun = np.repeat(first[:, None], count, axis=1)
        self._spread = np.concatenate([self._spread[:, kept], begun], axis=1)[:, order]


def _measured(own: Array, between: Array, other: Array, noise: float) -> tuple[Array, Array, Array, Array, Array]:
    """Measure one of two quantities with given variances and covariance; each of shape (m,).

    The part of the other variance that the measured quantity does not explain remains; all else shrinks by
    noise / (own + noise). In this form the result is positive semidefinite despite rounding, also without noise.

    Returns:
        The three numbers after the measurement, and the gains of both quantities.
    """
    total = own + noise
    certain = total <= 0.0
    # If both the belief and the measurement are exact, the gain is 0/0: the measurement is used.
    weight = 1.0 / np.where(certain, 1.0, total)
    rest = noise * weight
    gain = np.where(certain, 1.0, own * weight)
    explained = between * between / np.where(own > 0.0, own, 1.0)
    remaining = np.maximum(other - explained, 0.0) + explained * rest
    return own * rest, between * rest, remaining, gain, between * weight


def _matrices(spread: Array, dimensions: int) -> Array:
    """Return the covariance of position and velocity of each track; shape (m, 2d, 2d)."""
    matrices = np.zeros((spread.shape[1], 2 * dimensions, 2 * dimensions))
    for axis in range(dimensions):
        speed = dimensions + axis
        matrices[:, axis, axis] = spread[0]
        matrices[:, axis, speed] = matrices[:, speed, axis] = spread[1]
        matrices[:, speed, speed] = spread[2]
    return matrices
