"""Contact tracking: turns the reports of a physics engine in each physics step into contacts that begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from symaware_cli.core import Contact

#: The name of the ground in contacts.
GROUND = "ground"

#: Two bodies, by index, the smaller first.
Pair = tuple[int, int]


def pair(one: int, other: int) -> Pair:
    """Return two bodies in order."""
    return (one, other) if one < other else (other, one)


class ContactTracker:
    """Tracks which bodies touch, from one physics step to the next.

    A body of several parts touches as long as one of them does.

    Attributes:
        agents: The number of present contacts in which an agent takes part.
        fresh: The contacts that began in this time step and still last: their index in the changes, and their impulse
            [N s], to which `add_impulse` adds.
        names: The name of each body, by index.
    """

    def __init__(self, names: Sequence[str], agents: int) -> None:
        """Initialise without contacts.

        Args:
            names: The name of each body, by index.
            agents: The number of agents; they have the first indices.
        """
        self.agents = 0
        self._first_other = agents
        self.names = names
        self._touching: dict[Pair, int] = {}
        self._points: dict[Pair, tuple[float, ...]] = {}
        #: Overlaps at the start, already reported; that the engine reports them as well is no change.
        self._reported_at_start: set[Pair] = set()
        self._changes: list[Contact] = []
        self.fresh: dict[Pair, tuple[int, float]] = {}

    def start(self, bodies: Pair, point: tuple[float, ...], depth: float) -> None:
        """Report bodies that overlap at the start."""
        if bodies not in self._reported_at_start:
            self._reported_at_start.add(bodies)
            self._points[bodies] = point
            self._changes.append(self._contact(bodies, point, depth))

    def begin_resting(self, bodies: Pair, point: tuple[float, ...]) -> None:
        """Store bodies that touch at the start because one stands on the other, which is not reported."""
        if bodies not in self._touching:
            self._begin_contact(bodies)
            self._points[bodies] = point

    def begin(self, bodies: Pair, point: tuple[float, ...], depth: float, impulse: float | None = None) -> None:
        """Count a part of one body that begins to touch a part of the other.

        Args:
            bodies: The two bodies.
            point: The point of contact [m].
            depth: Depth of the overlap [m].
            impulse: The impulse [N s]; None if `add_impulse` supplies it.
        """
        if bodies in self._touching:
            self._touching[bodies] += 1
            return
        self._begin_contact(bodies)
        if bodies in self._reported_at_start:
            self._reported_at_start.discard(bodies)
        else:
            self._points[bodies] = point
            if impulse is None:
                self.fresh[bodies] = len(self._changes), 0.0
            self._changes.append(self._contact(bodies, point, depth, impulse=impulse or 0.0))

    def add_impulse(self, bodies: Pair, impulse: float) -> None:
        """Add to the impulse of a contact that began in this time step [N s]; others are ignored."""
        if bodies in self.fresh:
            index, before = self.fresh[bodies]
            self.fresh[bodies] = index, before + impulse

    def end(self, bodies: Pair) -> None:
        """Count a part of one body that ceases to touch a part of the other."""
        count = self._touching.pop(bodies, 0)
        if count > 1:
            self._touching[bodies] = count - 1
        elif count:
            self._store_impulse(bodies)
            self.agents -= bodies[0] < self._first_other
            self._end_contact(bodies)

    def end_time_step(self) -> None:
        """End a time step; contacts of the start that the engine does not confirm end here."""
        for bodies in list(self.fresh):
            self._store_impulse(bodies)
        for bodies in sorted(self._reported_at_start):
            self._end_contact(bodies)
        self._reported_at_start.clear()

    def take_changes(self) -> Sequence[Contact]:
        """Return and forget the contacts that began or ended since the last call, sorted by the names of the bodies."""
        changes, self._changes = self._changes, []
        return sorted(changes, key=lambda contact: (contact.first, contact.second))

    def _end_contact(self, bodies: Pair) -> None:
        self._changes.append(self._contact(bodies, self._points.pop(bodies), 0.0, begins=False))

    def _store_impulse(self, bodies: Pair) -> None:
        if bodies in self.fresh:
            index, impulse = self.fresh.pop(bodies)
            self._changes[index] = replace(self._changes[index], impulse=impulse)

    def _begin_contact(self, bodies: Pair) -> None:
        self._touching[bodies] = 1
        self.agents += bodies[0] < self._first_other

    def _contact(
        self, bodies: Pair, point: tuple[float, ...], depth: float, begins: bool = True, impulse: float = 0.0
    ) -> Contact:
        first, second = self.names[bodies[0]], self.names[bodies[1]]
        if first > second:
            first, second = second, first
        return Contact(first, second, point, depth, begins, impulse)
