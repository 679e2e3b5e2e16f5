"""The beliefs of all agents of a group about others, written by components of the group, in arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.part import Part
from symaware_cli.awareness.tracks import Tracks
from symaware_cli.world import as_motion, frozen

if TYPE_CHECKING:
    from symaware_cli.world import Clock, Roster, Snapshot

Array = NDArray[np.float64]


class Version:
    """Identifies a version of the beliefs: there is a new object after each change."""

    __slots__ = ()


class SharedBeliefs:
    """The beliefs of all agents of a group about others, as components of the whole group wrote them.

    Beliefs that components of single agents wrote take precedence; `AwarenessDatabase` combines both.

    Attributes:
        roster: The agents that the indices in `tracks` refer to; set with the world.
        clock: Simulated time; set with the world.
        holders: The rows of the agents with own beliefs about the motion of others.
        others_changed: For each part, the rows whose own beliefs changed since the last record.
        parts: The parts of awareness, by name.
        sound: The version whose motions were found finite.
        version: A new object whenever something is written for the whole group.
    """

    __slots__ = (
        "_count",
        "_joined",
        "_joined_of",
        "_name",
        "_received",
        "_seen",
        "_world",
        "clock",
        "holders",
        "others_changed",
        "parts",
        "roster",
        "sound",
        "version",
    )

    def __init__(self, count: int, name: str, parts: Iterable[Part]) -> None:
        self._count = count
        self._name = name
        self.parts = {part.name: part for part in parts}
        self._world: Snapshot | None = None
        self._seen: Tracks | None = None
        self._received: Tracks | None = None
        self._joined: Tracks | None = None
        self._joined_of: object = None
        self.version = self.sound = Version()
        self.roster: Roster | None = None
        self.clock: Clock | None = None
        self.holders: set[int] = set()
        self.others_changed: dict[str, set[int]] = {"state": set()}

    @property
    def world(self) -> Snapshot | None:
        """The common knowledge of agents that perceive everything: one snapshot, without a copy for each pair."""
        return self._world

    @world.setter
    def world(self, snapshot: Snapshot | None) -> None:
        self._world, self.version = snapshot, Version()

    @property
    def seen(self) -> Tracks | None:
        """The beliefs of each agent about others that it perceives or perceived, from a perception or an estimator."""
        return self._seen

    @seen.setter
    def seen(self, tracks: Tracks | None) -> None:
        self._seen, self.version = tracks, Version()

    @property
    def received(self) -> Tracks | None:
        """The beliefs of each agent about others from received messages."""
        return self._received

    @received.setter
    def received(self, tracks: Tracks | None) -> None:
        self._received, self.version = tracks, Version()

    @property
    def tracks(self) -> Tracks | None:
        """The beliefs of each agent about others: perception takes precedence over messages that are not more recent.

        None if there are no beliefs, or if all of them are in `world`.
        """
        if self._received is None:
            return self._seen
        if self._joined_of is not self.version:
            self._joined, self._joined_of = self._join(self._seen, self._received, self._world), self.version
        return self._joined

    def _join(self, seen: Tracks | None, received: Tracks, world: Snapshot | None) -> Tracks | None:
        if seen is None and world is not None:
            if received.instants.max(initial=world.time) <= world.time:
                return None
            seen = self.everybody(world)
        return received if seen is None else seen.updated(received)

    def motion(self, id: str, state: ArrayLike, *, is_state: bool = False) -> Array:
        """Convert a statement about another agent into the common layout of beliefs about others; see `as_motion`."""
        roster = self.roster
        if roster is None:
            return frozen(state)
        return as_motion(id, state, roster.model(id), roster.dimensions, is_state=is_state)

    def everybody(self, world: Snapshot) -> Tracks:
        """Expand a shared snapshot into a row for each agent and each other."""
        return Tracks.of_everybody(world, world.roster.start(self._name), self._count)
