"""Inboxes: messages that have arrived and have not been read yet."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Container, Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery, Message
from symaware_cli.core.message import Indices
from symaware_cli.world import record


def in_order(arrived: Sequence[Delivery]) -> Sequence[Delivery]:
    """Order deliveries so that each receiver reads its messages oldest first.

    Messages of equal times are ordered by the sender's index in the roster, then by the sender's own order. Messages of
    one delivery stay together if possible: a delivery is split only if a receiver has another message in between.

    Args:
        arrived: The deliveries, each in this order within itself.
    """
    if len(arrived) < 2:
        return arrived
    firsts, lasts = ([_key(each, place) for each in arrived] for place in (0, -1))
    order = sorted(range(len(arrived)), key=firsts.__getitem__)
    arrived = [arrived[place] for place in order]
    if all(lasts[before] <= firsts[after] for before, after in itertools.pairwise(order)):
        return arrived
    counts = [len(each) for each in arrived]
    source = np.repeat(np.arange(len(arrived)), counts)
    columns = zip(*((each.due, each.senders, each.sequences, each.receivers) for each in arrived), strict=True)
    due, senders, sequences, receivers = map(np.concatenate, columns)
    # Assign messages to rounds: each receiver goes through the sources in turn, round after round.
    by_receiver = np.lexsort((sequences, senders, due, receivers))
    sources, theirs = source[by_receiver], receivers[by_receiver]
    begins = np.concatenate([[True], theirs[1:] != theirs[:-1]])
    steps = np.concatenate([[0], np.diff(sources) % len(arrived)])
    steps[begins] = 0
    total = np.cumsum(steps)
    start = np.maximum.accumulate(np.where(begins, np.arange(len(total)), 0))
    turn = np.empty(len(total), np.int64)
    turn[by_receiver] = total - total[start] + sources[start]
    within = np.arange(len(source)) - np.repeat(np.cumsum(counts) - counts, counts)
    by_turn = np.argsort(turn, kind="stable")
    cuts = np.flatnonzero(np.diff(turn[by_turn])) + 1
    pieces = []
    for piece in np.split(by_turn, cuts):
        whole = arrived[int(source[piece[0]])]
        pieces.append(whole if len(piece) == len(whole) else whole.some(within[piece]))
    return pieces


def _key(delivery: Delivery, place: int) -> tuple[int, int, int]:
    sender = delivery.batch.senders[delivery.rows[place]]
    return int(delivery.due[place]), int(sender), int(delivery.sequences[place])


#: The order of messages read one by one: by time of arrival, sender, number.
_OLDEST = itemgetter(0, 1, 2)


@record
class Reader:
    """Components of one entry of a group that alone read messages of certain kinds.

    Attributes:
        name: The component's path if it reads in columns, else its name.
        first: The roster index of the first of its agents.
        last: The roster index after the last of them.
        kinds: The kinds of messages that it reads.
        columns: Whether one component reads the messages of all its agents, in columns.
    """

    name: str
    first: int
    last: int
    kinds: frozenset[str]
    columns: bool


class Inboxes:
    """Stores messages for the components that read them."""

    def __init__(self, ids: Sequence[str], listening: Container[str] | None) -> None:
        """Open an inbox for each listening agent.

        Args:
            ids: All agents, in the roster's order.
            listening: The agents that read all messages without another reader; None for all.
        """
        self._ids = ids
        self._rank = {id: rank for rank, id in enumerate(ids)}
        self._listens = [listening is None or id in listening for id in ids]
        self._readers: list[Reader] = []
        self._names_of: dict[tuple[int, str], tuple[str, ...]] = {}
        self._singly_of: dict[str, NDArray[np.bool_] | None] = {}
        self._is_closed = np.zeros(len(ids), bool)
        self._closed = 0
        #: By receiver and reader: the arrival time, sender, number, and row of each message.
        self._single: dict[tuple[int, str], list[tuple[int, int, int, int, Delivery]]] = {}
        self._columns: dict[str, list[Delivery]] = {}

    def open(self, name: str, agents: Sequence[str], kinds: Collection[str], *, columns: bool) -> None:
        """Store messages of certain kinds for components of a group; see `Reader`.

        Args:
            name: As in `Reader`.
            agents: The receivers; consecutive in the roster, in its order.
            kinds: As in `Reader`.
            columns: As in `Reader`.
        """
        first = self._rank[agents[0]]
        self._readers.append(Reader(name, first, first + len(agents), frozenset(kinds), columns))
        self._names_of.clear()
        self._singly_of.clear()

    def close(self, id: str) -> None:
        """Drop an agent's unread messages, and store no more for it, as it does not take part any more."""
        receiver = self._rank[id]
        self._is_closed[receiver] = True
        self._closed = int(self._is_closed.sum())
        for key in [key for key in self._single if key[0] == receiver]:
            del self._single[key]
        for name, arrived in list(self._columns.items()):
            rest = [(each, each.receivers != receiver) for each in arrived]
            kept = [each if others.all() else each.some(others) for each, others in rest if others.any()]
            if kept:
                self._columns[name] = kept
            else:
                del self._columns[name]

    def reopen(self, id: str) -> None:
        """Store messages for an agent again."""
        self._is_closed[self._rank[id]] = False
        self._closed = int(self._is_closed.sum())

    def _names(self, receiver: int, kind: str) -> tuple[str, ...]:
        """Return the readers of an agent's messages of a kind that read one by one."""
        names = self._names_of.get((receiver, kind))
        if names is None:
            readers = [each for each in self._readers if each.first <= receiver < each.last and kind in each.kinds]
            singly = [each.name for each in readers if not each.columns]
            if not readers and self._listens[receiver]:
                singly.append("")
            names = self._names_of[receiver, kind] = tuple(singly)
        return names

    def _singly(self, kind: str) -> NDArray[np.bool_] | None:
        """Return for which agents messages of a kind are read one by one; None for none."""
        if kind not in self._singly_of:
            wanted = np.array([bool(self._names(receiver, kind)) for receiver in range(len(self._ids))], bool)
            self._singly_of[kind] = wanted if wanted.any() else None
        return self._singly_of[kind]

    def put(self, delivery: Delivery) -> None:
        """Store messages that have arrived."""
        if self._closed:
            wanted = ~self._is_closed[delivery.receivers]
            if not wanted.any():
                return
            delivery = delivery.some(wanted)
        kind, receivers = delivery.batch.kind, delivery.receivers
        for reader in self._readers:
            if reader.columns and kind in reader.kinds:
                mine = (receivers >= reader.first) & (receivers < reader.last)
                if mine.any():
                    self._columns.setdefault(reader.name, []).append(delivery if mine.all() else delivery.some(mine))
        singly = self._singly(kind)
        if singly is not None:
            self._put_singly(delivery, np.flatnonzero(singly[receivers]))

    def _put_singly(self, delivery: Delivery, indices: Indices) -> None:
        columns = delivery.receivers, delivery.due, delivery.senders, delivery.sequences
        kind, single = delivery.batch.kind, self._single
        for place, receiver, *order in zip(
            indices.tolist(), *(each[indices].tolist() for each in columns), strict=True
        ):
            for name in self._names(receiver, kind):
                single.setdefault((receiver, name), []).append((*order, place, delivery))

    def has(self, receiver: str, reader: str = "") -> bool:
        """Return whether messages have arrived since the last call of `receive`."""
        return (self._rank[receiver], reader) in self._single

    def receive(self, receiver: str, reader: str = "") -> Sequence[Message]:
        """Return the messages that arrived for an agent since the last call, oldest first."""
        arrived = self._single.pop((self._rank[receiver], reader), None)
        if arrived is None:
            return ()
        arrived.sort(key=_OLDEST)
        return [delivery.message(place, self._ids) for _, _, _, place, delivery in arrived]

    def collect(self, reader: str) -> Sequence[Delivery]:
        """Return the messages that arrived for a group since the last call, oldest first for each receiver."""
        return in_order(self._columns.pop(reader, ()))
