"""An inertial measurement unit (IMU): the specific force and angular rates of an agent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from symaware_cli.awareness import MEASUREMENT
from symaware_cli.core import AgentGroup, Quantity, Signal
from symaware_cli.engine.components.sensor import Sensor, SensorParameters
from symaware_cli.geometry import Array

QUANTITIES = (
    *(Quantity(f"acceleration_{axis}", "m/s^2") for axis in "xyz"),
    *(Quantity(f"rate_{axis}", "rad/s") for axis in "xyz"),
)


class InertialUnit(Sensor):
    """Measures the specific force and the angular rates along the axes of the body.

    The specific force is the acceleration less that of gravity: an agent at rest on Earth measures 9.81 m/s^2 upwards.
    Both are means over the time since the previous turn, as in a unit that integrates. At the first turn the reading is
    therefore that of an agent with constant velocity.

    The axes of the body are those of its attitude if the model has one (`angles`), else those of its heading; x points
    forwards, z upwards. The unit is at the position of the agent.

    Errors are a bias, drawn once for each axis and agent, and normal errors that are independent of each other.

    It records its measurements as a signal under its own name, and updates nothing else.
    """

    signals = (Signal(MEASUREMENT, "vector", QUANTITIES, description="as measured", nan="the measurement was missed"),)

    class Parameters(SensorParameters):
        """Parameters of the unit."""

        gravity: float | None = Field(
            None,
            ge=0,
            le=1e3,
            description="Acceleration of gravity, straight down [m/s^2]. If null, it is that of the world; where that "
            "has none, that of the model; or else 9.81.",
        )
        acceleration_noise: float = Field(0.0, ge=0, description="Standard deviation of accelerations [m/s^2].")
        rate_noise: float = Field(0.0, ge=0, description="Standard deviation of angular rates [rad/s].")
        acceleration_bias: float = Field(
            0.0, ge=0, description="Standard deviation of the bias of accelerations [m/s^2]."
        )
        rate_bias: float = Field(0.0, ge=0, description="Standard deviation of the bias of angular rates [rad/s].")

    def initialise_component(self, group: AgentGroup) -> None:
        """Draw the biases, and determine gravity."""
        super().initialise_component(group)
        parameters = self.parameters
        self._gravity = np.array(self._gravity_vector())
        self._bias = np.zeros((len(group), 6))
        if parameters.acceleration_bias or parameters.rate_bias:
            deviations = np.repeat([parameters.acceleration_bias, parameters.rate_bias], 3)
            self._bias = deviations * self.random.standard_normal(6, "bias")

    def present(self) -> tuple[int, Array, Array]:
        """Return the present instant, velocities and attitudes."""
        return self.now, self._velocities(), self._attitudes()

    def measure(self, present: tuple[int, Array, Array]) -> Array:
        """Measure by comparing the present motion with that at the previous turn; shape (n, 6)."""
        parameters, count = self.parameters, len(self._group)
        _, velocities, attitudes = present
        values = np.zeros((count, 6))
        acceleration = np.zeros((count, 3))
        if self._before is not None and self._before[0] < self.now:
            then, velocities_then, attitudes_then = self._before
            passed = (self.now - then) / 1e9
            acceleration = (velocities - velocities_then) / passed
            values[:, 3:] = rotation_vectors(np.swapaxes(attitudes_then, 1, 2) @ attitudes) / passed
        acceleration -= self._gravity
        values[:, :3] = np.einsum("nij,ni->nj", attitudes, acceleration)
        values += self._bias
        if parameters.acceleration_noise or parameters.rate_noise:
            deviations = np.repeat([parameters.acceleration_noise, parameters.rate_noise], 3)
            values += deviations * self.random.standard_normal(6, "noise")
        return self.with_dropouts(values)

    def _gravity_vector(self) -> Sequence[float]:
        """Return the acceleration of gravity [x, y, z] [m/s^2]."""
        given, world = self.parameters.gravity, self.environment.gravity
        if given is None and world is not None:
            return world
        return 0.0, 0.0, -(getattr(self._group.model.parameters, "gravity", 9.81) if given is None else given)

    def _velocities(self) -> Array:
        """Return the true velocities of the agents [m/s]; shape (n, 3)."""
        known = self.environment.snapshot().velocities[self._start : self._start + len(self._group)]
        velocities = np.zeros((len(known), 3))
        velocities[:, : known.shape[1]] = known
        return velocities

    def _attitudes(self) -> Array:
        """Return the true attitudes of the agents as rotations from the body to the world; shape (n, 3, 3)."""
        model, state = self._group.model, self.environment.snapshot().states[self._number]
        nothing = np.zeros(len(state))
        angles = getattr(model, "angles", ())
        if len(angles) == 3:
            return rotations(*(state[:, angle] for angle in angles))
        return rotations(nothing, nothing, nothing if model.heading is None else state[:, model.heading])


def rotations(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Return rotations from the body to the world, first about z, then y, then x; (n,) each to (n, 3, 3)."""
    (a, b), (c, d), (e, f) = ((np.cos(angle), np.sin(angle)) for angle in (roll, pitch, yaw))
    rows = (
        (e * c, e * d * b - f * a, e * d * a + f * b),
        (f * c, f * d * b + e * a, f * d * a - e * b),
        (-d, c * b, c * a),
    )
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def rotation_vectors(turned: Array) -> Array:
    """Return the rotation vectors (axis times angle [rad], below pi) of rotations (n, 3, 3); shape (n, 3)."""
    sines = 0.5 * np.stack(
        [
            turned[:, 2, 1] - turned[:, 1, 2],
            turned[:, 0, 2] - turned[:, 2, 0],
            turned[:, 1, 0] - turned[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.sqrt((sines * sines).sum(axis=1))
    angle = np.arctan2(sine, 0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0))
    return sines * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0)[:, None]
