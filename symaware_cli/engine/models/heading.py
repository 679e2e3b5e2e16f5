"""Base classes of vehicles that move along their heading, and of cars among them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import numpy as np

from symaware_cli.core import Model, Quantity
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.geometry import Array, compiled, wrapped
from symaware_cli.world import columns, rows

#: Without axes, as an operation on few elements takes half as long again if it has to convert a `float`.
_SLOWEST, _ZERO = np.array(1e-9), np.array(0.0)


class SpeedLimits(Protocol):
    """Parameters with a least and a greatest speed [m/s]."""

    min_speed: float
    max_speed: float


Limits = TypeVar("Limits", bound=SpeedLimits)


def sinc(angle: Any, math: Any) -> Any:
    """Return sin(angle) / angle, 1 at 0; for arrays and symbols.

    The quotient is accurate down to the smallest angles, so for numbers only 0 itself needs care. Its derivatives,
    which CasADi computes term by term, are not: for symbols, angles under 0.1 use the power series, with an error of
    3e-18 there.
    """
    if math is np:
        if np.count_nonzero(angle) < np.size(angle):  # several times as fast as adding zeros
            angle = angle + 1e-300 * (angle == 0.0)
        return np.sin(angle) / angle
    square = angle * angle
    small = square < 0.01
    series = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0)))
    elsewhere = math.if_else(small, 1.0, angle)
    return math.if_else(small, series, math.sin(elsewhere) / elsewhere)


def _arc_end(x: Any, y: Any, heading: Any, speed: Any, turn_rate: Any, step: Any, math: Any) -> Sequence[Any]:
    """Return x, y and heading after a step with a constant speed and turn rate; for arrays and symbols."""
    half = (0.5 * step) * turn_rate
    chord = step * speed * sinc(half, math)
    towards = heading + half
    return x + chord * math.cos(towards), y + chord * math.sin(towards), heading + step * turn_rate


@compiled
def arc_ends(state: Array, control_input: Array, step: float) -> Array:
    """Return the states (x, y, heading) after a step [s] with speeds and turn rates; (n, 3) and (n, 2) to (n, 3)."""
    pose, given = columns(state), columns(control_input)
    # Twice as fast as unpacking arrays.
    return rows(_arc_end(pose[0], pose[1], pose[2], given[0], given[1], step, np), len(state))


@compiled
def aimed(state: Array, velocity: Array, heading: int) -> tuple[Array, Array]:
    """Return speeds and heading errors, as `HeadingModel.aim`, where the states have the heading in a column."""
    axes = columns(velocity)
    x, y = axes[0], axes[1]  # twice as fast as unpacking an array
    speed = np.sqrt(x * x + y * y)
    error = wrapped(np.arctan2(y, x) - state[:, heading])
    moving = speed > _SLOWEST
    return speed, error if np.count_nonzero(moving) == len(moving) else np.where(moving, error, 0.0)


@compiled
def steered(speed: Array, error: Array, gain: float) -> Array:
    """Return the speed along the heading and the turn rate, from speeds and heading errors (n,); shape (n, 2)."""
    followed = np.empty((len(speed), 2))
    np.multiply(speed, np.maximum(np.cos(error), _ZERO), out=followed[:, 0])
    np.multiply(error, gain, out=followed[:, 1])
    return followed


def speeds_in_order(limits: Limits) -> Limits:
    """Check that the least speed in parameters does not lie above the greatest; for pydantic's `model_validator`."""
    if limits.min_speed > limits.max_speed:
        raise ValueError(f"`min_speed` {limits.min_speed:g} lies above `max_speed` {limits.max_speed:g}")
    return limits


