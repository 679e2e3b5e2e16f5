"""The unicycle: moves along its heading and turns on the spot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.core import Parameters, Quantity
from symaware_cli.engine.models.heading import HeadingModel, speeds_in_order
from symaware_cli.engine.models.noise import Deviation
from symaware_cli.geometry import Array


class Unicycle(HeadingModel):
    """A vehicle with a speed v and a turn rate w: x' = v cos(heading), y' = v sin(heading), heading' = w.

    The closed form is an arc.
    """

    batchable = True

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))
    control_input = (Quantity("speed", "m/s"), Quantity("turn_rate", "rad/s"))

    class Parameters(Parameters):
        """Limits of the unicycle."""

        min_speed: float = Field(0.0, description="Least speed [m/s]; negative to drive backwards.")
        max_speed: float = Field(1.0, gt=0, description="Greatest speed [m/s].")
        max_turn_rate: float = Field(2.0, gt=0, description="Greatest turn rate to either side [rad/s].")
        steering_gain: float = Field(
            4.0, gt=0, description="Turn rate for each radian between the heading and the wanted direction [1/s]."
        )
        process_noise: Deviation = None

        _speeds_in_order = model_validator(mode="after")(speeds_in_order)

    def motion(self, control_input: Any, math: Any) -> tuple[Any, Any]:
        """Return the control input itself."""
        return control_input[0], control_input[1]

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of speed and turn rate."""
        limits = self.parameters
        return [limits.min_speed, -limits.max_turn_rate], [limits.max_speed, limits.max_turn_rate]

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Turn towards the desired direction, at the component of the speed along the heading."""
        speed, error = self.aim(state, velocity)
        followed = np.empty((len(state), 2))
        np.multiply(speed, np.maximum(np.cos(error), 0.0), out=followed[:, 0])
        np.multiply(self.parameters.steering_gain, error, out=followed[:, 1])
        return followed
