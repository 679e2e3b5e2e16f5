"""Single and double integrators: points with a velocity or an acceleration as control input."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from symaware_cli.core import Parameters, Quantity
from symaware_cli.engine.models.noise import Deviation, NoisyModel
from symaware_cli.geometry import Array, lengths

_AXES = ("x", "y", "z")
_DIMENSIONS = "Whether it moves in the plane or in space: 2 or 3."


def _positions(dimensions: int) -> tuple[Quantity, ...]:
    return tuple(Quantity(axis, "m") for axis in _AXES[:dimensions])


def _vector(name: str, unit: str, dimensions: int) -> tuple[Quantity, ...]:
    return tuple(Quantity(f"{name}_{axis}", unit) for axis in _AXES[:dimensions])


def shortened(vectors: Array, longest: float | None) -> Array:
    """Limit the length of vectors; their direction stays.

    Args:
        vectors: The vectors; shape (n, d).
        longest: The greatest Euclidean length; None for no limit, which returns the vectors themselves.
    """
    if longest is None:
        return vectors
    scale: Array = longest / np.maximum(lengths(vectors), longest)
    return vectors * scale[:, None]


class SingleIntegrator(NoisyModel):
    """A point whose control input is its velocity: p' = u.

    The closed form is p+ = p + u step. The limit is on the length of the velocity, not on its elements.
    """

    batchable = True

    state = _positions(2)
    control_input = _vector("velocity", "m/s", 2)

    class Parameters(Parameters):
        """Limits of the single integrator."""

        dimensions: Literal[2, 3] = Field(2, description=_DIMENSIONS)
        max_speed: float | None = Field(
            None, gt=0, description="Greatest speed, in any direction [m/s]; no limit if null."
        )
        process_noise: Deviation = None

    def _declare(self) -> None:
        dimensions = self.parameters.dimensions
        self.state = _positions(dimensions)
        self.control_input = _vector("velocity", "m/s", dimensions)
        self.position = tuple(range(dimensions))

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return p' = u."""
        return tuple(control_input[axis] for axis in self.position)

    def successor(self, state: Any, control_input: Any, step: Any, math: Any) -> Sequence[Any]:
        """Return p+ = p + u step."""
        return tuple(state[axis] + step * control_input[axis] for axis in self.position)

    def exact_step(self, state: Array, control_input: Array, step: float) -> Array:
        """Evaluate `successor` for whole arrays at once, which costs a quarter for few agents."""
        return state + step * control_input

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return zeros: the velocity does not depend on the state."""
        return np.zeros((len(state), len(self.state), len(self.state)))

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the greatest speed along each axis; `limit` is stricter, as it bounds the length."""
        return _box(self.parameters.max_speed, len(self.control_input))

    def limit(self, control_input: Array) -> Array:
        """Limit the length of velocities; their direction stays."""
        return shortened(control_input, self.parameters.max_speed)

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Return the velocity itself."""
        return velocity

    def slowed(self, state: Array, control_input: Array, factor: Array) -> Array:
        """Scale the velocity."""
        return control_input * factor[:, None]


class DoubleIntegrator(NoisyModel):
    """A point whose control input is its acceleration: p' = v, v' = a.

    The closed form is p+ = p + v step + a step^2 / 2 and v+ = v + a step. The limit is on the length of the
    acceleration. The speed is part of the state, so saturating control inputs cannot bound it: ``max_speed`` limits the
    velocities that the point is asked to follow, and has no effect on a controller that sets accelerations itself.
    """

    batchable = True

    state = (*_positions(2), *_vector("velocity", "m/s", 2))
    control_input = _vector("acceleration", "m/s^2", 2)

    class Parameters(Parameters):
        """Limits of the double integrator."""

        dimensions: Literal[2, 3] = Field(2, description=_DIMENSIONS)
        max_acceleration: float | None = Field(
            None, gt=0, description="Greatest acceleration, in any direction [m/s^2]; no limit if null."
        )
        max_speed: float | None = Field(
            None,
            gt=0,
            description="Greatest speed that it follows when it is steered by a velocity [m/s]; no limit if null.",
        )
        velocity_gain: float = Field(
            2.0, gt=0, description="Acceleration for each m/s between the velocity and the wanted one [1/s]."
        )
        process_noise: Deviation = None

    def _declare(self) -> None:
        dimensions = self.parameters.dimensions
        self.state = (*_positions(dimensions), *_vector("velocity", "m/s", dimensions))
        self.control_input = _vector("acceleration", "m/s^2", dimensions)
        self.position = tuple(range(dimensions))
        self.velocities = tuple(range(dimensions, 2 * dimensions))

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return p' = v, v' = a."""
        count = len(self.position)
        return (*(state[count + axis] for axis in self.position), *(control_input[axis] for axis in self.position))

    def successor(self, state: Any, control_input: Any, step: Any, math: Any) -> Sequence[Any]:
        """Return p+ = p + v step + a step^2 / 2, v+ = v + a step."""
        count = len(self.position)
        return (
            *(
                state[axis] + step * (state[count + axis] + (0.5 * step) * control_input[axis])
                for axis in self.position
            ),
            *(state[count + axis] + step * control_input[axis] for axis in self.position),
        )

    def velocity(self, state: Array, control_input: Array) -> Array:
        """Return the velocity in the state."""
        return state[:, len(self.position) :].copy()

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return ones where a position depends on its velocity."""
        count = len(self.position)
        jacobian = np.zeros((len(state), 2 * count, 2 * count))
        jacobian[:, self.position, np.arange(count, 2 * count)] = 1.0
        return jacobian

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the greatest acceleration along each axis; `limit` is stricter, as it bounds the length."""
        return _box(self.parameters.max_acceleration, len(self.control_input))

    def limit(self, control_input: Array) -> Array:
        """Limit the length of accelerations; their direction stays."""
        return shortened(control_input, self.parameters.max_acceleration)

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Accelerate in proportion to the velocity error, with the desired velocity limited to the greatest speed."""
        wanted = shortened(velocity, self.parameters.max_speed)
        followed: Array = self.parameters.velocity_gain * (wanted - state[:, len(self.position) :])
        return followed

    def slowed(self, state: Array, control_input: Array, factor: Array) -> Array:
        """Blend the acceleration with braking: at factor 0 the point comes to rest, at 1 nothing changes.

        For a point that follows a velocity, this equals following that fraction of it.
        """
        part = factor[:, None]
        braking = self.parameters.velocity_gain * state[:, len(self.position) :]
        slowed: Array = part * control_input - (1.0 - part) * braking
        return slowed


def _box(limit: float | None, count: int) -> tuple[Sequence[float], Sequence[float]]:
    bound = np.inf if limit is None else limit
    return [-bound] * count, [bound] * count
