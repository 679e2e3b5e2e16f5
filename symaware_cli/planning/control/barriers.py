"""Control barrier functions of discs in the plane: linear constraints on control inputs that keep distances.

The barrier of two bodies is h = d - D, with the distance d of two points and the distance D to keep: the set h >= 0 is
to stay invariant (A. D. Ames, X. Xu, J. W. Grizzle, P. Tabuada, "Control barrier function based quadratic programs for
safety critical systems", IEEE Transactions on Automatic Control 62, 2017). Two agents that both keep it take half of
the constraint each (L. Wang, A. D. Ames, M. Egerstedt, "Safety barrier certificates for collisions-free multirobot
systems", IEEE Transactions on Robotics 33, 2017).

Control inputs are held for a time T, so constraints that hold at an instant must suffice until the next. The margins
here are those of local bounds on the curvature of h (J. Breeden, K. Garg, D. Panagou, "Control barrier functions in
sampled-data systems", IEEE Control Systems Letters 6, 2022), made small by convexity: d is a convex function of the
relative position, so it is never less than its linearisation, d0 + n . (change of the relative position), with the unit
vector n at the instant.

All arithmetic is elementwise, so no bit of a row depends on other rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from symaware_cli.core import AgentGroup, Model
from symaware_cli.engine import dot
from symaware_cli.geometry import Array, Indices, Mask

#: The number of sides of the polygon within the disc of allowed control inputs.
_SIDES = 32


@dataclass(frozen=True, slots=True)
class Encounters:
    """Pairs of an agent and another body, in columns.

    Attributes:
        row: The agent, as a row of its group; shape (m,).
        normal: The unit vector from the other's nearest point to the agent's point; shape (2, m).
        distance: The distance of both points, negative within an obstacle [m]; shape (m,).
        keep: The distance to keep [m]; shape (m,).
        velocity: The velocity of the other's point [m/s]; shape (2, m).
        shared: Whether the other does its half; shape (m,).
    """

    row: Indices
    normal: Array
    distance: Array
    keep: Array
    velocity: Array
    shared: Mask

    @property
    def barrier(self) -> Array:
        """The values of the barrier functions [m]; shape (m,)."""
        return self.distance - self.keep


class PointMotion(ABC):
    """The motion of the point of an agent from which distances are kept, as a function of the control input.

    Attributes:
        ahead: The distance of the point ahead of the agent's position, along its heading [m]. A disc around the point
            contains the disc around the position if its radius is larger by this.
        metric: The cost of a control input: a quadratic form of its difference from the requested one; shape (nu, nu).
        limits: Allowed control inputs u: rows a of a . u <= b, and b >= 0; shapes (k, nu) and (k,).
        margin: The increase of each `limit` because the input is held [m/s]; times s^2 for inputs within s times the
            limits.
    """

    ahead = 0.0
    margin = 0.0

    def __init__(self, model: Model, gain: float, hold: float) -> None:
        """Take the limits from the model.

        Args:
            model: The model.
            gain: The part of the barrier that may be used up in a second [1/s].
            hold: The time for which a control input is held [s].
        """
        self.gain = min(gain, 1.0 / hold)
        self.hold = hold
        self.metric: Array = np.eye(2)
        self.greatest = greatest_length(model)
        self.limits: tuple[Array, Array] = np.empty((0, 2)), np.empty(0)
        if np.isfinite(self.greatest):
            # A polygon within the disc of allowed inputs.
            angles = np.arange(_SIDES) * (2.0 * np.pi / _SIDES)
            sides = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            self.limits = sides, np.full(_SIDES, self.greatest * np.cos(np.pi / _SIDES))

    def points(self, state: Array, position: Array) -> Array:
        """Return the points of agents, from states (n, nx) and positions (n, 2)."""
        return position

    def along(self, directions: Array, rows: Indices, state: Array) -> Array:
        """Return a for each direction, so that a . u is how fast u moves, or accelerates, the point along it.

        Args:
            directions: Unit vectors in the plane; shape (2, m).
            rows: The agent of each; shape (m,).
            state: The states of the agents of the group; shape (n, nx).

        Returns:
            Shape (m, nu).
        """
        return directions.T

    def fastest(self, rows: Array) -> Array:
        """Return at least the greatest a . u of any allowed u, for rows a; (m, nu) to (m,)."""
        return self.greatest * np.sqrt(dot(rows.T, rows.T))

    @abstractmethod
    def limit(self, encounters: Encounters, state: Array) -> Array:
        """Return the least a . u, with a along the normals, that keeps each barrier; shape (m,)."""


class VelocityInput(PointMotion):
    """p' = u: n . (u - v) >= -gain h, with the other's velocity v.

    By convexity this holds h >= 0 for the whole time T, if gain T <= 1: no margin is needed.
    """

    def limit(self, encounters: Encounters, state: Array) -> Array:
        """Return the least velocity along n: -gain h plus the other's velocity; half of -gain h if both avoid."""
        allowed = -self.gain * encounters.barrier
        return np.where(encounters.shared, 0.5 * allowed, allowed + dot(encounters.normal, encounters.velocity))


