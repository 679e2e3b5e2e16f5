"""The kinematic bicycle: a car at low speed with front-wheel steering and without slip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from symaware_cli.core import Parameters, Quantity
from symaware_cli.models.heading import HeadingModel
from symaware_cli.models.noise import Deviation

Array = NDArray[np.float64]


class Bicycle(HeadingModel):
    """A car with a speed v and a steering angle s: x' = v cos(heading), y' = v sin(heading), heading' = v tan(s) / L.

    L is the wheelbase, and the position is that of the rear axle, which does not slip (S. M. LaValle, Planning
    Algorithms, 2006, section 13.1.2.1). The closed form is an arc of radius L / tan(s). It cannot turn on the spot, and
    the tightest circle it can follow has the radius wheelbase / tan(max_steering_angle).
    """

    batchable = True

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))
    control_input = (Quantity("speed", "m/s"), Quantity("steering_angle", "rad"))
    heading = 2
    angles = (2,)

    class Parameters(Parameters):
        """Dimensions and limits of the bicycle."""

        wheelbase: float = Field(0.5, gt=0, description="Distance between the axles [m].")
        min_speed: float = Field(0.0, description="Least speed [m/s]; negative to drive backwards.")
        max_speed: float = Field(1.0, gt=0, description="Greatest speed [m/s].")
        max_steering_angle: float = Field(
            0.6, gt=0, lt=1.57, description="Greatest angle of the front wheel to either side [rad]."
        )
        steering_gain: float = Field(
            4.0, gt=0, description="Turn rate for each radian between the heading and the wanted direction [1/s]."
        )
        process_noise: Deviation = None

        @model_validator(mode="after")
        def _speeds_in_order(self) -> Bicycle.Parameters:
            if self.min_speed > self.max_speed:
                raise ValueError(f"`min_speed` {self.min_speed:g} lies above `max_speed` {self.max_speed:g}")
            return self

    @property
    def wheelbase(self) -> float:
        """The distance between the axles [m]."""
        return float(self.parameters.wheelbase)

    def motion(self, control_input: Any, math: Any) -> tuple[Any, Any]:
        """Return v and v tan(s) / L."""
        speed = control_input[0]
        return speed, speed * math.tan(control_input[1]) / self.parameters.wheelbase

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of speed and steering angle."""
        limits = self.parameters
        return [limits.min_speed, -limits.max_steering_angle], [limits.max_speed, limits.max_steering_angle]

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Drive forwards at the desired speed, as turning requires it, and steer to reduce the heading error."""
        speed, error = self.aim(state, velocity)
        followed = np.empty((len(state), 2))
        followed[:, 0] = speed
        followed[:, 1] = np.arctan2(self.parameters.wheelbase * self.parameters.steering_gain * error, speed)
        return followed

    def slowed(self, state: Array, control_input: Array, factor: Array) -> Array:
        """Scale the speed; with the same steering angle the path stays the same."""
        return super().slowed(state, control_input, factor)
