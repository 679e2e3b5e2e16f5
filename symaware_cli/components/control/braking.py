"""Braking: the speeds from which a body can still stop in time, if its drive is limited."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: How often an interval of speeds is halved: until nothing of it is left in double precision.
_HALVINGS = 60


class Braking:
    """Chooses speeds, or turn rates, that are held for a period, such that a body comes to rest before a point.

    The drive changes the speed by at most c = a h in each physics step of the duration h. To change it by s takes
    n = ceil(s / c) steps, in which a body that brakes gets farther than one that stops at once by

        D(s) = h (s - c) + h (s - 2 c) + ... = h ((n - 1) s - c n (n - 1) / 2),

    and a body that accelerates less far than one that has its speed at once. So with a speed v at its beginning and u
    for the rest, a period T takes a body T u + D(v - u) if it brakes, T u - D(u - v) if it accelerates, and then D(u)
    farther if it brakes until it stops. The sum grows with u as long as u can be reached within the period; the
    greatest u for which it is at most the distance to the point is found by halving.
    """

    def __init__(self, acceleration: float, step: float, period: float) -> None:
        """Prepare.

        Args:
            acceleration: The greatest acceleration a, infinite for none [m/s^2]; of turns [rad/s^2].
            step: The duration h of a physics step [s].
            period: For how long a speed is held, T [s]; a multiple of `step`.
        """
        self.is_limited = bool(np.isfinite(acceleration))
        self._step, self._period = step, period
        self._change = acceleration * step
        #: By how much the speed changes within a period at most.
        self._most = acceleration * period

    def distance(self, change: Array) -> Array:
        """Return D for changes of the speed; of the same shape."""
        count = np.maximum(np.ceil(change / self._change), 1.0)
        farther: Array = self._step * (count - 1.0) * (change - 0.5 * self._change * count)
        return farther

    def slowed(self, speed: Array) -> Array:
        """Return the speeds after a period of braking; of the same shape."""
        return np.maximum(speed - self._most, 0.0) if self.is_limited else np.zeros_like(speed)

    def approach(self, speed: Array, distance: Array, most: float) -> Array:
        """Return the greatest speeds to hold for the next period such that a body can stop before a point.

        Args:
            speed: The present speeds, not negative; shape (n,).
            distance: The distances to the points, not negative; shape (n,).
            most: The greatest speed.

        Returns:
            The speeds; those of greatest braking where a body cannot stop in time.
        """
        if not self.is_limited:
            return np.minimum(most, distance / self._period)
        low = self.slowed(speed)
        high = np.maximum(np.minimum(speed + self._most, most), low)
        if (self._way(speed, high) <= distance).all():
            return high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            fits = self._way(speed, middle) <= distance
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        # Where `high` itself fits, halving has come to it from below.
        return low

    def _way(self, speed: Array, chosen: Array) -> Array:
        """Return how far a body gets in a period, and then until it stops."""
        change = self.distance(np.abs(chosen - speed))
        way: Array = self._period * chosen + np.where(chosen < speed, change, -change) + self.distance(chosen)
        return way
