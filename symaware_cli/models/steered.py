"""Base class of cars, which turn by a steering angle."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Quantity
from symaware_cli.models.heading import HeadingModel

Array = NDArray[np.float64]


class SteeredModel(HeadingModel):
    """A car with a speed v and a steering angle s, which turns at v tan(s) / L, where L is the wheelbase.

    Its parameters are the limits ``min_speed``, ``max_speed`` and ``max_steering_angle``, and ``steering_gain``.
    """

    control_input = (Quantity("speed", "m/s"), Quantity("steering_angle", "rad"))
    heading = 2

    @property
    @abstractmethod
    def wheelbase(self) -> float:
        """The distance between the axles [m]."""

    def motion(self, control_input: Any, math: Any) -> tuple[Any, Any]:
        """Return v and v tan(s) / L."""
        return control_input[0], control_input[0] * math.tan(control_input[1]) / self.wheelbase

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of speed and steering angle."""
        limits = self.parameters
        return [limits.min_speed, -limits.max_steering_angle], [limits.max_speed, limits.max_steering_angle]

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Drive forwards at the desired speed, as turning requires it, and steer to reduce the heading error."""
        speed, error = self.aim(state, velocity)
        followed = np.empty((len(state), 2))
        followed[:, 0] = speed
        followed[:, 1] = np.arctan2(self.wheelbase * self.parameters.steering_gain * error, speed)
        return followed
