"""Risk as the probability of a collision, from Gaussian beliefs."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field
from scipy.special import erfc

from symaware_cli.core import Parameters
from symaware_cli.engine.components.relative_motion import dot
from symaware_cli.engine.components.risk.body_pairs import BodyPairs, PairRisk, WithOthers
from symaware_cli.engine.components.risk.gaussian import band_probability, closest_approach, collision_probability
from symaware_cli.engine.components.risk.outlines import overlap_bound, propagated_covariance
from symaware_cli.geometry import Array, Indices

#: At this many times the root of the trace of a covariance, a density counts as zero.
_FAR = 8.0
#: How many deviations of the velocity are covered for balls in space.
_COVERED = 4.0


class Collision(PairRisk):
    """Risk as an upper bound of the probability that an agent collides with another, or an obstacle, within a horizon.

    It is never less than that probability if the beliefs are right: positions and velocities Gaussian, with constant
    velocities from now on. Bodies count with their outlines and believed headings. For discs and balls with known
    velocities it is the probability itself (`collision_probability`), else `overlap_bound`; in space it is the least of
    the bounds seen from above, for the bounding balls of both, and for their heights.

    The covariance of the relative position is the sum of the own one (the uncertainty of the own state, if an estimator
    provides it) and the other's: errors of both are assumed independent. Risks of several encounters add up, to 1 at
    most (Boole's inequality), which holds for any dependence between them.

    Where an agent knows that another stays in a set, as from a promise, it collides with it only if it touches the set,
    enlarged by the other's body, or if the other leaves the set. So the risk of the encounter is the least of two: that
    of the predicted motion, and that of touching the set plus the declared probability of leaving it (`promises`).
    """

    batchable = True

    class Parameters(Parameters):
        """Parameters that define a collision."""

        horizon: float = Field(3.0, gt=0, description="How far ahead to look [s].")
        reach: float = Field(
            10.0, gt=0, description="Others, and surfaces of obstacles, farther away are not looked at [m]."
        )
        margin: float = Field(0.0, ge=0, description="Distance between two bodies that counts as a collision [m].")
        obstacles: bool = Field(True, description="Whether obstacles of the environment count.")
        promises: Literal["paid", "if-kept", "ignored"] = Field(
            "paid",
            description="What promises of others to stay in a region count: the risk contains the declared probability "
            "that they are broken (`paid`), or is the risk if all are kept (`if-kept`), or they do not count.",
        )

    def _compute(self) -> Array:
        risk = np.zeros(len(self._group))
        for pairs in self._pairs():
            risk = pairs.over_all(np.add, self._confined(pairs, self._probability(pairs)), risk)
        return np.minimum(risk, 1.0)

    def _confined(self, pairs: BodyPairs, probability: Array) -> Array:
        """Return the probability of a collision of each pair, given the known sets in which others stay."""
        counted = self.parameters.promises
        if not isinstance(pairs, WithOthers) or counted == "ignored":
            return probability
        for confined, sets in pairs.confined():
            within = self._probability(sets)
            if counted == "paid":
                within = within + confined.breach
            np.minimum.at(probability, confined.rows, within)
        return probability

    def _probability(self, pairs: BodyPairs) -> Array:
        """Return a bound of the probability of a collision for each pair; shape (m,)."""
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
            carried = propagated_covariance(covariance[rows], time[rows])
            probability[rows] = collision_probability(apart[:, rows], closing[:, rows], radius[rows], carried, horizon)
        if len(rows) < len(radius):
            nearest = np.sqrt(dot(*(2 * [apart + closing * time])))
            spreads = [
                np.trace(propagated_covariance(covariance, np.full(len(time), when)), axis1=1, axis2=2)
                for when in (0.0, horizon)
            ]
            spread = np.sqrt(np.maximum(np.maximum(*spreads), 0.0))
            rows = np.flatnonzero(~exact & (nearest - radius <= _FAR * spread) & (pairs.radius > 0.0))
            if len(rows):
                probability[rows] = self._bound(pairs, rows, covariance[rows], radius[rows], time[rows])
        return probability

    def _bound(self, pairs: BodyPairs, rows: Indices, covariance: Array, radius: Array, time: Array) -> Array:
        """Return the bound for bodies with corners, uncertain velocities, or heights."""
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
    """Return a bound for balls in space whose velocities may be uncertain.

    Until the horizon, their distance from the expected motion through the point of closest approach is at most this
    many deviations of the velocity times the time from that point.
    """
    variance = np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2)
    way = _COVERED * np.sqrt(np.maximum(variance, 0.0)) * np.maximum(time, horizon - time)
    tail = erfc(_COVERED / np.sqrt(2.0)) + np.sqrt(2.0 / np.pi) * _COVERED * np.exp(-0.5 * _COVERED * _COVERED)
    probability = collision_probability(apart, closing, radius + way, propagated_covariance(covariance, time), horizon)
    return np.minimum(probability + np.where(variance > 0.0, tail, 0.0), 1.0)


def _band(motion: Array, covariance: Array, horizon: float) -> Array:
    """Return the probability that a height is between two bounds within a horizon.

    Args:
        motion: The height, its rate, and the two bounds; shape (4, m).
        covariance: Covariance of height and rate; shape (m, 2, 2).
        horizon: Time horizon [s].
    """
    height, rate, low, high = motion
    variances = (
        propagated_covariance(covariance, np.zeros(len(height))),
        propagated_covariance(covariance, np.full(len(height), horizon)),
    )
    common = covariance[:, 0, 0] + horizon * covariance[:, 0, 1]
    return band_probability(
        (height, height + horizon * rate), (variances[0][:, 0, 0], variances[1][:, 0, 0]), common, low, high
    )
