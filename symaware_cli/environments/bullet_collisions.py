"""Collisions in the spatial world: who meets whom, and what PyBullet finds of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from symaware_cli.environments.bullet import engine
from symaware_cli.environments.contact_tracker import ContactTracker, Pair, pair

#: What collides with what: the group of each kind of body, and the groups that it meets. Rays are of the first.
RAY, GROUND, FIXED, LED, FREE, UPRIGHT, SLAB, FACED = (1 << number for number in range(8))
#: What is not there meets nobody.
NOWHERE = 0
_MOVING = FREE | FACED | UPRIGHT
MEETS = {
    NOWHERE: 0,
    GROUND: RAY | FREE,
    SLAB: FACED,
    FIXED: RAY | _MOVING,
    LED: RAY | _MOVING,
    FREE: RAY | GROUND | FIXED | LED | _MOVING,
    FACED: RAY | SLAB | FIXED | LED | _MOVING,
    UPRIGHT: RAY | FIXED | LED | _MOVING,
}

#: [m] A contact has ended when the gap is wider than this; wheels that roll hop by less.
_GAP = 5e-3

#: [m] What is deeper in the ground at the start overlaps it. Prisms are 1 mm too large for the engine on all sides.
_SUNK = 2e-3


class Collisions:
    """Tells a tracker what an engine finds of bodies that touch."""

    def __init__(self, client: int, owner: Mapping[int, int], tracker: ContactTracker, ground: int, step_time: float):
        """Take note of the world.

        Args:
            client: The engine's client.
            owner: Whose each of the engine's bodies is, as in the tracker.
            tracker: Who is told.
            ground: The owner of the ground.
            step_time: A physics step [s].
        """
        self._client = client
        self._owner = owner
        self._tracker = tracker
        self._ground = ground
        self._step_time = step_time
        #: Which of the engine's bodies touch, and whose they are.
        self._touching: dict[tuple[int, int], Pair] = {}

    def start(self) -> None:
        """Tell who overlaps before anything has moved."""
        engine.performCollisionDetection(self._client)
        found: dict[Pair, Any] = {}
        for contact in engine.getContactPoints(physicsClientId=self._client):
            bodies = self._owners(contact[1:3])
            if bodies[1] == self._ground and contact[8] > -_SUNK:
                if contact[8] <= _GAP:
                    self._touching[contact[1:3]] = bodies
                    self._tracker.rest(bodies, _middle(contact))
            elif bodies[0] != bodies[1] and contact[8] < -1e-9:
                known = found.get(bodies)
                if known is None or contact[8] < known[8]:
                    found[bodies] = contact
        for bodies in sorted(found):
            self._tracker.start(bodies, _middle(found[bodies]), -found[bodies][8])

    def update(self) -> Collection[tuple[int, int]]:
        """Tell what the last physics step found, and return which of the engine's bodies pressed on each other."""
        found = engine.getContactPoints(physicsClientId=self._client)
        touching = self._touching
        if not found and not touching:
            return ()
        met = {contact[1:3] for contact in found if contact[8] <= 0.0 or contact[9] > 0.0}
        if not met <= touching.keys():
            self._begin(met - touching.keys(), found)
        self._press(found)
        if len(met) != len(touching):
            near = {contact[1:3] for contact in found if contact[8] <= _GAP}
            # After those that begin, so that who slides along a wall from part to part stays in contact.
            for parts in [each for each in touching if each not in near]:
                self._tracker.end(touching.pop(parts))
        return met

    def _begin(self, new: set[tuple[int, int]], found: Sequence[Any]) -> None:
        """Tell who begins to touch."""
        contacts: dict[Pair, list[Any]] = {}
        for contact in found:
            if contact[1:3] in new:
                contacts.setdefault(self._owners(contact[1:3]), []).append(contact)
        for bodies in sorted(contacts):
            nearest = min(contacts[bodies], key=lambda contact: contact[8])
            for parts in dict.fromkeys(contact[1:3] for contact in contacts[bodies]):
                self._touching[parts] = bodies
                if bodies[0] != bodies[1]:
                    self._tracker.begin(bodies, _middle(nearest), max(0.0, -nearest[8]))

    def _press(self, found: Sequence[Any]) -> None:
        """Tell how hard those pressed on each other in the last physics step who have just begun to touch."""
        fresh = self._tracker.fresh
        if fresh:
            for contact in found:
                # Where there is a gap, the engine solved nothing, and what it tells is of an earlier physics step.
                if contact[8] <= 0.0 and contact[9] > 0.0:
                    bodies = self._owners(contact[1:3])
                    if bodies in fresh:
                        self._tracker.press(bodies, contact[9] * self._step_time)

    def _owners(self, parts: tuple[int, int]) -> Pair:
        """Whose two of the engine's bodies are."""
        return pair(self._owner[parts[0]], self._owner[parts[1]])


def _middle(contact: Any) -> tuple[float, ...]:
    return tuple(0.5 * (one + other) for one, other in zip(contact[5], contact[6], strict=True))
