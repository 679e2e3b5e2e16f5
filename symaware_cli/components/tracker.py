"""Tracking: Gaussian beliefs of where others are, kept while they are out of sight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Observation, Tracks

Array = NDArray[np.float64]


class Tracker:
    """Tracks of all others that the agents of a group perceive or perceived, each a Kalman filter.

    Others are taken to go straight on, but for white noise of acceleration (Y. Bar-Shalom, X. R. Li, T. Kirubarajan,
    "Estimation with Applications to Tracking and Navigation", Wiley 2001, section 6.2.2, the continuous white noise
    acceleration model). With intensity q, over a time T, and for each axis:

        F = [1 T; 0 1],   Q = q [T^3/3 T^2/2; T^2/2 T]

    Two steps of this are exactly one step of the sum, so tracks rest at the instant of the latest observation, and are
    predicted from there to whenever somebody asks: neither a delay nor being out of sight costs exactness.

    Position and velocity are measured along each axis with the same errors. Hence all axes have the same covariance at
    all times and none with each other, and each track keeps three numbers instead of a matrix.

    Attributes:
        time: The instant of the latest observation, in nanoseconds.
    """

    def __init__(
        self, agents: int, everybody: int, dimensions: int, intensity: float, memory: int, limit: float
    ) -> None:
        """Know nobody.

        Args:
            agents: How many agents keep tracks.
            everybody: How many there are in the roster.
            dimensions: Of the world.
            intensity: Power spectral density of the acceleration, q [m^2/s^3].
            memory: For how long another who is out of sight is remembered, in nanoseconds.
            limit: Standard deviation of the position, along an axis, beyond which it is given up [m].
        """
        self.time = 0
        self._agents = agents
        self._everybody = everybody
        self._intensity = intensity
        self._memory = memory
        self._limit = limit * limit
        #: Who is tracked by whom: agent * everybody + other, ascending.
        self._keys = np.empty(0, np.int64)
        self._seen = np.empty(0, np.int64)
        self._positions, self._velocities = np.empty((2, 0, dimensions))
        #: Variance of the position, covariance with the velocity, variance of the velocity, along any axis; (3, m).
        self._spread = np.empty((3, 0))

    def observe(self, observation: Observation) -> None:
        """Take account of whom the agents see, at an instant that is not before the latest one."""
        seen = observation.tracks
        self._positions, self._spread = self._predicted(observation.time - self.time)
        self.time = observation.time
        keys = seen.observers * self._everybody + seen.others
        places = np.searchsorted(self._keys, keys)
        known = np.zeros(len(keys), bool)
        inside = places < len(self._keys)
        known[inside] = self._keys[places[inside]] == keys[inside]
        if known.all():
            self._correct(places, seen.positions, seen.velocities, observation)
        else:
            self._correct(places[known], seen.positions[known], seen.velocities[known], observation)
        kept = self._remembered(self.time, self._spread)
        if not (known.all() and kept.all()):
            self._rearrange(kept, ~known, keys, observation)

    def tracks(self, now: int, latest: int) -> Tracks:
        """What the agents believe now of those whom they remember.

        Args:
            now: In nanoseconds.
            latest: The latest instant of which they can have seen something, in nanoseconds.
        """
        positions, spread = self._predicted(now - self.time)
        kept = self._remembered(latest, spread)
        keys, velocities, seen = self._keys, self._velocities, self._seen
        if not kept.all():
            keys, seen = keys[kept], seen[kept]
            positions, velocities, spread = positions[kept], velocities[kept], spread[:, kept]
        pointers = np.searchsorted(keys, np.arange(self._agents + 1) * self._everybody)
        covariances, ages = _matrices(spread, positions.shape[1]), (now - seen) / 1e9
        for array in (positions, velocities, covariances, ages):
            array.flags.writeable = False  # spares the tracks a copy; nothing here is changed in place anyway
        return Tracks(now, pointers, keys % self._everybody, positions, velocities, covariances, ages)

    def _predicted(self, duration: int) -> tuple[Array, Array]:
        """Positions and spread after a while; the velocities stay as they are."""
        if duration == 0:
            return self._positions, self._spread
        time = duration / 1e9
        position, between, velocity = self._spread
        spread = np.empty_like(self._spread)
        spread[0] = position + time * (2.0 * between + time * velocity) + self._intensity * time**3 / 3.0
        spread[1] = between + time * velocity + self._intensity * time**2 / 2.0
        spread[2] = velocity + self._intensity * time
        return self._positions + time * self._velocities, spread

    def _correct(self, rows: NDArray[np.intp], positions: Array, velocities: Array, observation: Observation) -> None:
        """Measure the position, then the velocity; their errors are independent, so this equals both at once."""
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
        # What was handed out stays as it is.
        self._positions, self._velocities = self._positions.copy(), self._velocities.copy()
        self._spread, self._seen = self._spread.copy(), self._seen.copy()
        self._positions[rows] = believed
        self._velocities[rows] = moving
        self._spread[:, rows] = position, between, velocity
        self._seen[rows] = observation.time

    def _remembered(self, latest: int, spread: Array) -> NDArray[np.bool_]:
        kept: NDArray[np.bool_] = (latest - self._seen <= self._memory) & (spread[0] <= self._limit)
        return kept

    def _rearrange(
        self, kept: NDArray[np.bool_], new: NDArray[np.bool_], keys: NDArray[np.int64], observation: Observation
    ) -> None:
        """Drop tracks and begin others, from one measurement each."""
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
    """Measure one of two quantities, given their variances and covariance; each of shape (m,).

    What of the other's variance the measured one does not explain stays; all else shrinks by noise / (own + noise).
    So written, the result is positive semidefinite whatever the rounding, also without noise.

    Returns:
        The three numbers after it, and the gains of both quantities.
    """
    total = own + noise
    certain = total <= 0.0
    # Where a certain belief meets an exact measurement, the gain is 0/0: the measurement counts.
    weight = 1.0 / np.where(certain, 1.0, total)
    rest = noise * weight
    gain = np.where(certain, 1.0, own * weight)
    explained = between * between / np.where(own > 0.0, own, 1.0)
    remaining = np.maximum(other - explained, 0.0) + explained * rest
    return own * rest, between * rest, remaining, gain, between * weight


def _matrices(spread: Array, dimensions: int) -> Array:
    """The covariance of position and velocity of each track; shape (m, 2d, 2d)."""
    matrices = np.zeros((spread.shape[1], 2 * dimensions, 2 * dimensions))
    for place in range(dimensions):
        speed = dimensions + place
        matrices[:, place, place] = spread[0]
        matrices[:, place, speed] = matrices[:, speed, place] = spread[1]
        matrices[:, speed, speed] = spread[2]
    return matrices
