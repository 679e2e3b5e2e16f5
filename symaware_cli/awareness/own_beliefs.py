"""The beliefs about others of a single agent: those that its own components wrote, or that it received.

Reasons: docs/decisions/0027-beliefs-of-others.md
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.awareness import AwarenessVector
from symaware_cli.awareness.shared_beliefs import Version
from symaware_cli.awareness.time_series import TimeSeries

Array = NDArray[np.float64]

#: The value of a part.
Said: TypeAlias = "Array | TimeSeries"

_NOTHING = TimeSeries()


class OwnBeliefs(Mapping[str, AwarenessVector]):
    """Awareness of others in sparse columns: motions, the times at which they were written, and values of other parts.

    As a mapping it maps ids to values. A table that was passed as a whole is shared until one of its rows is written.

    Attributes:
        places: The row of each motion, by id.
        rows: The motions by id, if they were passed as a whole and not changed since; else None.
        parts: For each other part the values by id: a series that is not empty, or a vector.
        version: A new object whenever an agent is added or removed.
    """

    __slots__ = ("_motions", "_shared", "_times", "parts", "places", "rows", "version")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Remove everything."""
        self.places: dict[str, int] = {}
        self.rows: dict[str, Array] | None = None
        self.parts: dict[str, dict[str, Said]] = {}
        self.version = Version()
        self._motions: Array = np.empty((0, 0))
        self._times: NDArray[np.int64] | int = np.empty(0, np.int64)
        self._shared = False

    def motion(self, id: str) -> Array | None:
        """Position and velocity, read-only; shape (2d,). None if it is not known."""
        place = self.places.get(id)
        if place is None:
            return None
        if self.rows is not None:
            return self.rows[id]
        motion: Array = self._motions[place].copy()
        motion.flags.writeable = False
        return motion

    def motions(self, places: NDArray[np.intp]) -> Array:
        """Some rows of the table; shape (k, 2d)."""
        chosen: Array = self._motions[places]
        return chosen

    def times(self, places: NDArray[np.intp]) -> NDArray[np.int64]:
        """When some rows of the table were written, in nanoseconds; shape (k,)."""
        if isinstance(self._times, int):
            return np.full(len(places), self._times, np.int64)
        chosen: NDArray[np.int64] = self._times[places]
        return chosen

    def set_motion(self, id: str, motion: Array, time: int) -> None:
        """Write the motion of one other; shape (2d,)."""
        self._own()
        place = self.places.get(id)
        if place is None:
            if id not in self:
                self.version = Version()
            place = self.places[id] = len(self.places)
            if place >= len(self._motions):
                room = max(4, 2 * place)
                motions, times = np.full((room, len(motion)), np.nan), np.zeros(room, np.int64)
                if place:
                    motions[:place], times[:place] = self._motions[:place], self._times[:place]  # type: ignore[index]
                self._motions, self._times = motions, times
        self._motions[place] = motion
        self._times[place] = time  # type: ignore[index]

    def set_motions(self, places: dict[str, int], motions: Array, rows: dict[str, Array], time: int) -> None:
        """Write the motions of many others at once, without a copy.

        Args:
            places: The row of each in `motions`, by id; must not be changed afterwards.
            motions: Read-only; shape (k, 2d).
            rows: The same by id.
            time: When, in nanoseconds.
        """
        if places is not self.places and not self.places.keys() <= places.keys():
            for id in places:
                self.set_motion(id, rows[id], time)
            return
        if places is not self.places:
            self.places, self.version = places, Version()
        self._motions, self._times, self.rows, self._shared = motions, time, rows, True

    def set_part(self, part: str, id: str, value: Said) -> bool:
        """Write a part of one other, and return whether its value changed."""
        known = self.parts.setdefault(part, {})
        old = known.get(id)
        if value is old:
            return False
        if isinstance(value, TimeSeries) and value == (_NOTHING if old is None else old):
            return False
        before = id in self
        if len(value):
            known[id] = value
        else:
            del known[id]
        if before != (id in self):
            self.version = Version()
        return True

    def remove(self, id: str) -> None:
        """Remove all beliefs about another.

        Raises:
            KeyError: There were none.
        """
        if id not in self:
            raise KeyError(id)
        if id in self.places:
            self._own()
            kept = [place for other, place in self.places.items() if other != id]
            self.places = {other: row for row, other in enumerate(other for other in self.places if other != id)}
            self._motions, self._times = self._motions[kept], self._times[kept]  # type: ignore[index]
        for known in self.parts.values():
            known.pop(id, None)
        self.version = Version()

    def _own(self) -> None:
        """Copy a shared table."""
        if self._shared:
            self.places, self._motions = dict(self.places), self._motions.copy()
            self._times = np.full(len(self._motions), self._times, np.int64)
            self.rows, self._shared = None, False

    def __getstate__(self) -> Any:
        """Leave out what another process can rebuild: the row of each other."""
        return None, {name: None if name == "rows" else getattr(self, name) for name in self.__slots__}

    def __getitem__(self, id: str) -> AwarenessVector:
        if id not in self:
            raise KeyError(id)
        motion = self.motion(id)
        if motion is None:
            motion = np.full(self._motions.shape[1], np.nan)
        said: dict[str, Any] = {part: known[id] for part, known in self.parts.items() if id in known}
        return AwarenessVector(id, motion, **said)

    def __contains__(self, id: object) -> bool:
        return id in self.places or any(id in known for known in self.parts.values())

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self.places, *(id for known in self.parts.values() for id in known)}))

    def __len__(self) -> int:
        return len({*self.places, *(id for known in self.parts.values() for id in known)})
