"""Promises as data: the agents that make and receive each, its region, and the positions that kept promises allow."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from symaware_cli.core import AgentGroup, Confined, Confinement, KnowledgeDatabase, Part, Quantity, Tracks
from symaware_cli.geometry import Pieces, RegionShape, separation
from symaware_cli.specification import FurtherNames, Keys, Names

#: A core and a radius, as for `Pieces.of`.
Piece: TypeAlias = tuple[Sequence[Sequence[float]], float]

OnBroken = Literal["distrust", "stop", "event"]

#: The trust of an agent in the promises of another; about itself, the least of all others.
TRUST = Part(
    "trust",
    columns=[Quantity("kept", "1"), Quantity("relied", "1")],
    description="the share of the promises of another that it kept as far as the agent knows, and whether the agent "
    "relies on them (1); of itself, the least of all others",
)
_KEPT, _RELIED = 0, 1

#: The key of the section, by which components find the promises.
SECTION = "promises"

#: The kind of messages that tell promises.
PROMISE = "promise"

#: The name under which an agent's knowledge of another has the names of the promises that it was told.
_TOLD = "promises.told"

#: The names that conditions may refer to.
MAY_MEET, KEPT = "may_meet", "kept"


@dataclass(frozen=True)
class Promise:
    """A promise of an agent to stay in a region.

    Attributes:
        name: The name of the promise in the scenario.
        of: The id of the agent that makes the promise.
        to: The ids of the agents that the promise is made to.
        shape: The convex primitive that the agent stays in.
        confidence: The declared probability with which the promise is kept.
        on_broken: The reaction of an agent that believes that the promise is broken.
        formula: The formula as it is written.
        is_told: Whether it is known only from a message on; otherwise from the beginning of the run.
    """

    name: str
    of: str
    to: frozenset[str]
    shape: RegionShape
    confidence: float
    on_broken: OnBroken
    formula: str = ""
    is_told: bool = False

    @property
    def piece(self) -> Piece:
        """The region, seen from above."""
        shape = self.shape
        if shape.circle is not None:
            return [shape.circle.centre[:2]], shape.circle.radius
        if shape.box is not None:
            left, right, low, high = shape.box[:4]
            return [(left, low), (right, low), (right, high), (left, high)], 0.0
        assert shape.polygon is not None
        return shape.polygon, 0.0


class Reliance(NamedTuple):
    """The components of agents whose results rely on promises, by name.

    Attributes:
        paid: Those whose results include the declared probability that a promise is broken.
        if_kept: Those whose results hold if promises are kept.
    """

    paid: tuple[str, ...] = ()
    if_kept: tuple[str, ...] = ()

    def of(self, promise: Promise) -> str:
        """Return what relying on a promise means, in words."""
        parts = []
        if self.paid:
            names = " and ".join(f"`{each}`" for each in self.paid)
            parts.append(
                f"{names} {'includes' if len(self.paid) == 1 else 'include'} {1.0 - promise.confidence:.4g} for it"
            )
        if self.if_kept:
            names = " and ".join(f"`{each}`" for each in self.if_kept)
            parts.append(f"{names} {'holds' if len(self.if_kept) == 1 else 'hold'} if it is kept")
        return f"relies on `{promise.name}` of {promise.of}: {'; '.join(parts)}"


class Promises(Confinement, FurtherNames):
    """The promises of a scenario, as components find them in ``group.sections["promises"]``.

    The trust of an agent in promises is in its awareness, as the part `trust` about each other agent. The promises that
    it received by messages are in its knowledge of the others.
    """

    #: Promises follow from the scenario.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(
        self,
        promises: Sequence[Promise],
        radii: Mapping[str, float],
        reliance: Mapping[str, Reliance] | None = None,
    ) -> None:
        """Store the promises.

        Args:
            promises: All promises, in the order of their names.
            radii: The radius of the bounding circle of each agent's body, by id [m].
            reliance: The components of each group that rely on promises, by the name of the group.
        """
        self.promises = tuple(promises)
        self.reliance = reliance or {}
        self._radii = radii

    def to(self, receiver: str) -> list[Promise]:
        """Return the promises that are made to an agent."""
        return [each for each in self.promises if receiver in each.to]

    def known(self, group: AgentGroup, row: int) -> list[Promise]:
        """Return the promises to an agent that it knows: from the beginning of the run, or from a message."""
        database = group.agents[row].knowledge_database
        return [
            each
            for each in self.to(group.ids[row])
            if not each.is_told or (each.of in database and each.name in database[each.of].get(_TOLD, ()))
        ]

    def learn(self, group: AgentGroup, row: int, of: str, names: Iterable[str]) -> list[Promise]:
        """Add promises that an agent received from another one to its knowledge; return those that are new to it."""
        known = {each.name for each in self.known(group, row) if each.of == of}
        new = [each for each in self.to(group.ids[row]) if each.of == of and each.name in {*names} - known]
        if new:
            about = group.agents[row].knowledge_database.setdefault(of, KnowledgeDatabase())
            about[_TOLD] = [*about.get(_TOLD, ()), *(each.name for each in new)]
        return new

    def confined(self, group: AgentGroup, tracks: Tracks) -> Confined | None:
        """See `Confinement`: the sets of the promises on which each agent relies.

        A loop over agents, because beliefs about trust belong to pairs of agents.
        """
        roster = group.surroundings.environment.roster
        rows: list[int] = []
        sets: list[Piece] = []
        breach: list[float] = []
        for row, id in enumerate(group.ids):
            own = self.known(group, row) if self.to(id) else ()
            for place in range(*tracks.pointers[row : row + 2].tolist()) if own else ():
                other = roster.ids[tracks.others[place]]
                if not self._relies(group, row, other):
                    continue
                for each in own:
                    if each.of == other:
                        rows.append(place)
                        sets.append(each.piece)
                        breach.append(1.0 - each.confidence)
        return Confined(np.array(rows, np.intp), Pieces.of(sets), np.array(breach)) if rows else None

    def breach(self, group: AgentGroup) -> Mapping[tuple[int, int], float]:
        """See `Confinement`."""
        roster = group.surroundings.environment.roster
        total: dict[tuple[int, int], float] = {}
        for row, id in enumerate(group.ids):
            for each in self.to(id):
                pair = row, roster.indices[each.of]
                total[pair] = total.get(pair, 0.0) + 1.0 - each.confidence
        return total

    def names(self, group: AgentGroup) -> Names:
        """See `FurtherNames`: ``may_meet(adam, bob)`` and ``kept(adam)``."""
        others = tuple(dict.fromkeys(each.of for id in group.ids for each in self.to(id)))
        if not others:
            return {}
        agents = tuple(self._radii)
        return {
            MAY_MEET: Keys("agent", dict.fromkeys(agents, Keys("agent", agents))),
            KEPT: Keys("agent that promised something to one of these", others),
        }

    def look_up(self, group: AgentGroup, row: int, name: str) -> Any:
        """See `FurtherNames`."""
        if name == KEPT:
            return {each.of: self._trust(group, row, each.of)[_KEPT] for each in self.to(group.ids[row])}
        return _Meetings(self, group, row)

    def may_meet(self, group: AgentGroup, row: int, one: str, other: str) -> bool:
        """Return whether the bodies of two agents may touch, as far as an agent knows.

        The bodies cannot touch if both agents stay in their promised regions, and these are farther apart than the sum
        of the radii.
        """
        sets = [self._sets(group, row, id) for id in (one, other)]
        if one == other or not all(sets):
            return True
        reach = self._radii[one] + self._radii[other]
        pairs = [(first, second) for first in sets[0] for second in sets[1]]
        found = separation(Pieces.of(first for first, _ in pairs), Pieces.of(second for _, second in pairs))
        return bool((found.distance <= reach).all())

    def _sets(self, group: AgentGroup, row: int, id: str) -> list[Piece]:
        """Return the sets in which an agent stays according to another; for itself, those that it promised."""
        viewer = group.ids[row]
        if id == viewer:
            return [each.piece for each in self.promises if each.of == id]
        if not self._relies(group, row, id):
            return []
        return [each.piece for each in self.known(group, row) if each.of == id]

    def _relies(self, group: AgentGroup, row: int, other: str) -> bool:
        return bool(self._trust(group, row, other)[_RELIED] > 0.0)

    @staticmethod
    def _trust(group: AgentGroup, row: int, other: str) -> Any:
        trust = group.agents[row].awareness_database.part(TRUST.name, other)
        return (1.0, 0.0) if trust is None else trust


class _Meetings:
    """The value of `may_meet` in conditions, which is called with two agents."""

    def __init__(self, promises: Promises, group: AgentGroup, row: int, one: str | None = None) -> None:
        self._promises, self._group, self._row, self._one = promises, group, row, one

    def __getitem__(self, id: str) -> Any:
        if self._one is None:
            return _Meetings(self._promises, self._group, self._row, id)
        return self._promises.may_meet(self._group, self._row, self._one, id)
