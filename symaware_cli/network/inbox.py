"""Inboxes: messages that arrived and were not read yet."""

from __future__ import annotations

from collections.abc import Collection, Container, Sequence
from dataclasses import dataclass

import numpy as np

from symaware_cli.core import Delivery, Message
from symaware_cli.network.arrivals import in_order
from symaware_cli.network.traffic import chosen, messages


@dataclass(frozen=True, slots=True)
class Reader:
    """Components of one entry of a group that read messages of certain kinds; nobody else of the group gets these.

    Attributes:
        name: The component's path where it reads in columns, else its name.
        first: The first of its agents, as an index in the roster.
        last: The first that is not one of them any more.
        kinds: What it reads.
        columns: Whether one component reads the mail of all its agents, in columns.
    """

    name: str
    first: int
    last: int
    kinds: frozenset[str]
    columns: bool


class Inboxes:
    """Keeps messages for those who read them."""

    def __init__(self, ids: Sequence[str], listening: Container[str] | None) -> None:
        """Open an inbox for everybody who listens.

        Args:
            ids: All agents, in the roster's order.
            listening: Those who read whatever nobody else reads; None for everybody.
        """
        self._ids = ids
        self._rank = {id: rank for rank, id in enumerate(ids)}
        self._listens = [listening is None or id in listening for id in ids]
        self._anyone = any(self._listens)
        self._readers: list[Reader] = []
        self._readers_of: dict[tuple[int, str], tuple[Reader, ...]] = {}
        self._is_closed = np.zeros(len(ids), bool)
        self._closed = 0
        self._letters: dict[tuple[str, str], list[Message]] = {}
        self._columns: dict[str, list[Delivery | Message]] = {}

    def open(self, name: str, agents: Sequence[str], kinds: Collection[str], *, columns: bool) -> None:
        """Keep messages of certain kinds for components of a group; see `Reader`.

        Args:
            name: See there.
            agents: Whose messages; they stand together in the roster, in its order.
            kinds: See there.
            columns: See there.
        """
        first = self._rank[agents[0]]
        self._readers.append(Reader(name, first, first + len(agents), frozenset(kinds), columns))
        self._readers_of.clear()

    def close(self, id: str) -> None:
        """Throw away what an agent has not read yet, and keep nothing more for it, as it takes no part any more."""
        receiver = self._rank[id]
        self._is_closed[receiver] = True
        self._closed = int(self._is_closed.sum())
        for key in [key for key in self._letters if key[0] == id]:
            del self._letters[key]
        for name, arrived in list(self._columns.items()):
            kept = [rest for each in arrived if (rest := _without(each, id, receiver)) is not None]
            if kept:
                self._columns[name] = kept
            else:
                del self._columns[name]

    def reopen(self, id: str) -> None:
        """Keep again what arrives for an agent."""
        self._is_closed[self._rank[id]] = False
        self._closed = int(self._is_closed.sum())

    def _of(self, receiver: int, kind: str) -> tuple[Reader, ...]:
        readers = self._readers_of.get((receiver, kind))
        if readers is None:
            readers = self._readers_of[receiver, kind] = tuple(
                each for each in self._readers if each.first <= receiver < each.last and kind in each.kinds
            )
        return readers

    def put(self, message: Message, receiver: int) -> None:
        """Take in a message that arrived for an agent, given as an index in the roster."""
        if self._closed and self._is_closed[receiver]:
            return
        readers = self._of(receiver, message.kind)
        for reader in readers:
            if reader.columns:
                self._columns.setdefault(reader.name, []).append(message)
            else:
                self._letters.setdefault((message.receiver, reader.name), []).append(message)
        if not readers and self._listens[receiver]:
            self._letters.setdefault((message.receiver, ""), []).append(message)

    def put_columns(self, delivery: Delivery) -> None:
        """Take in messages of a mailing."""
        if self._closed:
            wanted = ~self._is_closed[delivery.receivers]
            if not wanted.any():
                return
            delivery = chosen(delivery, wanted)
        kind, receivers = delivery.mailing.kind, delivery.receivers
        singly = self._anyone
        for reader in self._readers:
            if kind not in reader.kinds:
                continue
            if not reader.columns:
                singly = True
                continue
            mine = (receivers >= reader.first) & (receivers < reader.last)
            if mine.any():
                part = delivery if mine.all() else chosen(delivery, mine)
                self._columns.setdefault(reader.name, []).append(part)
        if not singly:
            return
        singled = [self._wants_letters(receiver, kind) for receiver in range(len(self._ids))]
        part = chosen(delivery, np.array(singled)[receivers])
        for message, receiver in zip(messages(part, self._ids), part.receivers.tolist(), strict=True):
            readers = self._of(receiver, kind)
            for reader in readers:
                if not reader.columns:
                    self._letters.setdefault((message.receiver, reader.name), []).append(message)
            if not readers:
                self._letters.setdefault((message.receiver, ""), []).append(message)

    def _wants_letters(self, receiver: int, kind: str) -> bool:
        readers = self._of(receiver, kind)
        return any(not each.columns for each in readers) if readers else self._listens[receiver]

    def has(self, receiver: str, reader: str = "") -> bool:
        """Whether something arrived since the last time it was handed over."""
        return (receiver, reader) in self._letters

    def receive(self, receiver: str, reader: str = "") -> Sequence[Message]:
        """Hand over what arrived for an agent since the last call, oldest first; see `Exchange.receive`."""
        arrived = self._letters.pop((receiver, reader), None)
        if arrived is None:
            return ()
        rank = self._rank
        arrived.sort(key=lambda each: (each.arrival_time, rank[each.sender], each.sequence))
        return arrived

    def collect(self, reader: str) -> Sequence[Delivery | Message]:
        """Hand over what arrived for a group since the last call, oldest first for each; see `Exchange.collect`."""
        return in_order(self._columns.pop(reader, ()), self._rank)


def _without(arrived: Delivery | Message, id: str, receiver: int) -> Delivery | Message | None:
    """What arrived, but for what is for one agent; None if that is all of it."""
    if isinstance(arrived, Message):
        return None if arrived.receiver == id else arrived
    others = arrived.receivers != receiver
    return (arrived if others.all() else chosen(arrived, others)) if others.any() else None
