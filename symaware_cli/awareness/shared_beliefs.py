"""What all agents of a group believe of others by components of the group, in arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.part import Part
from symaware_cli.awareness.tracks import Tracks
from symaware_cli.world.arrays import frozen
from symaware_cli.world.motion import as_motion

if TYPE_CHECKING:
    from symaware_cli.world.roster import Roster
    from symaware_cli.world.snapshot import Snapshot
    from symaware_cli.world.time import Clock

Array = NDArray[np.float64]


class Version:
    """Stands for what was known at some time: there is another one whenever something else is known."""

    __slots__ = ()


class SharedBeliefs:
    """What all agents of a group believe of others, as components of the whole group wrote it.

    It lies beneath what components of single agents wrote; `AwarenessDatabase` has both, and the rules.

    Attributes:
        roster: Who the indices in `tracks` stand for; set when the world is.
        clock: Simulated time; set when the world is.
        holders: The rows of those agents that hold by themselves where others are.
        others_changed: For each part, the rows that hold something else by themselves than at the last record.
        parts: What parts awareness has, by name.
        version: Another object whenever something is written for the whole group.
    """

    __slots__ = (
        "_count",
        "_joined",
        "_joined_of",
        "_name",
        "_seen",
        "_told",
        "_world",
        "clock",
        "holders",
        "others_changed",
        "parts",
        "roster",
        "version",
    )

    def __init__(self, count: int, name: str, parts: Iterable[Part]) -> None:
        self._count = count
        self._name = name
        self.parts = {part.name: part for part in parts}
        self._world: Snapshot | None = None
        self._seen: Tracks | None = None
        self._told: Tracks | None = None
        self._joined: Tracks | None = None
        self._joined_of: object = None
        self.version = Version()
        self.roster: Roster | None = None
        self.clock: Clock | None = None
        self.holders: set[int] = set()
        self.others_changed: dict[str, set[int]] = {"state": set()}

    @property
    def world(self) -> Snapshot | None:
        """What all agents know of everybody, where they perceive everything; one snapshot, no copy for each pair."""
        return self._world

    @world.setter
    def world(self, snapshot: Snapshot | None) -> None:
        self._world, self.version = snapshot, Version()

    @property
    def seen(self) -> Tracks | None:
        """What each agent believes of the others it perceives or perceived, as perception or an estimator wrote it."""
        return self._seen

    @seen.setter
    def seen(self, tracks: Tracks | None) -> None:
        self._seen, self.version = tracks, Version()

    @property
    def told(self) -> Tracks | None:
        """What each agent believes of others by what they say."""
        return self._told

    @told.setter
    def told(self, tracks: Tracks | None) -> None:
        self._told, self.version = tracks, Version()

    @property
    def tracks(self) -> Tracks | None:
        """What each agent believes of others: what is seen wins over what was told, unless that is more recent.

        None where nobody believes anything, or where all that counts is the `world`.
        """
        if self._told is None:
            return self._seen
        if self._joined_of is not self.version:
            self._joined, self._joined_of = self._join(self._seen, self._told, self._world), self.version
        return self._joined

    def _join(self, seen: Tracks | None, told: Tracks, world: Snapshot | None) -> Tracks | None:
        if seen is None and world is not None:
            if told.instants.max(initial=world.time) <= world.time:
                return None
            seen = self.everybody(world)
        return told if seen is None else seen.updated(told)

    def motion(self, id: str, state: ArrayLike, *, is_state: bool = False) -> Array:
        """Bring what somebody says of another agent into the layout of all beliefs of others; see `as_motion`."""
        roster = self.roster
        if roster is None:
            return frozen(state)
        return as_motion(id, state, roster.model(id), roster.dimensions, is_state=is_state)

    def everybody(self, world: Snapshot) -> Tracks:
        """Write out a snapshot that all agents share: a row for each of them and each other."""
        return Tracks.of_everybody(world, world.roster.start(self._name), self._count)
