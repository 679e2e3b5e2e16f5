"""The Dubins aircraft: a limited turn rate and a minimum speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.core import Parameters, Quantity
from symaware_cli.engine.models.heading import HeadingModel
from symaware_cli.engine.models.noise import Deviation
from symaware_cli.geometry import Array

_PLANE: tuple[Quantity, ...] = (Quantity("x", "m"), Quantity("y", "m"))
_HEADING = Quantity("heading", "rad")
_INPUTS: tuple[Quantity, ...] = (Quantity("speed", "m/s"), Quantity("turn_rate", "rad/s"))


class DubinsAircraft(HeadingModel):
    """An aircraft with a speed v and a turn rate w: x' = v cos(heading), y' = v sin(heading), heading' = w.

    In space, z' is its climb rate, and v the speed over ground (H. Chitsaz and S. M. LaValle, "Time-optimal paths for a
    Dubins airplane", CDC 2007). Its speed is saturated between ``min_speed`` and ``max_speed``, so no control input
    stops it; at a constant speed v, the tightest circle has the radius v / max_turn_rate. The closed form is an arc or
    a helix.
    """

    batchable = True

    state = (*_PLANE, _HEADING)
    control_input = _INPUTS

    class Parameters(Parameters):
        """Limits of the aircraft."""

        dimensions: Literal[2, 3] = Field(2, description="Whether it keeps its altitude or climbs too: 2 or 3.")
        min_speed: float = Field(gt=0, description="Least speed over ground [m/s].")
        max_speed: float = Field(gt=0, description="Greatest speed over ground [m/s].")
        max_turn_rate: float = Field(gt=0, description="Greatest turn rate to either side [rad/s].")
        max_climb_rate: float | None = Field(
            None, gt=0, description="Greatest climb rate, up and down [m/s]; no limit if null, and only in space."
        )
        steering_gain: float = Field(
            1.0, gt=0, description="Turn rate for each radian between the heading and the wanted direction [1/s]."
        )
        process_noise: Deviation = None

        @model_validator(mode="after")
        def _limits_fit(self) -> DubinsAircraft.Parameters:
            if self.min_speed > self.max_speed:
                raise ValueError(f"`min_speed` {self.min_speed:g} lies above `max_speed` {self.max_speed:g}")
            if self.max_climb_rate is not None and self.dimensions == 2:
                raise ValueError("`max_climb_rate` needs `dimensions` 3")
            return self

    def _declare(self) -> None:
        if self.parameters.dimensions == 3:
            self.state = (*_PLANE, Quantity("z", "m"), _HEADING)
            self.control_input = (*_INPUTS, Quantity("climb_rate", "m/s"))
            self.position = (0, 1, 2)
            self.heading = 3
            self.angles = (3,)

    def motion(self, control_input: Any, math: Any) -> tuple[Any, Any]:
        """Return the first two control inputs."""
        return control_input[0], control_input[1]

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return x' = v cos(heading), y' = v sin(heading), in space z' = climb rate, heading' = w."""
        x, y, heading = super().derivative(state, control_input, math)
        return (x, y, heading) if self.heading == 2 else (x, y, control_input[2], heading)

    def successor(self, state: Any, control_input: Any, step: Any, math: Any) -> Sequence[Any]:
        """Return the end of the arc, and in space the altitude there."""
        x, y, heading = super().successor(state, control_input, step, math)
        return (x, y, heading) if self.heading == 2 else (x, y, state[2] + step * control_input[2], heading)

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the limits of speed, turn rate and climb rate."""
        limits = self.parameters
        low, high = [limits.min_speed, -limits.max_turn_rate], [limits.max_speed, limits.max_turn_rate]
        if limits.dimensions == 3:
            climb = np.inf if limits.max_climb_rate is None else limits.max_climb_rate
            low.append(-climb)
            high.append(climb)
        return low, high

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Turn towards the desired direction at the nearest feasible speed; straight on without a direction."""
        limits = self.parameters
        speed, error = self.aim(state, velocity)
        followed = np.empty((len(state), len(self.control_input)))
        followed[:, 0] = np.minimum(np.maximum(speed, limits.min_speed), limits.max_speed)
        followed[:, 1] = limits.steering_gain * error
        if limits.dimensions == 3:
            followed[:, 2] = velocity[:, 2]
        return followed
