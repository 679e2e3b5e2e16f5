"""The unicycle: moves along its heading and turns on the spot."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field, model_validator

from symaware_cli.core import Parameters, Quantity
from symaware_cli.engine.models.heading import TurningModel, speeds_in_order
from symaware_cli.engine.models.noise import Deviation


class Unicycle(TurningModel):
    """A vehicle with a speed v and a turn rate w: x' = v cos(heading), y' = v sin(heading), heading' = w.

    The closed form is an arc.
    """

    batchable = True

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))

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

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of speed and turn rate."""
        limits = self.parameters
        return [limits.min_speed, -limits.max_turn_rate], [limits.max_speed, limits.max_turn_rate]
