"""Contact detection: reports when bodies begin and cease to overlap, for worlds without a physics engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Contact, EntityGroup, Scenery, Snapshot
from symaware_cli.geometry import Array, BodyOutlines, Indices, Pairs, Pieces, Proximity, Separation, separation

#: Pairs of bodies that touch, by index, and a function that returns depth and point of a row.
_Touching = tuple[Indices, Indices, Callable[[int], tuple[float, Array]]]

#: An instant [ns] before all others.
_NEVER = -(2**62)


class ContactDetector:
    """Reports when two bodies begin and cease to touch.

    Contacts are between two agents, or between an agent and an obstacle, not between obstacles; an agent without a
    shape has none. Bodies touch if they overlap: grazing does not count.

    Round agents are balls. Boxes and polygons turn with the element of the state that the model calls its heading, or
    do not turn at all; in space their outlines seen from above are compared once their bounding balls meet. Obstacles
    are compared as seen from above, too: they are as high as the world.
    """

    def __init__(
        self,
        groups: Sequence[EntityGroup],
        scenery: Scenery,
        proximity: Proximity,
        time_step: int = 0,
        debounce: int = 0,
    ) -> None:
        """Prepare for the bodies of a world.

        Args:
            groups: The groups in the roster's order.
            scenery: The obstacles.
            proximity: Finds the agents that are near each other.
            time_step: Time between two calls of `begun` [ns].
            debounce: How long two bodies must be apart until `begun` reports them again [ns].
        """
        ids = [id for group in groups for id in group.ids]
        counts = [len(group.ids) for group in groups]
        shapes = [group.entity.shape for group in groups]
        self._agents = len(ids)
        self._names = [*ids, *scenery.names]
        self._bodies = BodyOutlines([shape.pieces[0] if shape else None for shape in shapes], counts)
        #: Negative infinity for a body without a shape, so that nothing touches it.
        self._radii = np.where(np.repeat([shape is not None for shape in shapes], counts), self._bodies.radii, -np.inf)
        self._cornered, self._any_cornered = self._bodies.cornered, self._bodies.any_cornered
        #: The greatest distance at which two agents can touch.
        self._reach = max(0.0, 2.0 * float(self._radii.max(initial=0.0)))
        self._equal_radii = bool((self._radii == self._radii[:1]).all())
        self._proximity = proximity
        #: How long ago bodies must have touched to begin a new contact [ns].
        self._pause = time_step + max(debounce, 1)
        #: When pairs in blocks touched last [ns]; None before they are looked at.
        self._touched: NDArray[np.int64] | None = None
        self._among_agents = _TouchingPairs(self._names, self._pause)
        self._with_obstacles = _TouchingPairs(self._names, self._pause)

    def update(self, snapshot: Snapshot, scenery: Scenery) -> Sequence[Contact]:
        """Return the contacts that begin or end, sorted by the names of the bodies.

        Args:
            snapshot: The agents now.
            scenery: The obstacles now.
        """
        if not self._reach:
            return ()
        positions = snapshot.positions
        pairs = self._proximity.pairs(positions, self._reach)
        changes: list[Contact] = []
        if pairs.least < self._reach or self._among_agents.touching:
            changes = self._among_agents.changes(*self._touching_agents(snapshot, positions, pairs))
        if scenery.names:
            changes += self._with_obstacles.changes(*self._touching_obstacles(snapshot, positions, scenery))
        if len(changes) > 1:
            changes.sort(key=lambda contact: (contact.first, contact.second))
        return changes

    def begun(self, snapshot: Snapshot, scenery: Scenery) -> Indices:
        """Return the index of an agent of each contact that begins, without making the contacts; called at each step.

        Args:
            snapshot: Where the agents are now.
            scenery: Where the obstacles are now.
        """
        if not self._reach:
            return np.empty(0, np.intp)
        positions = snapshot.positions
        pairs = self._proximity.pairs(positions, self._reach)
        if pairs.runs and not self._any_cornered:
            begun = self._begun_in_blocks(pairs, snapshot.time)
        else:
            first, second, _ = self._touching_agents(snapshot, positions, pairs)
            begun = self._among_agents.begun(first, second, snapshot.time)
        if scenery.names:
            agent, obstacle, _ = self._touching_obstacles(snapshot, positions, scenery)
            begun = np.concatenate([begun, self._with_obstacles.begun(agent, obstacle, snapshot.time)])
        return begun

    def _begun_in_blocks(self, pairs: Pairs, now: int) -> Indices:
        """Return the first agent of each contact that begins among pairs which are always the same."""
        touching = np.flatnonzero(pairs.distance < self._reaches(pairs))
        if self._touched is None:
            self._touched = np.full(len(pairs.distance), _NEVER)
        new = touching[now - self._touched[touching] >= self._pause]
        self._touched[touching] = now
        return pairs.first.take(new)

    def _reaches(self, pairs: Pairs) -> float | Array:
        """Return the distance below which the balls of each pair overlap [m]."""
        return self._reach if self._equal_radii else self._radii.take(pairs.first) + self._radii.take(pairs.second)

    def _touching_agents(self, snapshot: Snapshot, positions: Array, pairs: Pairs) -> _Touching:
        near = np.flatnonzero(pairs.distance < self._reaches(pairs))
        first, second = pairs.first.take(near), pairs.second.take(near)
        number = np.full(len(near), -1)
        cornered = (
            np.flatnonzero(self._cornered.take(first) | self._cornered.take(second)) if self._any_cornered else ()
        )
        if len(cornered):
            ones, others = first.take(cornered), second.take(cornered)
            bodies = self._placed(snapshot, positions, np.concatenate([ones, others]))
            half = np.arange(len(cornered))
            exact = separation(bodies.take(half), bodies.take(half + len(cornered)))
            number[cornered] = half
            touch = number < 0
            touch[cornered] = exact.distance < 0.0
            first, second, number = first[touch], second[touch], number[touch]

        def where(row: int) -> tuple[float, Array]:
            one, other = positions[first[row]], positions[second[row]]
            if number[row] < 0:
                return self._between(first[row], second[row], one, other)
            return _middle(exact, number[row], 0.5 * (one + other))

        return first, second, where

    def _between(self, first: int, second: int, one: Array, other: Array) -> tuple[float, Array]:
        """Return how deep two balls overlap, and the middle of the overlap on the line of their centres."""
        towards = other - one
        distance = float(np.sqrt(towards @ towards))
        depth = float(self._radii[first] + self._radii[second]) - distance
        share = (self._radii[first] - 0.5 * depth) / distance if distance else 0.0
        return depth, one + share * towards

    def _touching_obstacles(self, snapshot: Snapshot, positions: Array, scenery: Scenery) -> _Touching:
        agent, piece = scenery.candidates(positions, self._radii)
        if not len(agent):
            return agent, piece, _nowhere
        found = separation(self._placed(snapshot, positions, agent), scenery.pieces.take(piece))
        obstacle = scenery.owner.take(piece)
        overlapping = np.flatnonzero(found.distance < 0.0)
        # Of several pieces of an obstacle, the one that is overlapped most is sorted first, and kept.
        order = np.lexsort((found.distance[overlapping], obstacle[overlapping], agent[overlapping]))
        chosen = overlapping[order]
        changing = np.diff(agent[chosen], prepend=-1) | np.diff(obstacle[chosen], prepend=-1)
        chosen = chosen[changing != 0]

        def where(row: int) -> tuple[float, Array]:
            return _middle(found, chosen[row], positions[agent[chosen[row]]])

        return agent[chosen], self._agents + obstacle[chosen], where

    def _placed(self, snapshot: Snapshot, positions: Array, agents: Indices) -> Pieces:
        """Return the outlines of agents at their positions."""
        if not self._any_cornered:
            return Pieces.points(positions[:, :2].take(agents, 0), self._radii.take(agents))
        return self._bodies.placed(agents, positions, snapshot.headings)


class _TouchingPairs:
    """Remembers which pairs of bodies touch.

    Attributes:
        touching: The contact of each pair that touches, as it began.
    """

    def __init__(self, names: Sequence[str], pause: int) -> None:
        self.touching: dict[int, Contact] = {}
        self._names = names
        self._pause = pause
        self._last_keys = b""
        #: The pairs that touched within the pause, and when [ns]; shape (m,).
        self._keys: Indices = np.empty(0, np.intp)
        self._times = np.empty(0, np.int64)

    def begun(self, first: Indices, second: Indices, now: int) -> Indices:
        """Return the first body of each contact that begins at an instant [ns]; see `changes`."""
        keys = np.sort(first * len(self._names) + second)
        recent = np.flatnonzero(now - self._times < self._pause)
        known = self._keys[recent]
        new = keys[~np.isin(keys, known, assume_unique=True, kind="sort")]
        apart = recent[~np.isin(known, keys, assume_unique=True, kind="sort")]
        self._times = np.concatenate([self._times[apart], np.full(len(keys), now)])
        self._keys = np.concatenate([self._keys[apart], keys])
        return new // len(self._names)

    def changes(self, first: Indices, second: Indices, where: Callable[[int], tuple[float, Array]]) -> list[Contact]:
        """Return the contacts that begin or end.

        Args:
            first: One body of each pair that touches now, by index; shape (m,). Pairs come in a fixed order.
            second: The other; shape (m,).
            where: Returns depth and point of a row; called for new contacts only.
        """
        keys = first * len(self._names) + second
        key_bytes = keys.tobytes()
        if key_bytes == self._last_keys:
            return []
        self._last_keys = key_bytes
        before, self.touching, changes = self.touching, {}, []
        for row, key in enumerate(keys.tolist()):
            contact = before.pop(key, None)
            if contact is None:
                names = sorted((self._names[first[row]], self._names[second[row]]))
                depth, point = where(row)
                contact = Contact(names[0], names[1], tuple(point.tolist()), depth)
                changes.append(contact)
            self.touching[key] = contact
        # The pairs that remain do not touch any more.
        changes += [Contact(was.first, was.second, was.point, 0.0, begins=False) for was in before.values()]
        return changes


def _middle(found: Separation, row: int, height: Array) -> tuple[float, Array]:
    """Return how deep two bodies overlap, and the middle of the overlap; in space at the height of a position."""
    middle = 0.5 * (found.first[row] + found.second[row])
    return -float(found.distance[row]), np.concatenate([middle, height[2:]])


def _nowhere(row: int) -> tuple[float, Array]:
    raise AssertionError(f"no pair touches, and so not pair {row}")
