"""The kinematic bicycle: a car at low speed with front-wheel steering and without slip."""

from __future__ import annotations

from pydantic import Field, model_validator

from symaware_cli.core import Parameters, Quantity
from symaware_cli.engine.models.heading import SteeredModel, speeds_in_order
from symaware_cli.engine.models.noise import Deviation


class Bicycle(SteeredModel):
    """A car with a speed v and a steering angle s: x' = v cos(heading), y' = v sin(heading), heading' = v tan(s) / L.

    L is the wheelbase, and the position is that of the rear axle, which does not slip (S. M. LaValle, Planning
    Algorithms, 2006, section 13.1.2.1). The closed form is an arc of radius L / tan(s). It cannot turn on the spot, and
    the tightest circle it can follow has the radius wheelbase / tan(max_steering_angle).
    """

    batchable = True

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))

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

        _speeds_in_order = model_validator(mode="after")(speeds_in_order)

    @property
    def wheelbase(self) -> float:
        """The distance between the axles [m]."""
        return float(self.parameters.wheelbase)
