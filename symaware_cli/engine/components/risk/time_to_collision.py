"""Risk from the time to collision."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from symaware_cli.core import Parameters
from symaware_cli.engine.components.relative_motion import dot
from symaware_cli.engine.components.risk.body_pairs import BodyPairs, PairRisk, WithOthers
from symaware_cli.engine.components.risk.outlines import first_touch
from symaware_cli.geometry import Array, between


def time_to_collision(apart: Array, closing: Array, radius: Array) -> Array:
    """Return the time until two discs or balls touch at constant velocities.

    They touch at the smaller root t of |p + v t|^2 = R^2, written in the form that does not cancel for slow motion.

    Args:
        apart: The vector from the first to the second [m]; shape (d, m).
        closing: The velocity of the second relative to the first [m/s]; shape (d, m).
        radius: The sum of both radii [m]; shape (m,).

    Returns:
        Times [s]; 0 if they overlap already, infinite if they never touch; shape (m,).
    """
    speed = dot(closing, closing)
    outward = dot(apart, closing)
    gap = dot(apart, apart) - radius * radius
    discriminant = outward * outward - speed * gap
    time = np.full(len(radius), np.inf)
    rows = np.flatnonzero((outward < 0.0) & (discriminant >= 0.0) & (radius > 0.0))
    time[rows] = gap[rows] / (np.sqrt(discriminant[rows]) - outward[rows])
    time[gap < 0.0] = 0.0
    return time


class TimeToCollision(PairRisk):
    """Risk from the time until an agent touches another, or an obstacle, at constant velocities.

    The risk is 1 - t / horizon for the earliest of all encounters, 0 if nothing is touched within the horizon and 1 if
    bodies overlap. Time to collision is the usual measure of the urgency of an encounter (J. C. Hayward, "Near-miss
    determination through use of a scale of danger", Highway Research Record 384, 1972); the straight line is the
    simplest map from it that decreases from 1 to 0.

    Bodies count with their outlines at their believed headings; turning bodies with outlines that contain them until
    then (`first_touch`). In space they touch when both their bounding balls and their outlines seen from above do.

    Where an agent knows that another stays in a set, as from a promise, they do not touch before the agent touches the
    set, enlarged by the other's body. The risk is then one if the promise is kept.
    """

    batchable = True

    uses_uncertainty = False

    class Parameters(Parameters):
        """Horizon, reach and margin."""

        horizon: float = Field(5.0, gt=0, description="Time to collision at which there is no risk yet [s].")
        reach: float = Field(
            10.0, gt=0, description="Others, and surfaces of obstacles, farther away are not looked at [m]."
        )
        margin: float = Field(0.0, ge=0, description="Distance between two bodies that counts as touching [m].")
        obstacles: bool = Field(True, description="Whether obstacles of the environment count.")
        promises: Literal["if-kept", "ignored"] = Field(
            "if-kept",
            description="Whether promises of others to stay in a region count: the risk is one if all are kept.",
        )

    def _compute(self) -> Array:
        soonest = np.full(len(self._group), np.inf)
        for pairs in self._pairs():
            time = self._time(pairs)
            if isinstance(pairs, WithOthers) and self.parameters.promises != "ignored":
                for confined, sets in pairs.confined():
                    np.maximum.at(time, confined.rows, self._time(sets))
            soonest = pairs.over_all(np.minimum, time, soonest)
        risk: Array = np.maximum(1.0 - soonest / self.parameters.horizon, 0.0)
        return risk

    def _time(self, pairs: BodyPairs) -> Array:
        """Return the time until the bodies of each pair touch [s]; infinite beyond the horizon; shape (m,)."""
        apart, closing, parameters = pairs.apart, pairs.closing, self.parameters
        # Bodies do not touch before their bounding balls do.
        time = time_to_collision(apart, closing, pairs.radius + parameters.margin)
        if pairs.round.all() and pairs.heights is None:
            return time
        rows = np.flatnonzero(~pairs.round & (time < parameters.horizon))
        if len(rows):
            sides = pairs.sides(rows)
            flat = first_touch(apart[:2, rows], closing[:2, rows], *sides, parameters.margin, parameters.horizon)
            time[rows] = np.maximum(time[rows], flat)
        if pairs.heights is not None:
            level, rate, low, high = pairs.heights
            start, end = between(level, rate, low - parameters.margin, high + parameters.margin)
            time = np.where((end < 0.0) | (start > end), np.inf, np.maximum(time, start))
        return time
