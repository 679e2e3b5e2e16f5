"""Topologies: which agents reach which others with their messages."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from symaware_cli.core.message import Indices
from symaware_cli.core.plugin import Parameters, Plugin
from symaware_cli.core.refusal import RefusalError
from symaware_cli.core.world import Roster

if TYPE_CHECKING:
    from symaware_cli.core.environment import Environment


class TopologyError(RefusalError):
    """A topology cannot be as its parameters want it; `path` is one of these, such as ``("edges", 3)``."""


class Links:
    """Directed links between agents, as indices in the roster, sorted by sender, then by receiver; read-only.

    Attributes:
        count: How many agents there are.
        senders: Ascending; shape (m,).
        receivers: Ascending for each sender; shape (m,).
        pointers: Where the links of each agent as a sender begin, and at last their number; shape (count + 1,).
    """

    __slots__ = ("_keys", "count", "pointers", "receivers", "senders")

    def __init__(self, count: int, senders: Indices, receivers: Indices) -> None:
        """Take links that are sorted already; `of` sorts them.

        Raises:
            ValueError: An index stands for nobody.
        """
        for ends in (senders, receivers):
            _within(count, ends)
        self.count = count
        self.senders = senders
        self.receivers = receivers
        self._keys: NDArray[np.int64] | None = None
        self.pointers = np.zeros(count + 1, np.intp)
        np.cumsum(np.bincount(senders, minlength=count), out=self.pointers[1:])

    @classmethod
    def of(cls, count: int, senders: Indices, receivers: Indices, *, both_ways: bool = False) -> Links:
        """Sort links, each counted once, and leave out those of agents with themselves.

        Args:
            count: How many agents there are.
            senders: Shape (m,).
            receivers: Shape (m,).
            both_ways: Whether each stands for both directions.

        Raises:
            ValueError: An index stands for nobody.
        """
        one, other = np.asarray(senders, np.int64), np.asarray(receivers, np.int64)
        # A key of an end that does not exist would be that of another link.
        for ends in (one, other):
            _within(count, ends)
        keys = np.concatenate([one * count + other, other * count + one]) if both_ways else one * count + other
        return cls.keyed(count, np.unique(keys))

    @classmethod
    def keyed(cls, count: int, keys: NDArray[np.int64]) -> Links:
        """Make links of their keys, ascending; see `keys`."""
        senders, receivers = np.divmod(keys, max(count, 1))
        apart = senders != receivers
        return cls(count, senders[apart].astype(np.intp), receivers[apart].astype(np.intp))

    @property
    def keys(self) -> NDArray[np.int64]:
        """A number for each link, sender * count + receiver, ascending; shape (m,)."""
        if self._keys is None:
            self._keys = self.senders.astype(np.int64) * self.count + self.receivers
        return self._keys

    def of_sender(self, sender: int) -> Indices:
        """Whom one agent reaches, ascending."""
        return self.receivers[self.pointers[sender] : self.pointers[sender + 1]]

    def degrees(self) -> Indices:
        """How many each agent reaches; shape (count,)."""
        return np.diff(self.pointers)

    def among(self, present: NDArray[np.bool_]) -> Links:
        """The links that both begin and end at some agents, of which a flag for each, shape (count,), tells."""
        kept = present[self.senders] & present[self.receivers]
        return self if kept.all() else Links(self.count, self.senders[kept], self.receivers[kept])

    def parts(self) -> Indices:
        """A number for each agent: those of one number reach each other, if not at once then through others."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        weights = np.ones(len(self), np.float64)
        matrix: Any = csr_array((weights, self.receivers, self.pointers), shape=(self.count, self.count))
        labels = connected_components(matrix, directed=True, connection="strong")[1]
        # Numbered in the order of the roster, whatever order the search had.
        _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
        numbers: Indices = np.argsort(np.argsort(first))[inverse]
        return numbers

    def __len__(self) -> int:
        return len(self.senders)


def _within(count: int, ends: NDArray[np.integer[Any]]) -> None:
    """Look whether indices are those of agents."""
    if len(ends) and not (ends.min() >= 0 and ends.max() < count):
        wrong = int(ends[(ends < 0) | (ends >= count)][0])
        raise ValueError(f"a link ends at the agent of index {wrong}, and there are {count} agents")


class TopologyParameters(Parameters):
    """What every topology can be told."""

    members: tuple[str, ...] = Field(
        ("*",),
        min_length=1,
        description="Who takes part, in this order: ids, groups or patterns, such as `leader` and `robot.*`. "
        "All others reach nobody.",
    )


class Topology(Plugin, ABC):
    """Tells which agents reach which others.

    Attributes:
        changes: Whether the links may change from step to step.
        environment: The world.
        roster: Who is who.
        seed: The seed of the run.
        members: Those who take part, as indices in the roster, in their order.
        takes_part: Whether each agent is one of them; shape (n,).
    """

    Parameters: ClassVar[type[BaseModel]] = TopologyParameters

    changes: ClassVar[bool] = False

    environment: Environment
    roster: Roster
    seed: int
    members: Indices
    takes_part: NDArray[np.bool_]

    def initialise(self, environment: Environment, seed: int) -> None:
        """Learn of the world. A subclass that overrides this calls it first.

        Args:
            environment: Who is who is known; where they are, not before `begin`.
            seed: The seed of the run.

        Raises:
            TopologyError: The parameters do not fit who is there.
        """
        self.environment = environment
        self.roster = environment.roster
        self.seed = seed
        patterns = self.parameters.members
        found = [
            (index, number) for number, each in enumerate(patterns) for index in self.find(each, "members", number)
        ]
        self.members = np.array(list(dict.fromkeys(index for index, _ in found)), np.intp)
        self.takes_part = np.zeros(len(self.roster), bool)
        self.takes_part[self.members] = True

    def find(self, pattern: str, *path: str | int) -> list[int]:
        """The agents that an id, the name of a group or a pattern means, as indices in the roster.

        Args:
            pattern: Whom.
            path: The parameter it stands in.

        Raises:
            TopologyError: There is nobody.
        """
        try:
            return self.roster.matching(pattern)
        except KeyError:
            known = (*self.roster.groups, *self.roster.ids)
            message = f"there is no agent or group `{pattern}`"
            raise TopologyError(message, *path, name=pattern, names=known) from None

    def find_members(self, pattern: str, *path: str | int) -> list[int]:
        """The same, but only those who take part.

        Args:
            pattern: Whom.
            path: The parameter it stands in.

        Raises:
            TopologyError: There is nobody, or none of them takes part.
        """
        found = [index for index in self.find(pattern, *path) if self.takes_part[index]]
        if not found:
            ids = tuple(self.roster.ids[member] for member in self.members)
            raise TopologyError(f"`{pattern}` takes no part, as it is not among the `members`", *path, names=ids)
        return found

    def begin(self, now: int) -> None:
        """Begin to hold, at the start or after another topology did.

        One that remembers links forgets them here: agents have moved meanwhile.

        Args:
            now: In nanoseconds.
        """
        return

    @abstractmethod
    def links(self, now: int) -> Links:
        """The links at a step of the world, in nanoseconds; the same object as before where nothing changed."""
