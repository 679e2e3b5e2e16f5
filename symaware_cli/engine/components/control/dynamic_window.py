"""The dynamic window approach: the speed and turn rate of the best arc that keeps clear of seen surfaces.

Reasons: docs/decisions/0087-sensing.md
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.engine.components.control.free_direction import DirectionCosts, free_directions
from symaware_cli.engine.components.control.scan_steering import ScanSteering
from symaware_cli.engine.components.scan_surfaces import BelievedPose, NearReturns, believed_pose
from symaware_cli.geometry import Array, Pieces, wrapped

#: The positions of an arc at which distances are measured.
_SAMPLES = 8

#: The directions that are compared.
_DIRECTIONS = 72

#: The turn rate below which arcs are straight [rad/s].
_STRAIGHT = 1e-6


class DynamicWindow(ScanSteering):
    """Drives to a goal, or along waypoints, by the returns of a lidar, with a model of speed and turn rate.

    At each turn it compares the pairs of a speed and a turn rate that the accelerations allow within `window` (D. Fox,
    W. Burgard, S. Thrun, "The dynamic window approach to collision avoidance", IEEE Robotics and Automation Magazine 4,
    1997). Each leads along an arc, for the time `arc`. It is admissible if the agent can stop on it before it comes
    nearer to a return than the margin; here within half of that way, so that two that approach each other can both
    stop. The best maximises the weighted sum of the approach to the target, of the heading towards it where the arc is
    nearest to it, of the clearance and of the speed. If none is admissible the agent stops, and goes on turning.

    Alone the method stops in front of obstacles in the way to the target. So the target is turned into the free
    direction of the scan that differs least from it, as `VectorFieldHistogram` finds it.

    With the `footprint` of a rectangle, distances from returns are those of the rectangle around the body as it turns,
    so that a long body passes through gaps that the circle around it does not fit into.
    """

    class Parameters(ScanSteering.Parameters):
        """The window, the arcs and their weights."""

        window: float = Field(0.25, gt=0, description="Within which time a speed has to be attained [s].")
        arc: float = Field(1.5, gt=0, description="How long the arcs are [s].")
        acceleration: float = Field(2.0, gt=0, description="Greatest change of the speed [m/s^2].")
        turn_acceleration: float = Field(6.0, gt=0, description="Greatest change of the turn rate [rad/s^2].")
        speeds: int = Field(6, ge=2, le=100, description="How many speeds are compared.")
        turn_rates: int = Field(15, ge=3, le=200, description="How many turn rates are compared.")
        returns: int = Field(48, ge=1, le=10_000, description="How many of the nearest returns count.")
        footprint: Literal["disc", "rectangle"] = Field(
            "disc",
            description="What has to be clear of returns: the disc with the `radius`, or the rectangle around the body "
            "that is turned with it; directions are free for the disc in both cases.",
        )
        progress_weight: float = Field(1.0, ge=0, description="Weight of the approach to the target.")
        heading_weight: float = Field(0.4, ge=0, description="Weight of the heading towards the target.")
        clearance_weight: float = Field(0.3, ge=0, description="Weight of the distance from what is seen.")
        speed_weight: float = Field(0.1, ge=0, description="Weight of the speed.")

    # The rectangle, which follows from the scenario.
    uncaptured = ("_low", "_high")

    def check(self, group: AgentGroup) -> None:
        """Check that the model has a speed and a turn rate, and can stand still."""
        if [name for name, _ in group.model.control_input] != ["speed", "turn_rate"] or len(group.model.state) != 3:
            raise ValueError("it needs a model whose control inputs are a speed and a turn rate, such as `unicycle`")
        if group.model.input_bounds()[0][0] > 0.0:
            raise ValueError("it needs a model that can stand still, with `min_speed` at most 0")
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Measure the body."""
        super().initialise_component(group)
        shape = group.entity.shape
        low, high = Pieces.of([([(0.0, 0.0)], 0.0)] if shape is None else shape.pieces).bounds()
        #: The corners of the rectangle around the body, x along its heading [m].
        self._low, self._high = low.min(axis=0), high.max(axis=0)

    def _steer_by(self, target: Array, speed: Array, near: NearReturns) -> tuple[Array, Array, Array]:
        given, group = self.parameters, self._group
        pose = believed_pose(group)
        inputs = self._candidates(speed)  # (n, c, 2)
        times = given.arc * np.arange(1, _SAMPLES + 1) / _SAMPLES
        places, headings = _arcs(inputs, pose.heading, times)  # (n, c, s, 2), (n, c, s)
        spare = self._spare(places, headings, near)  # (n, c, s)
        way = np.abs(inputs[..., 0, None]) * times
        touching = spare < self._least_spare(pose, near)[:, None, None]
        # The way before the first sample that is too near; the whole one, and more, if none is.
        first = np.where(touching, np.concatenate([np.zeros_like(way[..., :1]), way[..., :-1]], axis=2), np.inf)
        free = first.min(axis=2)
        admissible = inputs[..., 0] ** 2 <= given.acceleration * free
        if given.footprint == "rectangle":
            # A rectangle may also turn into what is beside it.
            until = np.where(touching, times - times[0], np.inf).min(axis=2)
            admissible &= np.abs(inputs[..., 1]) <= given.turn_acceleration * until
        towards = target - pose.position
        ahead = np.arctan2(towards[:, 1], towards[:, 0])
        chosen, _ = free_directions(
            ahead, self._memory, pose, near, self._surfaces.clearance, _DIRECTIONS, DirectionCosts()
        )
        goal = (_length(towards)[:, None] * np.stack([np.cos(chosen), np.sin(chosen)], axis=1))[:, None]
        rest = goal[:, :, None] - places
        distance = _length(rest)
        nearest = distance.argmin(axis=2)[..., None]
        distance = np.take_along_axis(distance, nearest, axis=2)[..., 0]
        progress = (_length(goal) - distance) / (given.speed * given.arc)
        # Where the arc is nearest to the target; there is no heading towards a target that is reached.
        error = np.take_along_axis(wrapped(np.arctan2(rest[..., 1], rest[..., 0]) - headings), nearest, axis=2)[..., 0]
        error = np.where(distance <= given.tolerance, 0.0, error)
        clear = np.minimum(spare.min(axis=2), given.range) / given.range
        score = (
            given.progress_weight * progress
            + given.heading_weight * (1.0 - np.abs(error) / np.pi)
            + given.clearance_weight * clear
            + given.speed_weight * np.abs(inputs[..., 0]) / given.speed
        )
        score = np.where(admissible, score, -np.inf)
        best = score.argmax(axis=1)
        control_input = inputs[self._rows, best]
        stuck = np.isneginf(score[self._rows, best])
        control_input[stuck] = group.model.limit(group.control_input)[stuck] * [0.0, 1.0]
        facing = np.stack([np.cos(pose.heading), np.sin(pose.heading)], axis=1)
        return control_input, control_input[:, :1] * facing, chosen

    def _candidates(self, speed: Array) -> Array:
        """Return the pairs of a speed and a turn rate within the window; shape (n, c, 2)."""
        given, group = self.parameters, self._group
        low, high = (np.array(bound, float) for bound in group.model.input_bounds())
        present = group.model.limit(group.control_input)
        change = given.window * np.array([given.acceleration, given.turn_acceleration])
        least, most = np.maximum(present - change, low), np.minimum(present + change, high)
        # Backwards only if the agent moves so already; and never faster than towards the end of the line.
        least[:, 0] = np.maximum(least[:, 0], np.minimum(present[:, 0], 0.0))
        most[:, 0] = np.maximum(np.minimum(most[:, 0], speed), least[:, 0])
        share_of_speed, share_of_turn = np.linspace(0.0, 1.0, given.speeds), np.linspace(0.0, 1.0, given.turn_rates)
        speeds = least[:, :1] + share_of_speed * (most - least)[:, :1]
        turns = least[:, 1:] + share_of_turn * (most - least)[:, 1:]
        pairs = np.empty((len(group), given.speeds, given.turn_rates, 2))
        pairs[..., 0], pairs[..., 1] = speeds[:, :, None], turns[:, None, :]
        return pairs.reshape(len(group), -1, 2)

    def _least_spare(self, pose: BelievedPose, near: NearReturns) -> Array:
        """Return how much nearer to returns than they should be bodies may come [m]; at most 0; shape (n,)."""
        if self.parameters.footprint == "disc":
            return np.zeros(len(pose.position))
        # One that is too near may come away, whatever its direction.
        nowhere = np.zeros((len(pose.position), 1, 1, 2))
        return np.minimum(self._spare(nowhere, pose.heading[:, None, None], near)[:, 0, 0], 0.0)

    def _spare(self, places: Array, headings: Array, near: NearReturns) -> Array:
        """Return by how much bodies are farther from returns than they have to be [m]; shape (n, c, s).

        Args:
            places: Positions relative to the agents [m]; shape (n, c, s, 2).
            headings: Headings there [rad]; shape (n, c, s).
            near: The returns of the lidar.
        """
        is_disc = self.parameters.footprint == "disc"
        chosen = np.argsort(near.distances, axis=1, kind="stable")[:, : self.parameters.returns]
        distance = np.take_along_axis(near.distances, chosen, axis=1)
        angle = np.take_along_axis(near.angles, chosen, axis=1)
        least = np.full(places.shape[:3], self.parameters.range)
        cosine, sine = np.cos(headings), np.sin(headings)
        # Return by return: the nearest first, and few agents see as many as count.
        for number in range(distance.shape[1]):
            some = np.flatnonzero(np.isfinite(distance[:, number]))
            if not len(some):
                break
            far, towards = distance[some, number], angle[some, number]
            x = (far * np.cos(towards))[:, None, None] - places[some, ..., 0]
            y = (far * np.sin(towards))[:, None, None] - places[some, ..., 1]
            if is_disc:
                least[some] = np.minimum(least[some], np.sqrt(x * x + y * y))
                continue
            along, across = cosine[some] * x + sine[some] * y, cosine[some] * y - sine[some] * x
            least[some] = np.minimum(least[some], _from_rectangle(along, across, self._low, self._high))
        return least - (self._surfaces.clearance if is_disc else self.parameters.margin)


