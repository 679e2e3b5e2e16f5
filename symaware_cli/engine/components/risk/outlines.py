"""Bounds of the probability that two outlines overlap, and the time when they first do."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from symaware_cli.engine.components.risk.gaussian import band_probability, polygon_probability
from symaware_cli.geometry import Array, Indices, Mask, Pieces, cornered, loosened, overlap_region, width, within

#: How many deviations of velocities and headings are covered: the least of the resulting bounds is used.
_COVERED = (2.5, 3.5, 5.0)
#: The number of directions of bands over the half circle, and the deviations beyond which they count as empty.
_BANDS, _FAR = 8, 6.0
#: A bound below this is not refined.
_NEGLIGIBLE = 1e-6
#: The number of parts of the horizon in which turning bodies are followed until they touch.
_PARTS = 8


class Side(NamedTuple):
    """One body of each pair.

    outlines: Outlines around the positions, with x along the headings.
    headings: Headings [rad]; shape (m,).
    turn_rates: Turn rates [rad/s]; shape (m,).
    deviations: Standard deviations of the headings [rad]; of headings by the direction of motion, the greatest
        standard deviation of the velocity over the speed. Shape (m,).
    by_motion: Whether a heading is known by the direction of motion; shape (m,).
    """

    outlines: Pieces
    headings: Array
    turn_rates: Array
    deviations: Array
    by_motion: Mask

    def take(self, rows: Indices) -> Side:
        """Return some rows."""
        headings, rates, deviations = (each.take(rows) for each in (self.headings, self.turn_rates, self.deviations))
        return Side(self.outlines.take(rows), headings, rates, deviations, self.by_motion.take(rows))

    def turned(self, covered: Array | float, span: Array) -> Pieces:
        """Return outlines that contain the bodies for a span of time.

        A body may keep turning at its rate or stop at any time, so all headings in between count.

        Args:
            covered: The number of deviations by which headings may be wrong.
            span: The span of time [s]; shape (m,).
        """
        if not self.outlines.vertices.any():
            return self.outlines  # discs
        error = covered * self.deviations
        most = np.where(error < 1.0, np.arcsin(np.minimum(error, 1.0)), np.pi)
        error = np.where(self.by_motion, most, error)
        half = 0.5 * self.turn_rates * span
        nowhere = np.zeros((len(half), 2))
        return loosened(self.outlines.placed(nowhere, self.headings + half), np.abs(half) + error)


def overlap_bound(
    apart: Array, closing: Array, covariance: Array, one: Side, other: Side, margin: float, horizon: float
) -> Array:
    """Return bounds of the probability that two bodies, seen from above, come closer than a margin within a horizon.

    It is never less than the probability if positions and velocities are Gaussian and velocities constant. With the
    first body at the origin, the two come that close exactly if the second lies in the Minkowski sum of the first, the
    reflection of the second, a disc of the margin, and the path against the relative velocity for the horizon: a convex
    polygon, over which the Gaussian is integrated in closed form (`polygon_probability`). If velocities and headings
    are known, this is the probability itself, except that arcs are replaced by polygons that are 0.9 % wider.

    Otherwise the least of these bounds is returned, each by Boole's inequality:

    - For each direction, the bodies overlap only while their relative position along it is in a band, and its extremes
      are at the ends of any span of time (`band_probability`). Only the window matters in which all bands are nearer
      than 6 deviations.
    - Around the middle of the window, at most half of it away, positions differ from those expected at the expected
      velocity by no more than k deviations of the velocity times that half, except with probability exp(-k^2 / 2); the
      sum is widened by that. Headings are wrong by no more than k deviations, and outlines are widened by the resulting
      displacement of their points.

    For the event, and for bounds of it by how often bodies are entered, see R. Altendorfer and C. Wilkmann, "A new
    approach to estimate the collision probability for automotive applications", Automatica 127, 2021.

    Args:
        apart: Expected position of the second body relative to the first [m]; shape (2, m).
        closing: Expected relative velocity [m/s]; shape (2, m).
        covariance: Covariance of relative position and velocity; shape (m, 4, 4).
        one: The first bodies.
        other: The second bodies.
        margin: The distance that counts as a collision [m].
        horizon: Time horizon [s].

    Returns:
        Shape (m,).
    """
    position, velocity = apart.T, closing.T
    speed_deviation = _greatest_deviation(covariance[:, 2:, 2:])
    known = (speed_deviation == 0.0) & (one.deviations == 0.0) & (other.deviations == 0.0)
    known &= (one.turn_rates == 0.0) & (other.turn_rates == 0.0)
    bound = np.ones(len(position))
    rows = np.flatnonzero(known)
    if len(rows):
        span = np.full(len(rows), horizon)
        regions = _overlap_regions(one.take(rows), other.take(rows), 0.0, span, margin, velocity[rows] * horizon)
        bound[rows] = _probability(position[rows], covariance[rows, :2, :2], regions)
    rows = np.flatnonzero(~known)
    if len(rows):
        pairs = _UncertainPairs(
            position[rows],
            velocity[rows],
            covariance[rows],
            one.take(rows),
            other.take(rows),
            margin,
            horizon,
            speed_deviation[rows],
        )
        bound[rows] = pairs.bound()
    return bound


class _UncertainPairs:
    """Pairs whose velocities or headings are uncertain or change; see `overlap_bound`."""

    def __init__(
        self,
        position: Array,
        velocity: Array,
        covariance: Array,
        one: Side,
        other: Side,
        margin: float,
        horizon: float,
        speed_deviation: Array,
    ) -> None:
        self.position, self.velocity, self.covariance = position, velocity, covariance
        self.one, self.other, self.margin, self.horizon = one, other, margin, horizon
        self.speed_deviation = speed_deviation
        self.uncertain_headings = 1.0 * (one.deviations > 0.0) + (other.deviations > 0.0)
        self.turning = bool(one.turn_rates.any() or other.turn_rates.any())

    def bound(self) -> Array:
        count = len(self.position)
        angles = np.arctan2(self.velocity[:, 1], self.velocity[:, 0])[:, None] + np.arange(_BANDS) * (np.pi / _BANDS)
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=2)
        mean, rate = _along(directions, self.position), _along(directions, self.velocity)
        spread = _spread(directions, self.covariance)
        whole = np.full(count, self.horizon)
        low, high = self._bands(directions, whole)
        start, end = self._window(mean, rate, spread, low, high)
        never = start >= end
        start, end = np.where(never, 0.0, start), np.where(never, 0.0, end)
        if self.turning:
            low, high = self._bands(directions, end)
        first, last = start[:, None], end[:, None]
        means, variances = [mean + time * rate for time in (first, last)], [_at(spread, time) for time in (first, last)]
        common = spread[0] + (first + last) * spread[1] + first * last * spread[2]
        bands = band_probability((means[0], means[1]), (variances[0], variances[1]), common, low, high)
        tail = self._heading_tail(_COVERED[-1])
        bound = np.where(never, tail, bands.min(axis=1) + tail)
        rows = np.flatnonzero(bound > _NEGLIGIBLE)
        if len(rows):
            bound[rows] = np.minimum(bound[rows], self._swept(rows, start[rows], end[rows]))
        # The probability outside of the window: at either end, on either side, of each band.
        return np.minimum(bound + 4 * _BANDS * ndtr(-_FAR), 1.0)

    def _swept(self, rows: Indices, start: Array, end: Array) -> Array:
        """Return the least of the bounds for the numbers of deviations in `_COVERED`."""
        count, choices = len(rows), len(_COVERED)
        rows, start, end = np.tile(rows, choices), np.tile(start, choices), np.tile(end, choices)
        covered = np.repeat(_COVERED, count)
        half, velocity, deviation = 0.5 * (end - start), self.velocity[rows], self.speed_deviation[rows]
        one, other = self.one.take(rows), self.other.take(rows)
        regions = _overlap_regions(one, other, covered, end, self.margin, velocity * (end - start)[:, None])
        regions.rounding = regions.rounding + covered * deviation * half
        carried = propagated_covariance(self.covariance[rows], 0.5 * (start + end))
        bound = _probability(self.position[rows] + start[:, None] * velocity, carried, regions)
        bound += np.where((deviation > 0.0) & (half > 0.0), np.exp(-0.5 * covered * covered), 0.0)
        bound += self._heading_tail(covered, rows)
        least: Array = bound.reshape(choices, count).min(axis=0)
        return least

    def _bands(self, directions: Array, span: Array) -> tuple[Array, Array]:
        """Return the bounds, along directions, between which bodies overlap."""
        return width(_overlap_regions(self.one, self.other, _COVERED[-1], span, self.margin, None), directions)

    def _heading_tail(self, covered: Array | float, rows: Indices | slice = slice(None)) -> Array:
        """Return the probability that a heading is wrong by more than a number of deviations."""
        tails: Array = np.exp(-0.5 * np.square(covered)) * self.uncertain_headings[rows]
        return tails

    def _window(
        self, mean: Array, rate: Array, spread: tuple[Array, Array, Array], low: Array, high: Array
    ) -> tuple[Array, Array]:
        """Return the window in which bodies may overlap: no band is far away; shape (m,) each."""
        horizon = self.horizon
        end_spread = (_at(spread, horizon), -(spread[1] + horizon * spread[2]), spread[2])
        begun, left = np.zeros(len(mean)), np.zeros(len(mean))
        for gap, opening in ((low - mean, -rate), (mean - high, rate)):
            begun = np.maximum(begun, _while_far(gap, opening, spread, horizon).max(axis=1))
            later = gap + horizon * opening
            left = np.maximum(left, _while_far(later, -opening, end_spread, horizon).max(axis=1))
        return begun, horizon - left


def _while_far(gap: Array, opening: Array, spread: tuple[Array, Array, Array], horizon: float) -> Array:
    """Return how long, from now on, a value is at least `_FAR` deviations beyond a bound.

    This ends at the first root of gap(t)^2 = _FAR^2 variance(t), if it holds now.

    Args:
        gap: The distance beyond the bound [m].
        opening: The rate of the distance [m/s].
        spread: The coefficients of the variance by powers of time.
        horizon: The longest duration to return [s].
    """
    far = _FAR * _FAR
    a, b, c = opening**2 - far * spread[2], gap * opening - far * spread[1], gap**2 - far * spread[0]
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    q = -(b + np.where(b >= 0.0, root, -root))
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.stack([q / a, c / q])
    roots = np.where(np.isfinite(roots) & (roots >= 0.0) & (b * b >= a * c), roots, np.inf)
    # Slightly less, so that rounding does not lead beyond the root.
    length = np.minimum(roots.min(axis=0) * (1.0 - 1e-9), horizon)
    return np.where((gap > 0.0) & (c > 0.0), length, 0.0)


def first_touch(apart: Array, closing: Array, one: Side, other: Side, margin: float, horizon: float) -> Array:
    """Return when two bodies, seen from above, first come closer than a margin at constant velocities.

    Bodies that turn have outlines that grow with time, so the result is never too late.

    Args:
        apart: Position of the second body relative to the first [m]; shape (2, m).
        closing: Relative velocity [m/s]; shape (2, m).
        one: The first bodies; deviations of headings are ignored.
        other: The second bodies.
        margin: The distance that counts as touching [m].
        horizon: Time horizon [s].

    Returns:
        Times [s]; 0 if they overlap, infinite if they do not touch within the horizon; shape (m,).
    """
    position, velocity = apart.T, closing.T
    turning = bool(one.turn_rates.any() or other.turn_rates.any())
    touch = np.full(len(position), np.inf)
    times = np.linspace(0.0, horizon, _PARTS + 1) if turning else np.array([0.0, horizon])
    for begins, ends in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        span = np.full(len(position), ends if turning else 0.0)
        start, end = within(position, velocity, _overlap_regions(one, other, 0.0, span, margin, None))
        time = np.maximum(start, begins)
        touch = np.minimum(touch, np.where((time <= end) & (time <= ends), time, np.inf))
    return touch


def propagated_covariance(covariance: Array, time: Array) -> Array:
    """Return covariances of the position after a time at constant velocity; (m, 2d, 2d) to (m, d, d)."""
    count = covariance.shape[1] // 2
    position, cross = covariance[:, :count, :count], covariance[:, :count, count:]
    ahead = time[:, None, None]
    return position + ahead * (cross + np.swapaxes(cross, 1, 2)) + ahead * ahead * covariance[:, count:, count:]


def _overlap_regions(
    one: Side, other: Side, covered: Array | float, span: Array, margin: float, way: Array | None
) -> Pieces:
    regions = overlap_region(one.turned(covered, span), other.turned(covered, span), way)
    regions.rounding = regions.rounding + margin
    return regions


def _probability(mean: Array, covariance: Array, regions: Pieces) -> Array:
    """Return the probability that Gaussian points lie in rounded pieces, or slightly more."""
    probability = np.empty(len(mean))
    for rows in (np.flatnonzero(regions.rounding == 0.0), np.flatnonzero(regions.rounding > 0.0)):
        if len(rows):
            probability[rows] = polygon_probability(mean[rows], covariance[rows], cornered(regions.take(rows)))
    return probability


def _along(directions: Array, vectors: Array) -> Array:
    return directions[..., 0] * vectors[:, 0, None] + directions[..., 1] * vectors[:, 1, None]


def _spread(directions: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Return coefficients of the variance along directions (m, k, 2): c0 + 2 c1 t + c2 t^2."""
    x, y = directions[..., 0], directions[..., 1]

    def along(block: Array) -> Array:
        return (
            x * x * block[:, 0, 0, None]
            + x * y * (block[:, 0, 1, None] + block[:, 1, 0, None])
            + y * y * block[:, 1, 1, None]
        )

    position, velocity = (np.maximum(along(covariance[:, part, part]), 0.0) for part in (slice(2), slice(2, 4)))
    return position, along(covariance[:, :2, 2:]), velocity


def _at(spread: tuple[Array, Array, Array], time: Array | float) -> Array:
    return np.maximum(spread[0] + 2.0 * time * spread[1] + time * time * spread[2], 0.0)


def _greatest_deviation(covariance: Array) -> Array:
    """Return the root of the greatest eigenvalue of symmetric matrices; (m, 2, 2) to (m,)."""
    half, cross = 0.5 * (covariance[:, 0, 0] - covariance[:, 1, 1]), 0.5 * (covariance[:, 0, 1] + covariance[:, 1, 0])
    middle = 0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1])
    return np.sqrt(np.maximum(middle + np.hypot(half, cross), 0.0))