class HeadingInput(VelocityInput):
    """A unicycle with u = (speed, turn rate), by a point at a distance l ahead of its axle: p' = R diag(1, l) u.

    The least velocity is that of `VelocityInput`, without the margin. The point moves on an arc instead of a line, off
    by at most T^2 |p''| / 2, with |p''| = |turn rate| |p'|. So the margin is T max |p''| / 2.
    """

    def __init__(self, model: Model, gain: float, hold: float, ahead: float) -> None:
        """Take the limits from the model; see `PointMotion`.

        Args:
            model: The model.
            gain: As in `PointMotion`.
            hold: As in `PointMotion`.
            ahead: How far the point is ahead [m].
        """
        super().__init__(model, gain, hold)
        self.ahead = ahead
        self.metric = np.diag([1.0, ahead * ahead])
        low, high = (np.array(each, float) for each in model.input_bounds())
        self.limits = np.concatenate([np.eye(2), -np.eye(2)]), np.concatenate([high, -low])
        speed, turn = np.maximum(np.abs(low), np.abs(high)).tolist()
        self._extremes = speed, turn
        self.margin = 0.5 * hold * turn * float(np.hypot(speed, ahead * turn))
        assert model.heading is not None
        self._heading = model.heading

    def points(self, state: Array, position: Array) -> Array:
        """Return the points ahead of the axles."""
        heading = state[:, self._heading]
        return position + self.ahead * np.stack([np.cos(heading), np.sin(heading)], axis=1)

    def along(self, directions: Array, rows: Indices, state: Array) -> Array:
        """Return the directions times R diag(1, l)."""
        heading = state[:, self._heading].take(rows)
        cosine, sine = np.cos(heading), np.sin(heading)
        x, y = directions
        return np.stack([x * cosine + y * sine, self.ahead * (y * cosine - x * sine)], axis=1)

    def fastest(self, rows: Array) -> Array:
        """Return the sum of the greatest contributions of both inputs; see `PointMotion.fastest`."""
        speed, turn = self._extremes
        sums: Array = speed * np.abs(rows[:, 0]) + turn * np.abs(rows[:, 1])
        return sums


class AccelerationInput(PointMotion):
    """p'' = u, of relative degree two: b = h' + gain h is the barrier, so that h' >= -gain h as well.

    With n at the instant, h' = n . (v - v_other) and c = n . (u - u_other), h is at least h + h' t + c t^2 / 2 after
    t <= T, and b at least h' + c T + gain (h + h' T + c T^2 / 2) - e, where e = T |change of n| |u - u_other| / 2, as
    n turns meanwhile. So b decreases by at most gain T b if

        c (1 + gain T / 2) >= -gain (h' + b) + e / T.
    """

    def limit(self, encounters: Encounters, state: Array) -> Array:
        """Return the least acceleration along the normals; of agents who share a constraint, half of it."""
        gain, hold = self.gain, self.hold
        relative = np.ascontiguousarray(state[:, 2:4].take(encounters.row, 0).T) - encounters.velocity
        rate = dot(encounters.normal, relative)
        acceleration = np.where(encounters.shared, 2.0, 1.0) * self.greatest
        # Of two points whose distance is at least d, which move by s, the direction turns by at most s / d.
        moved = hold * (np.sqrt(dot(relative, relative)) + 0.5 * hold * acceleration)
        least = np.maximum(np.maximum(encounters.distance - moved, encounters.keep), 1e-9)
        curvature = 0.5 * acceleration * np.minimum(moved / least, 2.0)
        needed = (curvature - gain * (2.0 * rate + gain * encounters.barrier)) / (1.0 + 0.5 * gain * hold)
        return np.where(encounters.shared, 0.5, 1.0) * needed


def kind_of_motion(model: Model) -> type[PointMotion] | None:
    """Return what describes the motion of a model in the plane; None if nothing here does."""
    inputs = tuple(name for name, _ in model.control_input)
    states = tuple(name for name, _ in model.state)
    if inputs == ("velocity_x", "velocity_y") and states == ("x", "y"):
        return VelocityInput
    if inputs == ("acceleration_x", "acceleration_y") and states == ("x", "y", "velocity_x", "velocity_y"):
        return AccelerationInput
    if inputs == ("speed", "turn_rate") and states == ("x", "y", "heading"):
        return HeadingInput
    return None


def greatest_length(model: Model) -> float:
    """Return the greatest length of a control input of a model that limits it; infinite without a limit."""
    huge = 1e12
    allowed = float(model.limit(np.array([[huge, 0.0]]))[0, 0])
    return np.inf if allowed >= huge else allowed


def motion_of(group: AgentGroup, gain: float, hold: float, ahead: float) -> PointMotion:
    """Return how the control inputs of a group move its points; see `PointMotion` and `HeadingInput`."""
    kind = kind_of_motion(group.model)
    assert kind is not None
    if issubclass(kind, HeadingInput):
        return kind(group.model, gain, hold, ahead)
    return kind(group.model, gain, hold)
