"""Collisions in the spatial world: collision filters, and the contacts that PyBullet reports."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from symaware_cli.worlds.bullet import engine
from symaware_cli.worlds.contact_tracker import ContactTracker, Pair, pair

#: The kinds of bodies as bits of collision masks, and below the kinds that each collides with. Rays are the first.
RAY, GROUND, FIXED, ON_PATH, FREE, UPRIGHT, SLAB, FACED = (1 << number for number in range(8))
#: A body that is absent collides with nothing.
ABSENT = 0
_MOVING = FREE | FACED | UPRIGHT
COLLIDES_WITH = {
    ABSENT: 0,
    GROUND: RAY | FREE,
    SLAB: FACED,
    FIXED: RAY | _MOVING,
    ON_PATH: RAY | _MOVING,
    FREE: RAY | GROUND | FIXED | ON_PATH | _MOVING,
    FACED: RAY | SLAB | FIXED | ON_PATH | _MOVING,
    UPRIGHT: RAY | FIXED | ON_PATH | _MOVING,
}

#: [m] A contact ends when the gap is wider than this; rolling wheels hop by less.
_GAP = 5e-3

#: [m] Deeper in the ground at the start counts as an overlap. The engine enlarges prisms by 1 mm on all sides.
_SUNK = 2e-3


class Collisions:
    """Reports the contacts that an engine finds to a contact tracker."""

    def __init__(self, client: int, owner: Mapping[int, int], tracker: ContactTracker, ground: int, step_time: float):
        """Initialise for a world.

        Args:
            client: The engine's client.
            owner: The tracker's index of each of the engine's bodies.
            tracker: Receives the contacts.
            ground: The tracker's index of the ground.
            step_time: Duration of a physics step [s].
        """
        self._client = client
        self._owner = owner
        self._tracker = tracker
        self._ground = ground
        self._step_time = step_time
        #: The pairs of the engine's bodies that touch, with the tracker's indices.
        self._touching: dict[tuple[int, int], Pair] = {}

    def start(self) -> None:
        """Report the bodies that overlap before the first step."""
        engine.performCollisionDetection(self._client)
        found: dict[Pair, Any] = {}
        for contact in engine.getContactPoints(physicsClientId=self._client):
            bodies = self._owners(contact[1:3])
            if bodies[1] == self._ground and contact[8] > -_SUNK:
                if contact[8] <= _GAP:
                    self._touching[contact[1:3]] = bodies
                    self._tracker.begin_resting(bodies, _middle(contact))
            elif bodies[0] != bodies[1] and contact[8] < -1e-9:
                known = found.get(bodies)
                if known is None or contact[8] < known[8]:
                    found[bodies] = contact
        for bodies in sorted(found):
            self._tracker.start(bodies, _middle(found[bodies]), -found[bodies][8])

    def update(self) -> Collection[tuple[int, int]]:
        """Report the contacts of the last physics step, and return the pairs of the engine's bodies that touch."""
        found = engine.getContactPoints(physicsClientId=self._client)
        touching = self._touching
        if not found and not touching:
            return ()
        met = {contact[1:3] for contact in found if contact[8] <= 0.0 or contact[9] > 0.0}
        if not met <= touching.keys():
            self._report_begun(met - touching.keys(), found)
        self._report_impulses(found)
        if len(met) != len(touching):
            near = {contact[1:3] for contact in found if contact[8] <= _GAP}
            # After new contacts, so that a body that slides along a wall from part to part stays in contact.
            for parts in [each for each in touching if each not in near]:
                self._tracker.end(touching.pop(parts))
        return met

    def _report_begun(self, new: set[tuple[int, int]], found: Sequence[Any]) -> None:
        """Report bodies that begin to touch."""
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

    def _report_impulses(self, found: Sequence[Any]) -> None:
        """Report the impulses of the last physics step between bodies that have just begun to touch."""
        fresh = self._tracker.fresh
        if fresh:
            for contact in found:
                # Across a gap the engine solved nothing; the impulse is that of an earlier physics step.
                if contact[8] <= 0.0 and contact[9] > 0.0:
                    bodies = self._owners(contact[1:3])
                    if bodies in fresh:
                        self._tracker.add_impulse(bodies, contact[9] * self._step_time)

    def _owners(self, parts: tuple[int, int]) -> Pair:
        """The tracker's indices of two of the engine's bodies."""
        return pair(self._owner[parts[0]], self._owner[parts[1]])


def _middle(contact: Any) -> tuple[float, ...]:
    return tuple(0.5 * (one + other) for one, other in zip(contact[5], contact[6], strict=True))
