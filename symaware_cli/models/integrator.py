"""Integrators: points that go where they are told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import Model, Parameters, Quantity

Array = NDArray[np.float64]


class SingleIntegrator(Model):
    """A point whose control input is its velocity: p' = u."""

    state = (Quantity("x", "m"), Quantity("y", "m"))
    control_input = (Quantity("velocity_x", "m/s"), Quantity("velocity_y", "m/s"))

    class Parameters(Parameters):
        """Limits of the single integrator."""

        max_speed: float | None = Field(
            None, gt=0, description="Greatest speed, in any direction [m/s]; no limit if null."
        )

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """P' = u."""
        return (control_input[0], control_input[1])

    def limit(self, control_input: Array) -> Array:
        """Shorten velocities that are too long; their direction stays."""
        if self.parameters.max_speed is None:
            return control_input
        speed = np.sqrt(np.einsum("ij,ij->i", control_input, control_input))
        scale = self.parameters.max_speed / np.maximum(speed, self.parameters.max_speed)
        limited: Array = control_input * scale[:, None]
        return limited

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """The velocity itself."""
        return velocity
