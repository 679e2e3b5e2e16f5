"""Links: which agents can send messages to which others."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.world import distinct

Indices = NDArray[np.intp]
Truths = NDArray[np.bool_]


class Links:
    """Directed links between agents, as indices in the roster, sorted by sender, then by receiver; read-only.

    Attributes:
        count: The number of agents.
        senders: Ascending; shape (m,).
        receivers: Ascending for each sender; shape (m,).
        pointers: The index of the first link of each sender, then the number of links; shape (count + 1,).
    """

    __slots__ = ("_keys", "count", "pointers", "receivers", "senders")

    def __init__(self, count: int, senders: Indices, receivers: Indices) -> None:
        """Create links from sorted arrays; `of` sorts them.

        Raises:
            ValueError: An index is out of range.
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
        """Create links from arrays in any order, without duplicates and links of agents to themselves.

        Args:
            count: The number of agents.
            senders: Shape (m,).
            receivers: Shape (m,).
            both_ways: Whether each link goes in both directions.

        Raises:
            ValueError: An index is out of range.
        """
        one, other = np.asarray(senders, np.int64), np.asarray(receivers, np.int64)
        # The key of an index out of range would be that of another link.
        for ends in (one, other):
            _within(count, ends)
        keys = np.concatenate([one * count + other, other * count + one]) if both_ways else one * count + other
        return cls.keyed(count, distinct(keys))

    @classmethod
    def keyed(cls, count: int, keys: NDArray[np.int64]) -> Links:
        """Create links from their keys, ascending; see `keys`."""
        senders, receivers = np.divmod(keys, max(count, 1))
        apart = senders != receivers
        return cls(count, senders[apart].astype(np.intp), receivers[apart].astype(np.intp))

    @property
    def keys(self) -> NDArray[np.int64]:
        """A number for each link, sender * count + receiver, ascending; shape (m,)."""
        if self._keys is None:
            self._keys = self.senders.astype(np.int64) * self.count + self.receivers
        return self._keys

    def has(self, senders: Indices, receivers: Indices) -> Truths:
        """Return which pairs of senders and receivers have a link; shape (m,)."""
        if len(self) == self.count * (self.count - 1):
            apart: Truths = senders != receivers
            return apart
        wanted, keys = np.asarray(senders, np.int64) * self.count + receivers, self.keys
        if not len(keys):
            return np.zeros(len(wanted), bool)
        found: Truths = keys[np.minimum(keys.searchsorted(wanted), len(keys) - 1)] == wanted
        return found

    def of_sender(self, sender: int) -> Indices:
        """The receivers that one agent reaches, ascending."""
        return self.receivers[self.pointers[sender] : self.pointers[sender + 1]]

    def degrees(self) -> Indices:
        """The number of receivers of each agent; shape (count,)."""
        return np.diff(self.pointers)

    def among(self, present: NDArray[np.bool_]) -> Links:
        """The links whose two ends are both present; `present` has a flag for each agent, shape (count,)."""
        kept = present[self.senders] & present[self.receivers]
        return self if kept.all() else Links(self.count, self.senders[kept], self.receivers[kept])

    def parts(self) -> Indices:
        """The connected part that each agent belongs to, as a number: its members reach each other, directly or not."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        weights = np.ones(len(self), np.float64)
        matrix: Any = csr_array((weights, self.receivers, self.pointers), shape=(self.count, self.count))
        labels = connected_components(matrix, directed=True, connection="strong")[1]
        # Numbered in the order of the roster, independent of the order of the search.
        _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
        numbers: Indices = np.argsort(np.argsort(first))[inverse]
        return numbers

    def __len__(self) -> int:
        return len(self.senders)


def _within(count: int, ends: NDArray[np.integer[Any]]) -> None:
    """Check that indices are those of agents."""
    if len(ends) and not (ends.min() >= 0 and ends.max() < count):
        wrong = int(ends[(ends < 0) | (ends >= count)][0])
        raise ValueError(f"a link ends at the agent of index {wrong}, and there are {count} agents")
