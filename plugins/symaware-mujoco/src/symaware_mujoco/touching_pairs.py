"""Pairs of bodies that touch: contacts of the engine, followed from one physics step to the next.

Reasons: docs/decisions/0079-mujoco.md
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Array, Indices
from symaware_cli.worlds import ContactTracker

#: [m] Smaller overlaps at the start count as standing on each other.
_TINY = 1e-6

_NONE: NDArray[np.int64] = np.empty(0, np.int64)

#: A sentinel greater than the number of any pair, at the end of the numbers of touching pairs, so that searches stay in
#: range.
_LAST: NDArray[np.int64] = np.array([np.iinfo(np.int64).max])


class TouchingPairs:
    """Reports to a tracker which pairs of bodies begin and cease to touch.

    A pair touches from the first contact that the engine counts until the bodies are no longer near each other. A pair
    has a number, which sorts as the indices of its two bodies do.
    """

    #: Attributes that follow from the scenario, and results of the last physics step.
    uncaptured: ClassVar[Collection[str]] = ("_owners", "_count", "_seen", "_keys", "_apart", "_any_apart")

    def __init__(self, owners: Indices, count: int) -> None:
        """Begin without touching pairs.

        Args:
            owners: The index of the body that each geometry belongs to.
            count: The number of bodies.
        """
        self._owners, self._count = owners, count
        #: The numbers of the touching pairs, ascending.
        self._touching = _LAST
        #: Results of the last step: the geometries of its contacts, the numbers of their pairs, and the contacts
        #: without touch.
        self._seen: bytes | None = None
        self._keys, self._apart, self._any_apart = _NONE, np.empty(0, bool), False

    def forget_step(self) -> None:
        """Forget the results of the last physics step, after the engine was set to another state."""
        self._seen = None

    def begin(self, data: Any, tracker: ContactTracker) -> None:
        """Report the overlaps at the start, and the bodies that stand on each other."""
        contacts = data.contact
        keys, distances, points = self._pair_keys(data), contacts.dist, contacts.pos
        resting = []
        for key in np.unique(keys).tolist():
            number = _nearest(keys, distances, key)
            depth, point = -float(distances[number]), tuple(points[number].tolist())
            if depth > _TINY:
                tracker.start(self._pair_of(key), point, depth)
            elif not contacts.exclude[number]:
                tracker.begin_resting(self._pair_of(key), point)
                resting.append(key)
        self._touching, self._seen = np.concatenate([np.array(resting, np.int64), _LAST]), None

    def follow(self, data: Any, tracker: ContactTracker, step_time: float) -> None:
        """Report contacts that began or ended in the last physics step.

        Args:
            data: The engine's data after the step.
            tracker: Receives the contacts.
            step_time: The duration of a physics step [s].
        """
        if self._seen == b"" and not data.ncon:
            return  # nothing was near before, and nothing is now
        contacts = data.contact
        # From one step to the next, mostly the same pairs are near.
        begun = ended = _NONE
        seen = contacts.geom.tobytes()
        if seen != self._seen:
            self._seen, self._keys = seen, self._pair_keys(data)
            ended = self._find_apart()
        keys = self._keys
        if self._any_apart:
            begun = np.unique(keys[self._apart & (contacts.exclude == 0)])
        if len(begun):
            distances, points = contacts.dist, contacts.pos
            for key in begun.tolist():
                number = _nearest(keys, distances, key)
                depth = max(0.0, -float(distances[number]))
                tracker.begin(self._pair_of(key), tuple(points[number].tolist()), depth)
        if tracker.fresh:
            self._add_impulses(data, tracker, step_time)
        for key in ended.tolist():
            tracker.end(self._pair_of(key))
        if len(begun) or len(ended):
            # Ended contacts are no longer near, so their keys are absent.
            held = np.setdiff1d(self._touching, ended, assume_unique=True) if len(ended) else self._touching
            self._touching = np.sort(np.concatenate([held, begun]))
            self._find_apart()

    def _find_apart(self) -> NDArray[np.int64]:
        """Find the contacts of near pairs that do not touch; return the pairs that are no longer near."""
        touching, keys = self._touching, self._keys
        places = touching.searchsorted(keys)
        touch = touching[places] == keys
        self._apart, self._any_apart = ~touch, not touch.all()
        is_over = np.ones(len(touching), bool)
        is_over[places[touch]] = is_over[-1] = False
        return touching[is_over]

    def _add_impulses(self, data: Any, tracker: ContactTracker, step_time: float) -> None:
        """Add the normal forces of this physics step to the impulses of the contacts that began in this time step."""
        keys = self._keys
        fresh = {one * self._count + other for one, other in tracker.fresh}
        addresses = data.contact.efc_address
        numbers = [number for number, key in enumerate(keys.tolist()) if key in fresh and addresses[number] >= 0]
        if not numbers:
            return
        # With elliptic cones, the first force of a contact is the one along its normal.
        forces = data.efc_force[addresses[numbers]] * step_time
        for key, impulse in zip(keys[numbers].tolist(), forces.tolist(), strict=True):
            tracker.add_impulse(self._pair_of(key), impulse)

    def _pair_keys(self, data: Any) -> NDArray[np.int64]:
        """Return the number of the pair of each contact; shape (contacts,)."""
        one, other = self._owners[data.contact.geom.T] if data.ncon else (_NONE, _NONE)
        keys: NDArray[np.int64] = np.minimum(one, other) * self._count + np.maximum(one, other)
        return keys

    def _pair_of(self, key: int) -> tuple[int, int]:
        return divmod(key, self._count)


def _nearest(keys: NDArray[np.int64], distances: Array, key: int) -> int:
    """Return the first of the nearest contacts of two bodies."""
    numbers = np.flatnonzero(keys == key)
    return int(numbers[np.argmin(distances[numbers])])
