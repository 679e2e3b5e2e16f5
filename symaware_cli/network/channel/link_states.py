"""The states of links: what is remembered of each link that was ever used."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices
from symaware_cli.network.channel.backlog import Backlog, RecentTransmissions
from symaware_cli.world.chance import Numbers, agent_numbers, combined, key_of

#: Later than any run ends, and early enough for sums of it not to overflow, in nanoseconds.
FOREVER = 3 * 10**18


class LinkStates:
    """A row for each link, made when the link is first used.

    Attributes:
        latest: The number of the last message that was sent over each link; -1 before the first.
        keys: What each link's draws are keyed by.
        arrival: When the last message of each link arrives, in nanoseconds.
        free: When each link has carried all that waits for it, in nanoseconds.
        residue: How much later than that it really is, less than a nanosecond.
        backlog: How much waits for each.
        recent: When the last messages of each are in it, where a queue counts them.
        bad: Whether each link is in the bad state: 0 or 1, or -1 before its first message.
        channel: The number of each link's channel.
        congestion: Until when, at most, messages wait for links that have no limit of their own, in nanoseconds.
    """

    def __init__(self, seed: int, ids: Sequence[str]) -> None:
        """Know no links.

        Args:
            seed: The seed of the run.
            ids: All agents, in the roster's order.
        """
        self._count = len(ids)
        self.congestion = 0
        self._agents = agent_numbers(ids)
        self._key = key_of(seed, "links")
        #: sender * count + receiver of each known link, ascending, and the row of each.
        self._known = np.empty(0, np.int64)
        self._rows = np.empty(0, np.intp)
        #: How many rows are in use, and the link that each stands for.
        self._used = 0
        self._links = np.zeros(0, np.int64)
        self.latest = np.zeros(0, np.int64)
        self.keys: Numbers = np.zeros(0, np.uint64)
        self.arrival = np.zeros(0, np.int64)
        self.free = np.zeros(0, np.int64)
        self.residue = np.zeros(0)
        self.backlog = Backlog()
        self.recent = RecentTransmissions()
        self.bad = np.zeros(0, np.int8)
        self.channel = np.zeros(0, np.intp)

    def rows(self, senders: Indices, receivers: Indices) -> tuple[Indices, slice | None]:
        """The rows of links.

        Args:
            senders: Shape (m,).
            receivers: Shape (m,).

        Returns:
            Shape (m,), and which rows are new, if any are.
        """
        wanted = senders.astype(np.int64) * self._count + receivers
        places = np.searchsorted(self._known, wanted)
        inside = places < len(self._known)
        known = np.zeros(len(wanted), bool)
        known[inside] = self._known[places[inside]] == wanted[inside]
        if known.all():
            return self._rows[places], None
        new = np.unique(wanted[~known])
        begun = slice(self._used, self._used + len(new))
        where = np.searchsorted(self._known, new)
        self._known = np.insert(self._known, where, new)
        self._rows = np.insert(self._rows, where, np.arange(begun.start, begun.stop))
        self._enter(begun, new)
        return self._rows[np.searchsorted(self._known, wanted)], begun

    def _enter(self, rows: slice, links: NDArray[np.int64]) -> None:
        """Fill in the rows of new links; there is room for twice as many as are used, since links may come singly."""
        self._used = rows.stop
        if self._used > len(self.latest):
            room = 2 * self._used - len(self.latest)
            self._links, self.arrival, self.free = (
                np.concatenate([each, np.zeros(room, np.int64)]) for each in (self._links, self.arrival, self.free)
            )
            self.latest = np.concatenate([self.latest, np.full(room, -1, np.int64)])
            self.channel = np.concatenate([self.channel, np.zeros(room, np.intp)])
            self.keys = np.concatenate([self.keys, np.zeros(room, np.uint64)])
            self.bad = np.concatenate([self.bad, np.full(room, -1, np.int8)])
            self.residue = np.concatenate([self.residue, np.zeros(room)])
            self.backlog.grow(room)
            self.recent.grow(room)
        senders, receivers = np.divmod(links, self._count)
        self._links[rows] = links
        self.keys[rows] = combined(self._agents[senders], self._agents[receivers], self._key)

    def ends(self, rows: slice) -> tuple[Indices, Indices]:
        """The senders and receivers of some rows."""
        senders, receivers = np.divmod(self._links[rows], self._count)
        return senders.astype(np.intp), receivers.astype(np.intp)

    def number(self, rows: Indices, now: int) -> NDArray[np.int64]:
        """Number a message more on each of some links, each at most once.

        The number is the instant, so that what was sent before does not matter; of several messages at one instant each
        has one more than the one before.

        Args:
            rows: The links; shape (m,).
            now: In nanoseconds.
        """
        numbers = np.maximum(self.latest[rows] + 1, now)
        self.latest[rows] = numbers
        return numbers
