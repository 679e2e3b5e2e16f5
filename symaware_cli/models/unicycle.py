"""The unicycle: it rolls where it points, and turns on the spot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import Model, Parameters, Quantity

Array = NDArray[np.float64]


class Unicycle(Model):
    """A vehicle with a speed v and a turn rate w: x' = v cos(heading), y' = v sin(heading), heading' = w."""

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))
    control_input = (Quantity("speed", "m/s"), Quantity("turn_rate", "rad/s"))
    heading = 2
    angles = (2,)

    class Parameters(Parameters):
        """Limits of the unicycle."""

        min_speed: float = Field(0.0, description="Least speed [m/s]; negative to drive backwards.")
        max_speed: float = Field(1.0, gt=0, description="Greatest speed [m/s].")
        max_turn_rate: float = Field(2.0, gt=0, description="Greatest turn rate to either side [rad/s].")
        steering_gain: float = Field(
            4.0, gt=0, description="Turn rate for each radian between the heading and the wanted direction [1/s]."
        )

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """X' = v cos(heading), y' = v sin(heading), heading' = w."""
        heading = state[2]
        speed, turn_rate = control_input[0], control_input[1]
        return (speed * math.cos(heading), speed * math.sin(heading), turn_rate)

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Speed within its limits; turn rate within its limit to either side."""
        limits = self.parameters
        return [limits.min_speed, -limits.max_turn_rate], [limits.max_speed, limits.max_turn_rate]

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Turn towards the wanted direction, and roll at the part of the speed that already points there."""
        direction = np.arctan2(velocity[:, 1], velocity[:, 0])
        speed = np.sqrt(np.einsum("ij,ij->i", velocity, velocity))
        error = np.remainder(direction - state[:, 2] + np.pi, 2 * np.pi) - np.pi
        followed = np.empty((len(state), 2))
        followed[:, 0] = speed * np.maximum(np.cos(error), 0.0)
        followed[:, 1] = np.where(speed > 1e-9, self.parameters.steering_gain * error, 0.0)
        return followed
