"""Position reports: received positions and velocities of other agents, and the tracks that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Tracks

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class PositionReports(NamedTuple):
    """Stored reports in columns, ordered by receiver, sender and time.

    Attributes:
        keys: receiver row * roster_size + sender's index, ascending; shape (m,).
        sent: Send times, in nanoseconds, ascending for each key; shape (m,).
        positions: Positions of the senders [m]; shape (m, d).
        velocities: Velocities of the senders [m/s]; shape (m, d).
        variances: Variance of the position, along any axis [m^2]; shape (m,).
    """

    keys: NDArray[np.int64]
    sent: NDArray[np.int64]
    positions: Array
    velocities: Array
    variances: Array

    @classmethod
    def empty(cls, dimensions: int) -> PositionReports:
        """Return an empty collection."""
        nowhere = np.empty((0, dimensions))
        return cls(np.empty(0, np.int64), np.empty(0, np.int64), nowhere, nowhere, np.empty(0))

    def select(self, rows: NDArray[np.bool_] | Indices) -> PositionReports:
        """Return the selected reports."""
        keys, sent, positions, velocities, variances = self
        return PositionReports(keys[rows], sent[rows], positions[rows], velocities[rows], variances[rows])

    def merged(self, further: Sequence[PositionReports], *, latest: bool) -> PositionReports:
        """Return these and further reports, which need not be in order.

        Args:
            further: The reports to add.
            latest: Whether to keep only the last report of each sender.
        """
        merged = PositionReports(*(np.concatenate(columns) for columns in zip(self, *further, strict=True)))
        # A message may have arrived twice: of reports of one time only one is kept.
        order = np.lexsort((merged.sent, merged.keys))
        keys, sent = merged.keys[order], merged.sent[order]
        last = np.ones(len(keys), bool)
        last[:-1] = keys[1:] != keys[:-1]
        if not latest:
            last[:-1] |= sent[1:] != sent[:-1]
        return merged.select(order[last])

    def tracks(self, now: int, count: int, roster_size: int, speed: float, intensity: float) -> Tracks:
        """Extrapolate the positions of the senders to the present.

        Args:
            now: The present time, in nanoseconds.
            count: The number of receivers.
            roster_size: The number of agents in the roster.
            speed: Variance of velocities, along any axis [m^2/s^2].
            intensity: Power spectral density of accelerations, along any axis [m^2/s^3].
        """
        age = (now - self.sent) / 1e9
        positions = self.positions + age[:, None] * self.velocities
        spread = self.variances + speed * age**2 + intensity * age**3 / 3.0
        between, moving = speed * age + intensity * age**2 / 2.0, speed + intensity * age
        firsts = np.flatnonzero(np.r_[True, self.keys[1:] != self.keys[:-1]]) if len(self.keys) else np.empty(0, int)
        lasts = np.r_[firsts[1:], len(self.keys)] - 1 if len(firsts) else firsts
        if len(lasts) < len(self.keys):
            weights = 1.0 / np.maximum(spread, 1e-12)
            total = np.add.reduceat(weights, firsts)
            positions = np.add.reduceat(weights[:, None] * positions, firsts) / total[:, None]
        else:
            positions = positions[lasts]
        dimensions = positions.shape[1]
        covariances = np.zeros((len(lasts), 2 * dimensions, 2 * dimensions))
        axes = np.arange(dimensions)
        covariances[:, axes, axes] = spread[lasts, None]
        covariances[:, axes, axes + dimensions] = covariances[:, axes + dimensions, axes] = between[lasts, None]
        covariances[:, axes + dimensions, axes + dimensions] = moving[lasts, None]
        receivers, senders = np.divmod(self.keys[lasts], roster_size)
        velocities, ages = self.velocities[lasts], age[lasts]
        for array in (positions, velocities, covariances, ages):
            array.flags.writeable = False  # spares the tracks a copy
        return Tracks.of(now, count, receivers, senders, positions, velocities, covariances=covariances, ages=ages)
