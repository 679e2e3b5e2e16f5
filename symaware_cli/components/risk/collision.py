"""Risk as the probability of a collision, from Gaussian beliefs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.special import erfc

from symaware_cli.components.relative_motion import dot
from symaware_cli.components.risk.balls import closest_approach, collision_probability
from symaware_cli.components.risk.body_pairs import BodyPairs, PairRisk
from symaware_cli.components.risk.gaussian import band_probability
from symaware_cli.components.risk.outlines import carried_on, overlap_bound
from symaware_cli.core import Parameters

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: So many times the root of the trace of a covariance away, a density is nothing.
_NOTHING = 8.0
#: How many deviations of the velocity are covered where balls meet in space.
_COVERED = 4.0


class Collision(PairRisk):
    """Risk as a bound of the probability that an agent comes too close to another, or to an obstacle, in time.

    Never less than that probability, if beliefs are right: positions and velocities Gaussian, with constant velocities
    from now on. Bodies count with their outlines and believed headings. For discs and balls whose velocities are known
    it is the probability itself (`collision_probability`), else what `overlap_bound` says; in space, the least of
    what holds seen from above, for the balls around both, and for their heights.

    The covariance of the relative position is the sum of one's own (the uncertainty of one's own state, where an
    estimator keeps one) and the other's: errors of both are taken as independent. Risks in several encounters add up,
    to 1 at most (Boole's inequality), which holds whatever they have in common.
    """

    class Parameters(Parameters):
        """What counts as a collision."""

        horizon: float = Field(3.0, gt=0, description="How far ahead to look [s].")
        reach: float = Field(
            10.0, gt=0, description="Others, and surfaces of obstacles, farther away are not looked at [m]."
        )
        margin: float = Field(0.0, ge=0, description="Distance between two bodies that counts as a collision [m].")
        obstacles: bool = Field(True, description="Whether obstacles of the environment count.")

    def _compute(self) -> Array:
        risk = np.zeros(len(self._group))
        for pairs in self._pairs():
            risk = pairs.over_all(np.add, self._probability(pairs), risk)
        return np.minimum(risk, 1.0)

    def _probability(self, pairs: BodyPairs) -> Array:
        """A bound of the probability of a collision, for each pair; shape (m,)."""
        apart, closing, horizon = pairs.apart, pairs.closing, self.parameters.horizon
        radius, size = pairs.radius + self.parameters.margin, len(apart)
        covariance = pairs.covariance
        if covariance is None:
            covariance = np.zeros((apart.shape[1], 2 * size, 2 * size))
        time = closest_approach(apart, closing, horizon)
        exact = pairs.round & ~covariance[:, size:, size:].any(axis=(1, 2)) & (pairs.heights is None)
        probability = np.zeros(len(radius))
        rows = np.flatnonzero(exact)
        if len(rows):
            carried = carried_on(covariance[rows], time[rows])
            probability[rows] = collision_probability(apart[:, rows], closing[:, rows], radius[rows], carried, horizon)
        if len(rows) < len(radius):
            nearest = np.sqrt(dot(*(2 * [apart + closing * time])))
            spreads = [
                np.trace(carried_on(covariance, np.full(len(time), when)), axis1=1, axis2=2) for when in (0.0, horizon)
            ]
            spread = np.sqrt(np.maximum(np.maximum(*spreads), 0.0))
            rows = np.flatnonzero(~exact & (nearest - radius <= _NOTHING * spread) & (pairs.radius > 0.0))
            if len(rows):
                probability[rows] = self._bound(pairs, rows, covariance[rows], radius[rows], time[rows])
        return probability

    def _bound(self, pairs: BodyPairs, rows: Indices, covariance: Array, radius: Array, time: Array) -> Array:
        """What holds for bodies with corners, for uncertain velocities, and for heights."""
        parameters, size = self.parameters, len(pairs.apart)
        apart, closing = pairs.apart[:, rows], pairs.closing[:, rows]
        plane = [0, 1, size, size + 1]
        sides = pairs.sides(rows)
        bound = overlap_bound(
            apart[:2],
            closing[:2],
            covariance[:, plane][:, :, plane],
            *sides,
            parameters.margin,
            parameters.horizon,
        )
        if size == 3:
            bound = np.minimum(bound, _balls(apart, closing, radius, covariance, time, parameters.horizon))
            whole = np.stack([apart[2], closing[2], -radius, radius])
            bound = np.minimum(bound, _band(whole, covariance[:, [2, 5]][:, :, [2, 5]], parameters.horizon))
        if pairs.heights is not None:
            low_high = pairs.heights[:, rows].copy()
            low_high[2] -= parameters.margin
            low_high[3] += parameters.margin
            own = pairs.own_heights(rows)
            bound = np.minimum(bound, _band(low_high, own, parameters.horizon))
        return bound


def _balls(apart: Array, closing: Array, radius: Array, covariance: Array, time: Array, horizon: float) -> Array:
    """A bound for balls in space whose velocities may be uncertain.

    Until the horizon, they are nowhere farther from where the expected velocity leads, from the time of the closest
    approach on or back, than so many deviations of the velocity times that long.
    """
    variance = np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2)
    way = _COVERED * np.sqrt(np.maximum(variance, 0.0)) * np.maximum(time, horizon - time)
    tail = erfc(_COVERED / np.sqrt(2.0)) + np.sqrt(2.0 / np.pi) * _COVERED * np.exp(-0.5 * _COVERED * _COVERED)
    probability = collision_probability(apart, closing, radius + way, carried_on(covariance, time), horizon)
    return np.minimum(probability + np.where(variance > 0.0, tail, 0.0), 1.0)


def _band(motion: Array, covariance: Array, horizon: float) -> Array:
    """The probability that something is between two heights within a horizon.

    Args:
        motion: Its height, how fast that changes, and the two; shape (4, m).
        covariance: Of the first two; shape (m, 2, 2).
        horizon: [s].
    """
    height, rate, low, high = motion
    variances = carried_on(covariance, np.zeros(len(height))), carried_on(covariance, np.full(len(height), horizon))
    common = covariance[:, 0, 0] + horizon * covariance[:, 0, 1]
    return band_probability(
        (height, height + horizon * rate), (variances[0][:, 0, 0], variances[1][:, 0, 0]), common, low, high
    )
