"""Contacts: which bodies touch, from when until when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Contact, Obstacle
from symaware_cli.core.proximity import Proximity

Array = NDArray[np.float64]


class ContactDetector:
    """Tells when two bodies begin and cease to touch.

    Two agents touch, or an agent and an obstacle; obstacles among themselves do not count.
    """

    def __init__(
        self, ids: Sequence[str], radii: Sequence[float], obstacles: Mapping[str, Obstacle], proximity: Proximity
    ) -> None:
        self._agents = len(ids)
        self._names = [*ids, *obstacles]
        self._radii = np.array([*radii, *(obstacle.radius for obstacle in obstacles.values())])
        self._obstacles = [obstacle.position for obstacle in obstacles.values()]
        self._proximity = Proximity() if obstacles else proximity
        #: The farthest apart that two bodies can touch; points touch nothing.
        largest = float(self._radii[: self._agents].max(initial=0.0))
        self._reach = largest + float(self._radii.max(initial=0.0)) if largest else 0.0
        self._touching: dict[tuple[int, int], Contact] = {}

    def update(self, positions: Array) -> Sequence[Contact]:
        """Return the contacts that begin or end where the agents are now.

        Args:
            positions: One row for each agent [m]; shape (n, d).
        """
        if not self._reach:
            return ()
        bodies = positions
        if self._obstacles:
            dimensions = positions.shape[1]
            fixed = [(*position, 0.0)[:dimensions] for position in self._obstacles]
            bodies = np.concatenate([positions, np.array(fixed)])
        pairs = self._proximity.pairs(bodies, self._reach)
        if pairs.least > self._reach and not self._touching:
            return ()
        depth = self._radii[pairs.first] + self._radii[pairs.second] - pairs.distance
        near = np.flatnonzero(depth > 0.0)
        return self._compare(bodies, pairs.first[near], pairs.second[near], depth[near])

    def _compare(
        self, bodies: Array, first: NDArray[np.intp], second: NDArray[np.intp], depth: Array
    ) -> Sequence[Contact]:
        now: dict[tuple[int, int], Contact] = {}
        for one, other, overlap in zip(first.tolist(), second.tolist(), depth.tolist(), strict=True):
            if one >= self._agents or not (self._radii[one] and self._radii[other]):
                continue
            present = self._touching.get((one, other))
            now[one, other] = present or self._contact(bodies, one, other, overlap)
        began = [contact for pair, contact in now.items() if pair not in self._touching]
        ended = [
            Contact(contact.first, contact.second, contact.point, 0.0, begins=False)
            for pair, contact in self._touching.items()
            if pair not in now
        ]
        self._touching = now
        return sorted([*began, *ended], key=lambda contact: (contact.first, contact.second))

    def _contact(self, bodies: Array, one: int, other: int, overlap: float) -> Contact:
        towards = bodies[other] - bodies[one]
        distance = float(np.sqrt(towards @ towards))
        share = (self._radii[one] - 0.5 * overlap) / distance if distance else 0.0
        point = bodies[one] + share * towards
        first, second = sorted((self._names[one], self._names[other]))
        return Contact(first, second, tuple(point.tolist()), overlap)
