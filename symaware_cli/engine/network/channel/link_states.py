"""The states of links: what channels remember of each link that has been used."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices, Times
from symaware_cli.engine.network.disturbance import Disturbance
from symaware_cli.world import Array, Numbers, agent_numbers, combined, distinct, key_of

#: Later than the end of any run, and small enough that sums of two do not overflow, in nanoseconds.
FOREVER = 3 * 10**18


class Backlog:
    """The bytes that wait for links or are entering them, by rows of `LinkStates`.

    The time when a message enters its link is decided when it is sent. If the bandwidth has changed since, the first
    part of the backlog enters at the old rate and the rest at the new one, each at a constant rate.
    """

    def __init__(self) -> None:
        """Start without links; `grow` adds some."""
        #: The bytes that enter evenly between `_seen` and `_turn`, and those from then on, at `_pace` [bytes/s].
        self._early = np.zeros(0)
        self._late = np.zeros(0)
        self._pace = np.zeros(0)
        self._seen = np.zeros(0, np.int64)
        self._turn = np.zeros(0, np.int64)

    def grow(self, room: int) -> None:
        """Add a number of links without a backlog."""
        self._early, self._late, self._pace = (
            np.concatenate([each, np.zeros(room)]) for each in (self._early, self._late, self._pace)
        )
        self._seen, self._turn = (np.concatenate([each, np.zeros(room, np.int64)]) for each in (self._seen, self._turn))

    def settle(self, links: Indices, now: int, free: Times) -> Array:
        """Remove the data that has entered the links, and return the waiting rest [bytes].

        Args:
            links: The rows of the links; shape (m,).
            now: The present time, in nanoseconds.
            free: When the whole backlog has entered, in nanoseconds; shape (m,).
        """
        seen, turn = self._seen[links], self._turn[links]
        early = self._early[links] * _remaining(now, seen, turn)
        late = self._late[links] * _remaining(now, np.maximum(seen, turn), free)
        self._early[links], self._late[links], self._seen[links] = early, late, now
        return early + late

    def add(self, links: Indices, sizes: NDArray[np.int64], bandwidth: Array, begin: Times) -> None:
        """Add to the backlog; call `settle` first.

        Args:
            links: The rows of the links; shape (m,).
            sizes: In bytes; shape (m,).
            bandwidth: The rate at which it enters [bytes/s]; shape (m,).
            begin: When it starts to enter, in nanoseconds; shape (m,).
        """
        late = self._late[links]
        turns = (late == 0.0) | (self._pace[links] != bandwidth)
        self._early[links] += np.where(turns, late, 0.0)
        self._late[links] = np.where(turns, 0.0, late) + sizes
        self._turn[links] = np.where(turns, begin, self._turn[links])
        self._pace[links] = bandwidth


class RecentTransmissions:
    """The times when the last messages have entered their links, for limits of queue lengths, by rows of `LinkStates`.

    The times of a link ascend. So n or more messages wait for a link or are entering it if and only if the n-th last
    has not entered yet.
    """

    def __init__(self) -> None:
        """Start without links; times are stored from the first call of `last` on."""
        #: In nanoseconds, the last message first; 0 where there was none.
        self._times = np.zeros((0, 0), np.int64)

    def grow(self, room: int) -> None:
        """Add a number of links without messages."""
        self._times = np.pad(self._times, ((0, room), (0, 0)))

    def last(self, links: Indices, number: int) -> Times:
        """Return when the message with a number from the end has entered its link, in nanoseconds; shape (m,).

        Args:
            links: The rows of the links; shape (m,).
            number: 1 is the last message.
        """
        if number > self._times.shape[1]:
            self._times = np.pad(self._times, ((0, 0), (0, number - self._times.shape[1])))
        times: Times = self._times[links, number - 1]
        return times

    def add(self, links: Indices, leaving: Times) -> None:
        """Store messages, at most one for each link.

        Args:
            links: The rows of the links; shape (m,).
            leaving: When each has entered its link, in nanoseconds; shape (m,).
        """
        times = self._times[links]
        self._times[links] = np.concatenate([leaving[:, None], times[:, :-1]], axis=1)


def _remaining(now: int, begin: Times, end: Times) -> Array:
    """Return the remaining fractions of time spans."""
    length = np.maximum(end - begin, 1)
    return np.where(now >= end, 0.0, np.minimum((end - now) / length, 1.0))


class _Index:
    """Finds the rows of numbers; more can be added.

    Those added last are in a small table, so that an addition does not move all others in the large one.
    """

    def __init__(self) -> None:
        """Start without numbers."""
        self._tables = [(np.empty(0, np.int64), np.empty(0, np.intp))] * 2

    def find(self, numbers: NDArray[np.int64]) -> Indices:
        """Return the row of each number, -1 if it was not added; shape (m,)."""
        rows = np.full(len(numbers), -1, np.intp)
        for known, places in self._tables:
            if len(known):
                found = np.minimum(known.searchsorted(numbers), len(known) - 1)
                there = known[found] == numbers
                rows[there] = places[found[there]]
        return rows

    def add(self, numbers: NDArray[np.int64], rows: slice) -> None:
        """Add numbers that are not there yet, ascending, with consecutive rows."""
        large, small = self._tables
        small = _joined(small, (numbers, np.arange(rows.start, rows.stop)))
        if 16 * len(small[0]) > len(large[0]):
            large, small = _joined(large, small), (small[0][:0], small[1][:0])
        self._tables = [large, small]


def _joined(
    one: tuple[NDArray[np.int64], Indices], other: tuple[NDArray[np.int64], Indices]
) -> tuple[NDArray[np.int64], Indices]:
    """Join two tables of ascending numbers with their rows."""
    places = one[0].searchsorted(other[0]) + np.arange(len(other[0]))
    old = np.ones(len(one[0]) + len(places), bool)
    old[places] = False
    numbers, rows = np.empty(len(old), np.int64), np.empty(len(old), np.intp)
    numbers[places], rows[places] = other
    numbers[old], rows[old] = one
    return numbers, rows


class LinkStates:
    """The states of links, with a row for each link from its first use on.

    Attributes:
        latest: The number of the last message that was sent over each link; -1 before the first.
        keys: The key of each link's random draws.
        arrival: The arrival of the last message of each link, in nanoseconds.
        free: When all messages so far have entered each link, in nanoseconds.
        residue: The sub-nanosecond part of that time.
        backlog: The bytes that wait for each.
        recent: The times when the last messages have entered each, if a queue length is limited.
        bad: Whether each link is in the bad state: 0 or 1, or -1 before its first message.
        channel: The number of each link's channel.
        congestion: The latest time until which messages wait for links without a limit of their own, in nanoseconds.
    """

    def __init__(self, seed: int, ids: Sequence[str]) -> None:
        """Start without links.

        Args:
            seed: The seed of the run.
            ids: All agents, in the roster's order.
        """
        self._count = len(ids)
        self.congestion = 0
        self._ids = tuple(ids)
        self._agents = agent_numbers(ids)
        #: Disturbances because of which messages draw from other keys.
        self._redrawn: list[Disturbance] = []
        self._key = 0
        #: The rows by sender * count + receiver.
        self._index = _Index()
        #: The number of rows in use, and the link of each.
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
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Draw the fates of messages from another seed from now on."""
        self._key = key_of(seed, "links")
        if self._used:
            self._draw_keys(slice(0, self._used))

    def redraw(self, disturbances: Sequence[Disturbance]) -> None:
        """Draw the fates of messages that some disturbances concern from keys of these, and others from their own."""
        self._redrawn[:] = disturbances
        if self._used:
            self._draw_keys(slice(0, self._used))

    def rows(self, senders: Indices, receivers: Indices) -> tuple[Indices, slice | None]:
        """Return the rows of links, adding new ones.

        Args:
            senders: The senders; shape (m,).
            receivers: The receivers; shape (m,).

        Returns:
            The rows, shape (m,), and which rows are new, if any.
        """
        wanted = senders.astype(np.int64) * self._count + receivers
        rows = self._index.find(wanted)
        unknown = rows < 0
        if not unknown.any():
            return rows, None
        absent = wanted[unknown]
        new = distinct(absent)
        begun = slice(self._used, self._used + len(new))
        rows[unknown] = begun.start + new.searchsorted(absent)
        self._index.add(new, begun)
        self._enter(begun, new)
        return rows, begun

    def _enter(self, rows: slice, links: NDArray[np.int64]) -> None:
        """Initialise the rows of new links; arrays grow to twice the number in use, since links may come singly."""
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
        self._links[rows] = links
        self._draw_keys(rows)

    def _draw_keys(self, rows: slice) -> None:
        """Make the keys of some rows, from the ends of their links."""
        senders, receivers = np.divmod(self._links[rows], self._count)
        keys = combined(self._agents[senders], self._agents[receivers], self._key)
        for each in self._redrawn:
            hit = each.concerned(self._ids, senders, receivers)
            keys[hit] = combined(keys[hit], keys[hit], key_of(0, "fates drawn anew", each.draw))
        self.keys[rows] = keys

    def ends(self, rows: slice) -> tuple[Indices, Indices]:
        """Return the senders and receivers of some rows."""
        senders, receivers = np.divmod(self._links[rows], self._count)
        return senders.astype(np.intp), receivers.astype(np.intp)

    def number(self, rows: Indices, now: int) -> NDArray[np.int64]:
        """Return the number of the next message on each of some links, each at most once.

        The number is the present time in nanoseconds, so that it does not depend on earlier messages; several messages
        at one instant are numbered consecutively from it.

        Args:
            rows: The rows of the links; shape (m,).
            now: The present time, in nanoseconds.
        """
        numbers = np.maximum(self.latest[rows] + 1, now)
        self.latest[rows] = numbers
        return numbers
