"""Outlines of many bodies: placement, gaps between bodies, and the nearest pair.

Contacts, summaries, plots and replays share this definition: in space, bodies count as seen from above once their
bounding balls meet. Two bodies touch if their separation is 0, and overlap if it is negative.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.geometry.pieces import Pieces, separation
from symaware_cli.geometry.proximity import Pairs, Proximity, nearest_distances
from symaware_cli.geometry.vectors import Array, Indices, Mask

#: A core and the radius by which it is rounded, as in `Pieces.of`.
Outline = tuple[Sequence[Sequence[float]], float]


class NearestPair(NamedTuple):
    """The two bodies that are nearest to each other.

    Attributes:
        gap: The gap between their outlines; negative if they overlap [m].
        one: The body with the smaller index.
        other: The other body.
    """

    gap: float
    one: int
    other: int


class BodyOutlines:
    """The outlines of bodies, by index.

    Attributes:
        radii: The radii of the bounding circles around the positions [m]; shape (n,).
        cornered: Whether each body is not a disc; shape (n,).
        any_cornered: Whether any of them is not a disc.
    """

    def __init__(self, outlines: Sequence[Outline | None], counts: Sequence[int] | None = None) -> None:
        """Store the outlines.

        Args:
            outlines: The outline of each body, or of each kind; None for points.
            counts: The number of bodies of each kind, in order; one by default.
        """
        known = [([(0.0, 0.0)], 0.0) if each is None else each for each in outlines]
        self._set(Pieces.of(known), np.repeat(np.arange(len(known)), 1 if counts is None else counts))

    def some(self, bodies: Indices) -> BodyOutlines:
        """Return the outlines of some bodies, by index."""
        chosen = BodyOutlines.__new__(BodyOutlines)
        chosen._set(self._kinds, self._kind.take(bodies))
        return chosen

    def _set(self, kinds: Pieces, kind: Indices) -> None:
        self._kinds, self._kind = kinds, kind
        vertices = self._kinds.vertices
        reach = np.sqrt((vertices * vertices).sum(axis=2)).max(axis=1, initial=0.0)
        self.radii: Array = (reach + self._kinds.rounding).take(self._kind)
        self.cornered: Mask = (reach > 0.0).take(self._kind)
        self.any_cornered = bool(self.cornered.any())
        self._largest = float(self.radii.max(initial=0.0))
        self._alike = not self.any_cornered and bool((self.radii == self.radii[:1]).all())

    def __len__(self) -> int:
        return len(self._kind)

    def outlines(self, bodies: Indices) -> Pieces:
        """Return the outlines of some bodies around the origin, x along their headings."""
        return self._kinds.take(self._kind.take(bodies))

    def placed(self, bodies: Indices, positions: Array, headings: Array) -> Pieces:
        """Return the outlines of some bodies at their poses.

        Args:
            bodies: The indices of the bodies; shape (m,).
            positions: The positions of all bodies [m]; shape (n, d).
            headings: The headings of all bodies [rad]; shape (n,).
        """
        places = positions[:, :2].take(bodies, 0)
        if not self.any_cornered:
            return Pieces.points(places, self.radii.take(bodies))
        return self.outlines(bodies).placed(places, headings.take(bodies))

    def gaps(self, one: Indices, other: Indices, distance: Array, positions: Array, headings: Array) -> Array:
        """Return the gaps between bodies, pair by pair.

        Args:
            one: The first body of each pair, by index; shape (m,).
            other: The second body; shape (m,).
            distance: The distance between their positions [m]; shape (m,).
            positions: The positions of all bodies [m]; shape (n, d).
            headings: The headings of all bodies [rad]; shape (n,).

        Returns:
            The gaps between the outlines [m]; shape (m,).
        """
        gaps: Array = distance - self.radii.take(one) - self.radii.take(other)
        if self.any_cornered:
            some = np.flatnonzero(self.cornered.take(one) | self.cornered.take(other))
            first = self.placed(one.take(some), positions, headings)
            flat = separation(first, self.placed(other.take(some), positions, headings)).distance
            gaps[some] = np.maximum(flat, gaps[some])
        return gaps

    def nearest(
        self, positions: Array, headings: Array, proximity: Proximity, below: float = np.inf
    ) -> NearestPair | None:
        """Find the nearest pair.

        Args:
            positions: The positions of all bodies [m]; shape (n, d).
            headings: The headings of all bodies [rad]; shape (n,).
            proximity: Finds the bodies that are near each other.
            below: Consider smaller gaps only [m].

        Returns:
            The pair; None if no gap is below.
        """
        if len(positions) < 2:
            return None
        if below == np.inf:
            # The gap between bounding discs is an upper bound.
            below = float(np.nextafter(proximity.nearest(positions) * (1 + 1e-12), np.inf))
            if below == np.inf:
                return None
        pairs = proximity.pairs(positions, max(0.0, below + 2.0 * self._largest))
        if self._alike:
            gap = pairs.least - 2.0 * self._largest
            if gap >= below:
                return None
            return NearestPair(gap, int(pairs.first[pairs.closest]), int(pairs.second[pairs.closest]))
        bound = pairs.distance - self.radii.take(pairs.first) - self.radii.take(pairs.second)
        near = np.flatnonzero(bound < below)
        if not len(near):
            return None
        one, other = pairs.first.take(near), pairs.second.take(near)
        gaps = self.gaps(one, other, pairs.distance.take(near), positions, headings)
        best = int(gaps.argmin())
        if not gaps[best] < below:
            return None
        return NearestPair(float(gaps[best]), int(one[best]), int(other[best]))

    def nearest_to_each(self, positions: Array, headings: Array) -> tuple[Array, Indices]:
        """Find the nearest other body of each of two or more bodies.

        Args:
            positions: The positions of all bodies [m]; shape (n, d).
            headings: The headings of all bodies [rad]; shape (n,).

        Returns:
            The gap between both outlines, negative if they overlap [m], and the index of the other body; each of
            shape (n,).
        """
        from scipy.spatial import cKDTree

        count = len(positions)
        tree, bodies = cKDTree(positions), np.arange(count)
        asked = 2 if self._alike else min(count, 6)
        while True:
            apart, other = (np.asarray(found) for found in tree.query(positions, k=asked))
            one = np.repeat(bodies, asked)
            gaps = self.gaps(one, other.ravel(), apart.ravel(), positions, headings).reshape(apart.shape)
            gaps[other == bodies[:, None]] = np.inf
            best = gaps.argmin(axis=1)
            gap = gaps[bodies, best]
            # Bodies that were not considered are farther away than the last one that was.
            if asked == count or (gap <= apart[:, -1] - self.radii - self._largest).all():
                return gap, other[bodies, best]
            asked = min(count, 2 * asked)

    def nearest_of_runs(
        self, positions: Array, headings: Array, proximity: Proximity, run_of: Indices, below: Array
    ) -> tuple[Indices, Array, Indices]:
        """Find the nearest two of each run, like `nearest` for one run.

        Args:
            positions: Of all bodies [m]; shape (n, d).
            headings: Of all bodies [rad]; shape (n,).
            proximity: Which of them are near each other, in each run.
            run_of: The run of each body; shape (n,).
            below: For each run, only if they are nearer than this [m]; shape (runs,).

        Returns:
            The runs in which two are so near, ascending, shape (k,); their gaps [m], shape (k,), and the two, shape
            (k, 2).
        """
        if proximity.has_blocks and not self.any_cornered:
            return self._nearest_in_blocks(proximity.pairs(positions, 0.0), below)
        limits = below
        if np.isinf(below).any():
            least = np.full(len(below), np.inf)
            np.minimum.at(least, run_of, nearest_distances(positions, proximity.runs))
            limits = np.where(np.isinf(below), np.nextafter(least * (1 + 1e-12), np.inf), below)
        reach = float(limits[np.isfinite(limits)].max(initial=0.0))
        pairs = proximity.pairs(positions, max(0.0, reach + 2.0 * self._largest))
        if self._alike:
            bound = pairs.distance - 2.0 * self._largest
        else:
            bound = pairs.distance - self.radii.take(pairs.first) - self.radii.take(pairs.second)
        near = np.flatnonzero(bound < limits.take(run_of.take(pairs.first)))
        one, other, distance = pairs.first.take(near), pairs.second.take(near), pairs.distance.take(near)
        gaps = bound.take(near) if self._alike else self.gaps(one, other, distance, positions, headings)
        runs = run_of.take(one)
        # Gaps of different distances may be rounded to the same number.
        order = np.lexsort((np.arange(len(near)), distance if self._alike else gaps, runs))
        order = order[gaps[order] < limits[runs[order]]]
        first = order[np.diff(runs[order], prepend=-1) != 0]
        return runs[first], gaps[first], np.stack([one[first], other[first]], axis=1)

    def _nearest_in_blocks(self, pairs: Pairs, below: Array) -> tuple[Indices, Array, Indices]:
        """Find the nearest two discs of each run; see `nearest_of_runs`."""
        if self._alike:
            nearness = pairs.distance.reshape(-1, pairs.runs)
        else:
            nearness = pairs.distance - self.radii.take(pairs.first) - self.radii.take(pairs.second)
            nearness = nearness.reshape(-1, pairs.runs)
        closest = nearness.argmin(axis=0) * pairs.runs + np.arange(pairs.runs)
        gaps = nearness.ravel().take(closest)
        if self._alike:
            gaps -= 2.0 * self._largest
        runs = np.flatnonzero(gaps < below)
        closest = closest[runs]
        return runs, gaps[runs], np.stack([pairs.first[closest], pairs.second[closest]], axis=1)
