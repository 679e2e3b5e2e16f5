"""Contact tracking: what a physics engine says of bodies that meet, as contacts that begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from symaware_cli.core import Contact

#: What contacts call the ground.
GROUND = "ground"

#: Two bodies, by index, the lesser first.
Pair = tuple[int, int]


def pair(one: int, other: int) -> Pair:
    """Put two bodies into order."""
    return (one, other) if one < other else (other, one)


class ContactTracker:
    """Keeps which bodies touch, from one physics step to the next.

    A body of several parts touches as long as one of them does.

    Attributes:
        agents: How many contacts an agent takes part in.
        fresh: Those that began to touch in this time step and still do: their place in the news, and how hard, which
            `press` adds up [N s].
        names: The name of each body, by index.
    """

    def __init__(self, names: Sequence[str], agents: int) -> None:
        """Start with nobody touching.

        Args:
            names: The name of each body, by index.
            agents: How many of them, the first ones, are agents.
        """
        self.agents = 0
        self._first_other = agents
        self.names = names
        self._touching: dict[Pair, int] = {}
        self._points: dict[Pair, tuple[float, ...]] = {}
        #: What overlaps at the start was told then; that the engine finds it, too, is no news.
        self._told: set[Pair] = set()
        self._news: list[Contact] = []
        self.fresh: dict[Pair, tuple[int, float]] = {}

    def start(self, bodies: Pair, point: tuple[float, ...], depth: float) -> None:
        """Tell of bodies that overlap at the start."""
        if bodies not in self._told:
            self._told.add(bodies)
            self._points[bodies] = point
            self._news.append(self._contact(bodies, point, depth))

    def rest(self, bodies: Pair, point: tuple[float, ...]) -> None:
        """Take note of bodies that touch at the start because one stands on the other, which is no news."""
        if bodies not in self._touching:
            self._join(bodies)
            self._points[bodies] = point

    def begin(self, bodies: Pair, point: tuple[float, ...], depth: float, impulse: float | None = None) -> None:
        """A part of one begins to touch a part of the other.

        Args:
            bodies: Which.
            point: Where [m].
            depth: How deep [m].
            impulse: How hard [N s]; None if `press` tells, of that physics step, too.
        """
        if bodies in self._touching:
            self._touching[bodies] += 1
            return
        self._join(bodies)
        if bodies in self._told:
            self._told.discard(bodies)
        else:
            self._points[bodies] = point
            if impulse is None:
                self.fresh[bodies] = len(self._news), 0.0
            self._news.append(self._contact(bodies, point, depth, impulse=impulse or 0.0))

    def press(self, bodies: Pair, impulse: float) -> None:
        """Add to the impulse of those that are fresh; of others it is no news [N s]."""
        if bodies in self.fresh:
            place, before = self.fresh[bodies]
            self.fresh[bodies] = place, before + impulse

    def end(self, bodies: Pair) -> None:
        """A part of one ceases to touch a part of the other."""
        count = self._touching.pop(bodies, 0)
        if count > 1:
            self._touching[bodies] = count - 1
        elif count:
            self._sum_up(bodies)
            self.agents -= bodies[0] < self._first_other
            self._part(bodies)

    def settle(self) -> None:
        """End a time step; part those that were told of at the start, and whom the engine does not find to touch."""
        for bodies in list(self.fresh):
            self._sum_up(bodies)
        for bodies in sorted(self._told):
            self._part(bodies)
        self._told.clear()

    def take(self) -> Sequence[Contact]:
        """Return what began and ended since the last time, sorted by the names of the bodies."""
        news, self._news = self._news, []
        return sorted(news, key=lambda contact: (contact.first, contact.second))

    def _part(self, bodies: Pair) -> None:
        self._news.append(self._contact(bodies, self._points.pop(bodies), 0.0, begins=False))

    def _sum_up(self, bodies: Pair) -> None:
        if bodies in self.fresh:
            place, impulse = self.fresh.pop(bodies)
            self._news[place] = replace(self._news[place], impulse=impulse)

    def _join(self, bodies: Pair) -> None:
        self._touching[bodies] = 1
        self.agents += bodies[0] < self._first_other

    def _contact(
        self, bodies: Pair, point: tuple[float, ...], depth: float, begins: bool = True, impulse: float = 0.0
    ) -> Contact:
        first, second = self.names[bodies[0]], self.names[bodies[1]]
        if first > second:
            first, second = second, first
        return Contact(first, second, point, depth, begins, impulse)