def _arcs(inputs: Array, heading: Array, times: Array) -> tuple[Array, Array]:
    """Return positions relative to the start and headings on arcs, for inputs (n, c, 2), at times (s,)."""
    speed, rate = inputs[..., 0, None], inputs[..., 1, None]
    turned = rate * times
    facing = heading[:, None, None] + turned
    # The chord of an arc, as in `symaware_cli.engine.models.heading`.
    half = 0.5 * turned
    sinc = np.where(np.abs(half) > _STRAIGHT, np.sin(half) / np.where(np.abs(half) > _STRAIGHT, half, 1.0), 1.0)
    chord, direction = speed * times * sinc, heading[:, None, None] + half
    return np.stack([chord * np.cos(direction), chord * np.sin(direction)], axis=-1), facing


def _from_rectangle(along: Array, across: Array, low: Array, high: Array) -> Array:
    """Return the distances of points from a rectangle, negative inside of it [m]."""
    x = np.maximum(low[0] - along, along - high[0])
    y = np.maximum(low[1] - across, across - high[1])
    outside_x, outside_y = np.maximum(x, 0.0), np.maximum(y, 0.0)
    distance: Array = np.sqrt(outside_x * outside_x + outside_y * outside_y) + np.minimum(np.maximum(x, y), 0.0)
    return distance


def _length(vectors: Array) -> Array:
    length: Array = np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2)
    return length
