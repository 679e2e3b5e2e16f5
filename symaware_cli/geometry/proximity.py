"""Proximity: finds pairs of bodies within a distance, by a neighbour list that is kept from step to step.

The list of candidate pairs is wider than requested by a margin (L. Verlet, "Computer 'experiments' on classical fluids
I", Phys. Rev. 159, 1967), so that it stays valid until a body has moved by half of it; only then is the index
rebuilt.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from symaware_cli.geometry.compiled_functions import compiled
from symaware_cli.geometry.vectors import Array, Indices, Mask, lengths

#: Up to this number all pairs are computed; measured: a tree pays off from about a hundred bodies.
_ALL_PAIRS = 64


class Pairs:
    """Pairs of bodies, sorted by index.

    All pairs of several runs with few bodies each are in blocks instead: one for each pair of places in a run, with
    the pair of each run. Within each run they are sorted, too.

    Attributes:
        first: The smaller index of each pair; shape (m,).
        second: The greater index; shape (m,).
        distance: The distance of each pair [m]; shape (m,).
        closest: The number of the closest pair; -1 without pairs.
        least: Its distance [m]; infinite without pairs.
        runs: The number of runs if pairs are in blocks, each of that size; otherwise 0.
    """

    __slots__ = ("closest", "distance", "first", "least", "runs", "second")

    def __init__(self, first: Indices, second: Indices, distance: Array, runs: int = 0) -> None:
        self.first = first
        self.second = second
        self.distance = distance
        self.runs = runs
        self.closest = int(distance.argmin()) if len(distance) else -1
        self.least = float(distance[self.closest]) if len(distance) else np.inf


class Proximity:
    """Finds the pairs of bodies within a distance; fast for bodies that move little between calls.

    Attributes:
        runs: The bodies of each run by index, if several runs share the arrays; shape (runs, n). Bodies of different
            runs are no pairs. None for one run.
    """

    def __init__(self) -> None:
        self.runs: Indices | None = None
        self._present: Mask | None = None
        self._built_at: Array = np.empty((0, 0))
        self._cut = -np.inf
        self._first: Indices = np.empty(0, np.intp)
        self._second: Indices = np.empty(0, np.intp)
        self._seen: Array | None = None
        self._before: Array | None = None  # the array before that
        self._directed: tuple[Indices, Indices, Indices] | None = None
        #: The bodies at each place of the runs, if pairs are in blocks; shape (n, runs).
        self._blocks: Indices | None = None
        #: The numbers of the pairs of the body at each place of a run, if those are all pairs; shape (n, n - 1).
        self._own: Indices = np.empty((0, 0), np.intp)
        #: Where the numbers of each body start, if those of all are one after another; shape (n,).
        self._starts: Indices = np.empty(0, np.intp)
        #: The pairs whose distances to the nearest other bodies are known, and these.
        self._of_each: tuple[Pairs, Array] | None = None
        self._pairs = Pairs(self._first, self._second, np.empty(0))

    @property
    def present(self) -> Mask | None:
        """Which bodies count, not to be changed in place; shape (n,). None for all of them."""
        return self._present

    @present.setter
    def present(self, present: Mask | None) -> None:
        self._present = present
        self._built_at, self._seen, self._before = np.empty((0, 0)), None, None

    @property
    def has_blocks(self) -> bool:
        """Whether pairs are in blocks; see `Pairs`."""
        return self.runs is not None and self.runs.shape[1] <= _ALL_PAIRS and self._present is None

    def pairs(self, positions: Array, reach: float) -> Pairs:
        """Return at least all pairs whose distance is at most ``reach``.

        The result may contain more pairs: callers that need an exact bound select by distance.

        Args:
            positions: One row for each body [m]; shape (n, d). Arrays are compared by identity with those of previous
                calls, so do not change one in place.
            reach: The distance [m].
        """
        if positions is self._seen and self._cut == np.inf:
            return self._pairs  # all pairs, of the bodies where they are
        if not self._valid(positions, reach):
            self._build(positions, reach)
        elif positions is self._seen:
            return self._pairs
        if self._blocks is not None:
            distance = block_distances(positions, self._blocks)
            self._pairs = Pairs(self._first, self._second, distance, self._blocks.shape[1])
        else:
            distance = pair_distances(positions, self._first, self._second)
            self._pairs = Pairs(self._first, self._second, distance)
        if positions is not self._seen:
            self._before, self._seen = self._seen, positions
        return self._pairs

    def directed(self, positions: Array, reach: float) -> tuple[Indices, Indices, Array]:
        """Return the pairs of bodies within reach of each other, in both orders.

        Args:
            positions: As for `pairs`.
            reach: The distance [m].

        Returns:
            The first index, ascending, the second index, ascending for each first one, and their distance [m]; each of
            shape (m,).
        """
        pairs = self.pairs(positions, reach)
        if self._directed is None:
            self._directed = self._both_ways(len(positions))
        one, other, number = self._directed
        distance = pairs.distance.take(number)
        near = np.flatnonzero(distance <= reach)
        return one.take(near), other.take(near), distance.take(near)

    def _both_ways(self, count: int) -> tuple[Indices, Indices, Indices]:
        """Sort the candidates in both orders by first and second index, with the number of each pair.

        All three are packed into one integer, since sorting plain numbers is several times as fast as `lexsort`. They
        fit: a hundred thousand bodies take 34 bits, which leaves room for half a billion pairs.
        """
        first, second = self._first.astype(np.int64), self._second.astype(np.int64)
        bits = len(first).bit_length()
        keys = np.concatenate([first * count + second, second * count + first]) << bits
        keys |= np.tile(np.arange(len(first)), 2)
        keys.sort()
        places = keys >> bits
        one = places // count
        return one, places - one * count, keys & ((1 << bits) - 1)

    def _valid(self, positions: Array, reach: float) -> bool:
        if positions.shape != self._built_at.shape:
            return False
        if self._cut == np.inf:
            return True
        if reach > self._cut:
            return False
        moved = self._of_present(np.abs(positions - self._built_at)).max(initial=0.0) * np.sqrt(positions.shape[1])
        return bool(reach + 2 * moved <= self._cut)

    def _build(self, positions: Array, reach: float) -> None:
        runs = np.arange(len(positions))[None] if self.runs is None else self.runs
        self._directed = self._blocks = None
        if runs.shape[1] <= _ALL_PAIRS:
            first, second = np.triu_indices(runs.shape[1], 1)
            blocks = np.ascontiguousarray(runs.T)
            self._blocks = blocks if self.has_blocks else None
            self._first, self._second = blocks[first].ravel(), blocks[second].ravel()
            self._cut = np.inf
            if self._present is None:
                own = np.concatenate([first, second]).argsort(kind="stable") % max(1, len(first))
                self._own = own.reshape(runs.shape[1], max(0, runs.shape[1] - 1))
                self._starts = np.arange(0, own.size, max(1, self._own.shape[1]))
            else:
                both = self._present[self._first] & self._present[self._second]
                self._first, self._second = self._first[both], self._second[both]
        else:
            from scipy.spatial import cKDTree

            self._cut = reach + self._margin(positions, reach)
            found = np.concatenate([self._near(cKDTree, positions, bodies) for bodies in runs])
            order = np.lexsort((found[:, 1], found[:, 0]))
            self._first, self._second = found[order, 0], found[order, 1]
        self._built_at = positions

    def _near(self, tree: Any, positions: Array, bodies: Indices) -> Indices:
        """The pairs of some bodies within the present cut; shape (m, 2)."""
        if self._present is not None:
            bodies = bodies[self._present[bodies]]
        found: Indices = bodies[tree(positions[bodies]).query_pairs(self._cut, output_type="ndarray")]
        return found

    def _of_present(self, positions: Array) -> Array:
        return positions if self._present is None else positions[self._present]

    def _margin(self, positions: Array, reach: float) -> float:
        """Return how much wider than requested the list of candidates is to be [m].

        Wide enough for about ten more steps like the last one, but not so wide that a body has more than about eight
        candidates if bodies are spread evenly: computing their distances each time costs as much as a new tree.
        """
        least = 0.1 * reach + 1e-6
        earlier = self._before if positions is self._seen else self._seen
        if earlier is None or earlier.shape != positions.shape:
            return least
        positions, earlier = self._of_present(positions), self._of_present(earlier)
        if not len(positions):
            return least
        step = float(np.abs(positions - earlier).max())
        room = float(np.prod(positions.max(axis=0) - positions.min(axis=0)))
        crowded = (8.0 * room / (np.pi * len(positions))) ** (1.0 / positions.shape[1])
        return float(max(least, min(20.0 * step, crowded - reach)))

    def nearest(self, positions: Array) -> float:
        """Return the least distance between any two bodies [m]; infinite for fewer than two."""
        if len(positions) <= _ALL_PAIRS:
            return self.pairs(positions, 0.0).least
        positions = self._of_present(positions)
        if len(positions) < 2:
            return float("inf")
        from scipy.spatial import cKDTree

        distances: Array = np.asarray(cKDTree(positions).query(positions, k=2)[0])
        return float(distances[:, 1].min())

    def nearest_to_each(self, positions: Array) -> Array:
        """Return the distance from each body to the nearest other [m]; infinite if there is none, or it is absent.

        Args:
            positions: As for `pairs`.
        """
        count = len(positions) if self.runs is None else self.runs.shape[1]
        if count > _ALL_PAIRS or self._present is not None:
            return nearest_distances(positions, self.runs)
        pairs = self.pairs(positions, 0.0)
        if self._of_each is not None and self._of_each[0] is pairs:
            return self._of_each[1]
        least: Array
        if self._blocks is None:
            if count < 2:
                least = np.full(count, np.inf)
            else:
                # For few bodies, this takes half as long as `reduce` along an axis.
                least = np.fmin.reduceat(pairs.distance.take(self._own.ravel()), self._starts)
                if math.isnan(pairs.least):
                    least = np.fmin(least, np.inf)
        else:
            least = np.empty(len(positions))
            of_pairs = pairs.distance.reshape(-1, pairs.runs)
            least[self._blocks] = np.fmin.reduce(of_pairs.take(self._own, 0), axis=1, initial=np.inf)
        least.flags.writeable = False
        self._of_each = pairs, least
        return least


@compiled
def pair_distances(positions: Array, first: Indices, second: Indices) -> Array:
    """Return the distances of pairs of bodies [m]; shape (m,).

    Args:
        positions: One row for each body [m]; shape (n, d).
        first: One body of each pair; shape (m,).
        second: The other body of each pair; shape (m,).
    """
    # `take` and plain products are five times as fast as fancy indexing and einsum for few bodies.
    columns = positions.T.copy()
    apart = columns.take(first, 1) - columns.take(second, 1)
    apart *= apart
    squared = apart[0]
    for axis in range(1, len(apart)):
        squared = squared + apart[axis]
    distance: Array = np.sqrt(squared)
    return distance


@compiled
def block_distances(positions: Array, blocks: Indices) -> Array:
    """Return the distances of all pairs of each run, as in `Pairs`.

    Nothing is gathered, and intermediate results stay in the processor's cache.

    Args:
        positions: One row for each body [m]; shape (n, d).
        blocks: The bodies at each place of the runs; shape (k, runs).
    """
    first, *others = (column.take(blocks) for column in positions.T)
    count, runs = blocks.shape
    distance = np.empty((count * (count - 1) // 2, runs))
    begin = 0
    for place in range(count - 1):
        end = begin + count - 1 - place
        squared = distance[begin:end]
        np.subtract(first[place], first[place + 1 :], out=squared)
        squared *= squared
        for values in others:
            apart = values[place] - values[place + 1 :]
            apart *= apart
            squared += apart
        np.sqrt(squared, out=squared)
        begin = end
    return distance.ravel()


class ClosestPair:
    """Finds the closest pair among bodies that move a little each time.

    The previous closest pair gives an upper bound of the present least distance.

    Attributes:
        is_shared: Whether others find pairs of the same bodies by the same means.
    """

    def __init__(self, shared: Proximity | None = None) -> None:
        """Prepare.

        Args:
            shared: Finds pairs of the same bodies for others as well, and knows which are present; by default one of
                its own.
        """
        self._proximity = Proximity() if shared is None else shared
        self.is_shared = shared is not None
        self._last: tuple[int, int] | None = None

    def __call__(self, positions: Array) -> tuple[float, int, int]:
        """Return the least distance [m], infinite if there is no pair, and the lowest indices that have it.

        Args:
            positions: One row for each body [m]; shape (n, d). A body with a NaN is absent. Not changed in place.
        """
        if not self.is_shared:
            present: Mask = np.asarray(np.isfinite(positions).all(axis=1))
            known = self._proximity.present
            if known is None or not np.array_equal(known, present):
                self._proximity.present = present
        reach = np.inf
        if self._last is not None:
            one, other = self._last
            reach = float(lengths(positions[[one]] - positions[[other]])[0])
        if not np.isfinite(reach):
            self._last = None
            reach = float(nearest_distances(positions).min(initial=np.inf))
        if not np.isfinite(reach):
            return float("inf"), -1, -1
        pairs = self._proximity.pairs(positions, reach * (1.0 + 1e-9))
        self._last = int(pairs.first[pairs.closest]), int(pairs.second[pairs.closest])
        return pairs.least, *self._last


def nearest_distances(positions: Array, runs: Indices | None = None) -> Array:
    """Return the distance from each body to the nearest other [m]; infinite if there is none.

    Args:
        positions: One row for each body [m]; shape (n, d). A body with a NaN is absent.
        runs: The bodies of each run, as in `Proximity`.
    """
    if runs is not None:
        least = np.empty(len(positions))
        for bodies in runs:
            least[bodies] = nearest_distances(positions[bodies])
        return least
    count = len(positions)
    if count <= _ALL_PAIRS:
        apart = (positions[:, None] - positions).reshape(count * count, -1)
        distances = lengths(apart).reshape(count, count)
        distances[np.isnan(distances)] = np.inf
        np.fill_diagonal(distances, np.inf)
        return np.asarray(distances.min(axis=1, initial=np.inf))
    from scipy.spatial import cKDTree

    least = np.full(count, np.inf)
    present = np.flatnonzero(np.isfinite(positions).all(axis=1))
    here = positions[present]
    if len(here) > 1:
        # The tree supplies indices only; of two bodies at the same position, either may be the first.
        found = np.asarray(cKDTree(here).query(here, k=2)[1])
        other = np.where(found[:, 0] == np.arange(len(here)), found[:, 1], found[:, 0])
        least[present] = lengths(here - here[other])
    return least


def closest_pair(positions: Array, first: Indices, second: Indices) -> tuple[float, int, int]:
    """Find the least distance between a body of one set and another body of a second one.

    Args:
        positions: One row for each body [m]; shape (n, d). A body with a NaN is absent.
        first: The indices of the first set; shape (k,).
        second: The indices of the second set; shape (m,). A body in both is not paired with itself.

    Returns:
        The distance [m], infinite if there is no pair, and the lowest indices that have it, the lesser first.
    """
    from scipy.spatial import cKDTree

    present: Mask = np.asarray(np.isfinite(positions).all(axis=1))
    first, second = first[present[first]], second[present[second]]
    none = (float("inf"), -1, -1)
    if not len(first) or not len(second):
        return none
    found, others = cKDTree(positions[second]).query(positions[first], k=[1, 2])
    itself = (others < len(second)) & (second[np.minimum(others, len(second) - 1)] == first[:, None])
    apart = np.where(itself, np.inf, found).min(axis=1)
    if not np.isfinite(apart.min()):
        return none
    # The tree may round differently: bodies with nearly the least distance are computed again, against all.
    candidates = first[apart <= apart.min() * (1.0 + 1e-9)]
    best = none
    for one in candidates.tolist():
        distances = lengths(positions[second] - positions[one])
        distances[second == one] = np.inf
        least = float(distances.min())
        other = int(second[distances == least].min())
        best = min(best, (least, min(one, other), max(one, other)), key=lambda each: (each[0], each[1:]))
    return best
