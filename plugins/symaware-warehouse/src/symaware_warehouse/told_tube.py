"""Plans with tubes that were received from other robots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli import TimeSeries

Array = NDArray[np.float64]


class ToldTube(NamedTuple):
    """The plan received from another robot: an intent with its tube.

    Attributes:
        id: The robot.
        start: The step of the plan at which it begins.
        positions: The planned positions from then on; shape (m, 2) [m].
        radii: The radii of the tube; shape (m,) [m].
    """

    id: str
    start: int
    positions: Array
    radii: Array

    @classmethod
    def of(cls, id: str, intent: TimeSeries, uncertainty: TimeSeries, step: int, origin: int) -> ToldTube | None:
        """Return the plan of an intent and an uncertainty of `warehouse.plan`; None if they do not belong together.

        Args:
            id: The robot.
            intent: Its intent.
            uncertainty: Its uncertainty, whose last column is the radius.
            step: The duration of a step [ns].
            origin: The step of the world that is step 0 of plans.
        """
        times = intent.times
        if len(times) < 2 or not np.array_equal(times, uncertainty.times):
            return None
        return cls(id, int(times[0] // step) - origin, intent.values, uncertainty.values[:, -1])

    def rest(self, step: int) -> tuple[Array, Array]:
        """Return the positions and the radii from a step on; empty if unknown."""
        place = step - self.start
        return (self.positions[place:], self.radii[place:]) if place >= 0 else (self.positions[:0], self.radii[:0])
