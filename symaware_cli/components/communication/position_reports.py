"""Position reports: messages of where their senders were that an inbox keeps, and what follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Tracks

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class PositionReports(NamedTuple):
    """Messages that are kept, in columns, by receiver, sender and time.

    Attributes:
        keys: receiver row * everybody + sender's index, ascending; shape (m,).
        sent: When each was sent, in nanoseconds, ascending for each key; shape (m,).
        positions: Where the sender was [m]; shape (m, d).
        velocities: How fast it moved [m/s]; shape (m, d).
        variances: Variance of the position, along any axis [m^2]; shape (m,).
    """

    keys: NDArray[np.int64]
    sent: NDArray[np.int64]
    positions: Array
    velocities: Array
    variances: Array

    @classmethod
    def nothing(cls, dimensions: int) -> PositionReports:
        """No message yet."""
        nowhere = np.empty((0, dimensions))
        return cls(np.empty(0, np.int64), np.empty(0, np.int64), nowhere, nowhere, np.empty(0))

    def some(self, places: NDArray[np.bool_] | Indices) -> PositionReports:
        """Some of them."""
        keys, sent, positions, velocities, variances = self
        return PositionReports(keys[places], sent[places], positions[places], velocities[places], variances[places])

    def joined(self, further: Sequence[PositionReports], *, latest: bool) -> PositionReports:
        """These and further ones, which need not be in order.

        Args:
            further: What came besides.
            latest: Whether only the one of each sender is kept that was sent last.
        """
        joined = PositionReports(*(np.concatenate(columns) for columns in zip(self, *further, strict=True)))
        # The same message may have come twice: of equal times one counts.
        order = np.lexsort((joined.sent, joined.keys))
        keys, sent = joined.keys[order], joined.sent[order]
        last = np.ones(len(keys), bool)
        last[:-1] = keys[1:] != keys[:-1]
        if not latest:
            last[:-1] |= sent[1:] != sent[:-1]
        return joined.some(order[last])

    def tracks(self, now: int, count: int, everybody: int, speed: float, intensity: float) -> Tracks:
        """What follows from them of where the senders are now.

        Args:
            now: In nanoseconds.
            count: How many receivers there are.
            everybody: How many agents there are.
            speed: Variance of velocities, along any axis [m^2/s^2].
            intensity: Power spectral density of accelerations, along any axis [m^2/s^3].
        """
        age = (now - self.sent) / 1e9
        positions = self.positions + age[:, None] * self.velocities
        place = self.variances + speed * age**2 + intensity * age**3 / 3.0
        between, moving = speed * age + intensity * age**2 / 2.0, speed + intensity * age
        firsts = np.flatnonzero(np.r_[True, self.keys[1:] != self.keys[:-1]]) if len(self.keys) else np.empty(0, int)
        lasts = np.r_[firsts[1:], len(self.keys)] - 1 if len(firsts) else firsts
        if len(lasts) < len(self.keys):
            weights = 1.0 / np.maximum(place, 1e-12)
            total = np.add.reduceat(weights, firsts)
            positions = np.add.reduceat(weights[:, None] * positions, firsts) / total[:, None]
        else:
            positions = positions[lasts]
        dimensions = positions.shape[1]
        covariances = np.zeros((len(lasts), 2 * dimensions, 2 * dimensions))
        axes = np.arange(dimensions)
        covariances[:, axes, axes] = place[lasts, None]
        covariances[:, axes, axes + dimensions] = covariances[:, axes + dimensions, axes] = between[lasts, None]
        covariances[:, axes + dimensions, axes + dimensions] = moving[lasts, None]
        receivers, senders = np.divmod(self.keys[lasts], everybody)
        velocities, ages = self.velocities[lasts], age[lasts]
        for array in (positions, velocities, covariances, ages):
            array.flags.writeable = False  # spares the tracks a copy
        return Tracks.of(now, count, receivers, senders, positions, velocities, covariances=covariances, ages=ages)