class HeadingModel(NoisyModel):
    """A vehicle with a speed v along its heading and a turn rate w.

    Its motion is x' = v cos(heading), y' = v sin(heading), heading' = w.

    With constant v and w it moves along an arc. The chord of the arc has the length v step sinc(w step / 2) and the
    direction heading + w step / 2, which is exact for every w, 0 included, without cancellation near 0. (The usual
    form divides the difference of two sines by w, which cancels.)

    The heading is never wrapped; it counts turns.
    """

    heading: int = 2
    goes_ahead = True
    angles: tuple[int, ...] = (2,)

    @abstractmethod
    def motion(self, control_input: Any, math: Any) -> tuple[Any, Any]:
        """Return the speed [m/s] and the turn rate [rad/s] under a control input, for arrays and symbols."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return x' = v cos(heading), y' = v sin(heading), heading' = w."""
        heading = state[self.heading]
        speed, turn_rate = self.motion(control_input, math)
        return (speed * math.cos(heading), speed * math.sin(heading), turn_rate)

    def successor(self, state: Any, control_input: Any, step: Any, math: Any) -> Sequence[Any]:
        """Return the end of the arc."""
        return _arc_end(state[0], state[1], state[self.heading], *self.motion(control_input, math), step, math)

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return the derivative of the velocity by the heading; all else is zero."""
        jacobian = np.zeros((len(state), len(self.state), len(self.state)))
        velocity = self.velocity(state, control_input)
        jacobian[:, 0, self.heading] = -velocity[:, 1]
        jacobian[:, 1, self.heading] = velocity[:, 0]
        return jacobian

    def slowed(self, state: Array, control_input: Array, factor: Array) -> Array:
        """Scale the speed; other inputs are unchanged, so the vehicle can still turn away."""
        slowed = control_input.copy()
        slowed[:, 0] *= factor
        return slowed

    def aim(self, state: Array, velocity: Array) -> tuple[Array, Array]:
        """Return the desired speed and the heading error for a desired velocity.

        Args:
            state: The states; shape (n, nx).
            velocity: The desired velocities [m/s]; shape (n, d); only the components in the plane count.

        Returns:
            The desired speed in the plane [m/s], and the angle from the heading to the desired direction, in
            [-pi, pi) [rad] and 0 for speed 0; each of shape (n,).
        """
        return aimed(state, velocity, self.heading)


class TurningModel(HeadingModel):
    """A vehicle whose control inputs are its speed v and its turn rate w.

    Its parameters have the ``steering_gain``.
    """

    control_input = (Quantity("speed", "m/s"), Quantity("turn_rate", "rad/s"))

    def motion(self, control_input: Any, math: Any) -> tuple[Any, Any]:
        """Return the control input itself."""
        return control_input[0], control_input[1]

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Turn towards the desired direction, at the component of the speed along the heading."""
        return steered(*self.aim(state, velocity), self.parameters.steering_gain)

    def exact_step(self, state: Array, control_input: Array, step: float) -> Array | None:
        """Advance states by `successor`."""
        own = type(self)
        if own.successor is HeadingModel.successor and own.motion is TurningModel.motion:
            return arc_ends(state, control_input, step)
        return super().exact_step(state, control_input, step)


class LaggedModel(HeadingModel):
    """A vehicle whose speed is the fourth element of its state, after x, y and heading, and follows its set point."""

    def successor(  # type: ignore[override]
        self, state: Any, control_input: Any, step: Any, math: Any
    ) -> None:
        """Return None: the model has no closed form."""
        return

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return the Jacobian by central differences."""
        return Model.jacobian(self, state, control_input)

    def velocity(self, state: Array, control_input: Array) -> Array:
        """Return the velocity along the heading, with the speed in the state."""
        heading, speed = state[:, 2].copy(), state[:, 3].copy()
        return np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=1)


class SteeredModel(HeadingModel):
    """A car with a speed v and a steering angle s, which turns at v tan(s) / L, where L is the wheelbase.

    Its parameters are the limits ``min_speed``, ``max_speed`` and ``max_steering_angle``, and ``steering_gain``.
    """

    control_input = (Quantity("speed", "m/s"), Quantity("steering_angle", "rad"))

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
