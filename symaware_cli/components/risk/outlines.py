"""Bounds of the probability that two outlines overlap, and when they first do."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from symaware_cli.components.risk.gaussian import band_probability, polygon_probability
from symaware_cli.geometry.minkowski import cornered, loosened, meeting_places, width, within
from symaware_cli.geometry.pieces import Pieces

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: How many deviations of velocities and headings are covered; each is a bound, and the least of them counts.
_COVERED = (2.5, 3.5, 5.0)
#: Into how many directions bands are laid over the half circle, and so many deviations away nothing is in them.
_BANDS, _FAR = 8, 6.0
#: A bound that is no greater is good enough.
_LITTLE = 1e-6
#: In so many parts of the horizon bodies that turn are followed until they touch.
_PARTS = 8


class Side(NamedTuple):
    """One body of each pair.

    Attributes:
        outlines: Their outlines around their positions, x along their headings.
        headings: [rad]; shape (m,).
        turn_rates: How fast they turn [rad/s]; shape (m,).
        deviations: Standard deviations of the headings [rad]; of those known by their directions of motion, the
            greatest standard deviation of the velocity by the speed. Shape (m,).
        by_motion: Which headings are known by the direction of motion; shape (m,).
    """

    outlines: Pieces
    headings: Array
    turn_rates: Array
    deviations: Array
    by_motion: NDArray[np.bool_]

    def take(self, rows: Indices) -> Side:
        """Pick rows."""
        headings, rates, deviations = (each.take(rows) for each in (self.headings, self.turn_rates, self.deviations))
        return Side(self.outlines.take(rows), headings, rates, deviations, self.by_motion.take(rows))

    def turned(self, covered: Array | float, span: Array) -> Pieces:
        """Outlines that hold the bodies for a span of time.

        A body may turn on at its rate or cease to at any time, so all headings in between count.

        Args:
            covered: By how many deviations headings may be wrong.
            span: [s]; shape (m,).
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

    Never less than the probability, if positions and velocities are Gaussian and constant velocities carry bodies on.
    With the one at the origin, the two come that close exactly if the other lies in the Minkowski sum of the one, the
    reflection of the other, a disc of the margin, and the way against the relative velocity for the horizon: in a
    convex polygon, over which the Gaussian is integrated in closed form (`polygon_probability`). Where velocities and
    headings are known, that is the probability itself, but for arcs, for which polygons stand that are 0.9 % wider.

    Where they are not, the least of these holds, each of which is a bound by Boole's inequality:

    - For each direction, the bodies overlap only while their relative position along it is in a band, and its least and
      greatest values come at the ends of any span of time (`band_probability`). Before and after the time for which
      all bands are nearer than 6 deviations, nothing happens: only that window counts.
    - Around the middle of the window, at most half of it away, positions differ from those expected at the expected
      velocity by no more than k deviations of the velocity times that half, but for exp(-k^2 / 2); the sum is widened
      by so much. Headings are wrong by no more than k deviations, and outlines are widened by how far that moves any of
      their points.

    For the event, and for bounds of it by how often bodies are entered, see R. Altendorfer and C. Wilkmann, "A new
    approach to estimate the collision probability for automotive applications", Automatica 127, 2021.

    Args:
        apart: Expected position of the other relative to the one [m]; shape (2, m).
        closing: Expected relative velocity [m/s]; shape (2, m).
        covariance: Of relative position and velocity; shape (m, 4, 4).
        one: The one.
        other: The other.
        margin: The distance that counts as a collision [m].
        horizon: How far ahead to look [s].

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
        places = _places(one.take(rows), other.take(rows), 0.0, span, margin, velocity[rows] * horizon)
        bound[rows] = _probability(position[rows], covariance[rows, :2, :2], places)
    rows = np.flatnonzero(~known)
    if len(rows):
        pairs = _Doubtful(
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


class _Doubtful:
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
        self.doubtful_headings = 1.0 * (one.deviations > 0.0) + (other.deviations > 0.0)
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
        rows = np.flatnonzero(bound > _LITTLE)
        if len(rows):
            bound[rows] = np.minimum(bound[rows], self._swept(rows, start[rows], end[rows]))
        # What lies outside of the window: at either end, on either side, of each band.
        return np.minimum(bound + 4 * _BANDS * ndtr(-_FAR), 1.0)

    def _swept(self, rows: Indices, start: Array, end: Array) -> Array:
        """The least of the bounds that cover so many deviations each."""
        count, choices = len(rows), len(_COVERED)
        rows, start, end = np.tile(rows, choices), np.tile(start, choices), np.tile(end, choices)
        covered = np.repeat(_COVERED, count)
        half, velocity, deviation = 0.5 * (end - start), self.velocity[rows], self.speed_deviation[rows]
        one, other = self.one.take(rows), self.other.take(rows)
        places = _places(one, other, covered, end, self.margin, velocity * (end - start)[:, None])
        places.rounding = places.rounding + covered * deviation * half
        carried = carried_on(self.covariance[rows], 0.5 * (start + end))
        bound = _probability(self.position[rows] + start[:, None] * velocity, carried, places)
        bound += np.where((deviation > 0.0) & (half > 0.0), np.exp(-0.5 * covered * covered), 0.0)
        bound += self._heading_tail(covered, rows)
        least: Array = bound.reshape(choices, count).min(axis=0)
        return least

    def _bands(self, directions: Array, span: Array) -> tuple[Array, Array]:
        """Between which bounds, along directions, bodies overlap."""
        return width(_places(self.one, self.other, _COVERED[-1], span, self.margin, None), directions)

    def _heading_tail(self, covered: Array | float, rows: Indices | slice = slice(None)) -> Array:
        """The probability that a heading is farther off than so many deviations."""
        tails: Array = np.exp(-0.5 * np.square(covered)) * self.doubtful_headings[rows]
        return tails

    def _window(
        self, mean: Array, rate: Array, spread: tuple[Array, Array, Array], low: Array, high: Array
    ) -> tuple[Array, Array]:
        """From when until when bodies may overlap: when no band is far away; shape (m,) each."""
        horizon = self.horizon
        end_spread = (_at(spread, horizon), -(spread[1] + horizon * spread[2]), spread[2])
        begun, left = np.zeros(len(mean)), np.zeros(len(mean))
        for gap, opening in ((low - mean, -rate), (mean - high, rate)):
            begun = np.maximum(begun, _while_far(gap, opening, spread, horizon).max(axis=1))
            later = gap + horizon * opening
            left = np.maximum(left, _while_far(later, -opening, end_spread, horizon).max(axis=1))
        return begun, horizon - left


def _while_far(gap: Array, opening: Array, spread: tuple[Array, Array, Array], horizon: float) -> Array:
    """For how long, from now on, something is at least so many deviations beyond a bound.

    Until the first root of gap(t)^2 = _FAR^2 variance(t), if it is so now.

    Args:
        gap: How far beyond the bound it is [m].
        opening: How fast that grows [m/s].
        spread: The variance by powers of time.
        horizon: At most so long.
    """
    far = _FAR * _FAR
    a, b, c = opening**2 - far * spread[2], gap * opening - far * spread[1], gap**2 - far * spread[0]
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    q = -(b + np.where(b >= 0.0, root, -root))
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.stack([q / a, c / q])
    roots = np.where(np.isfinite(roots) & (roots >= 0.0) & (b * b >= a * c), roots, np.inf)
    # Short of it, so that rounding does not lead beyond.
    length = np.minimum(roots.min(axis=0) * (1.0 - 1e-9), horizon)
    return np.where((gap > 0.0) & (c > 0.0), length, 0.0)


def first_touch(apart: Array, closing: Array, one: Side, other: Side, margin: float, horizon: float) -> Array:
    """Return when two bodies, seen from above, first come closer than a margin if both keep their velocities.

    Bodies that turn are held by outlines that grow with time, so what is returned is never too late.

    Args:
        apart: As for `overlap_bound`; shape (2, m).
        closing: Likewise.
        one: The one; how sure headings are does not count.
        other: The other.
        margin: [m].
        horizon: What comes later is of no interest [s].

    Returns:
        [s]; 0 where they overlap, infinite where they do not within the horizon; shape (m,).
    """
    position, velocity = apart.T, closing.T
    turning = bool(one.turn_rates.any() or other.turn_rates.any())
    touch = np.full(len(position), np.inf)
    times = np.linspace(0.0, horizon, _PARTS + 1) if turning else np.array([0.0, horizon])
    for begins, ends in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        span = np.full(len(position), ends if turning else 0.0)
        start, end = within(position, velocity, _places(one, other, 0.0, span, margin, None))
        time = np.maximum(start, begins)
        touch = np.minimum(touch, np.where((time <= end) & (time <= ends), time, np.inf))
    return touch


def carried_on(covariance: Array, time: Array) -> Array:
    """Carry covariances of position and velocity forward at constant velocity; (m, 2d, 2d) to (m, d, d)."""
    count = covariance.shape[1] // 2
    position, cross = covariance[:, :count, :count], covariance[:, :count, count:]
    ahead = time[:, None, None]
    return position + ahead * (cross + np.swapaxes(cross, 1, 2)) + ahead * ahead * covariance[:, count:, count:]


def _places(one: Side, other: Side, covered: Array | float, span: Array, margin: float, way: Array | None) -> Pieces:
    places = meeting_places(one.turned(covered, span), other.turned(covered, span), way)
    places.rounding = places.rounding + margin
    return places


def _probability(mean: Array, covariance: Array, places: Pieces) -> Array:
    """The probability that Gaussian points lie in rounded pieces, or a little more."""
    probability = np.empty(len(mean))
    for rows in (np.flatnonzero(places.rounding == 0.0), np.flatnonzero(places.rounding > 0.0)):
        if len(rows):
            probability[rows] = polygon_probability(mean[rows], covariance[rows], cornered(places.take(rows)))
    return probability


def _along(directions: Array, vectors: Array) -> Array:
    product: Array = directions[..., 0] * vectors[:, 0, None] + directions[..., 1] * vectors[:, 1, None]
    return product


def _spread(directions: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """The variance along directions (m, k, 2), by powers of time: c0 + 2 c1 t + c2 t^2."""
    x, y = directions[..., 0], directions[..., 1]

    def along(block: Array) -> Array:
        result: Array = (
            x * x * block[:, 0, 0, None]
            + x * y * (block[:, 0, 1, None] + block[:, 1, 0, None])
            + y * y * block[:, 1, 1, None]
        )
        return result

    position, velocity = (np.maximum(along(covariance[:, part, part]), 0.0) for part in (slice(2), slice(2, 4)))
    return position, along(covariance[:, :2, 2:]), velocity


def _at(spread: tuple[Array, Array, Array], time: Array | float) -> Array:
    return np.maximum(spread[0] + 2.0 * time * spread[1] + time * time * spread[2], 0.0)


def _greatest_deviation(covariance: Array) -> Array:
    """The square root of the greatest eigenvalue of symmetric matrices; (m, 2, 2) to (m,)."""
    half, cross = 0.5 * (covariance[:, 0, 0] - covariance[:, 1, 1]), 0.5 * (covariance[:, 0, 1] + covariance[:, 1, 0])
    middle = 0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1])
    return np.sqrt(np.maximum(middle + np.hypot(half, cross), 0.0))
