"""The exchange within a process: everybody reaches everybody, one step later."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symaware_cli.core import AwarenessVector, Message


class UnknownReceiverError(Exception):
    """A message was sent to somebody who does not exist."""


class MemoryExchange:
    """Carries messages in memory: sent in one step, readable in the next, none ever lost.

    What arrives is ordered by the sender's place in the roster, then by the sender's own order, so that it does
    not depend on who took its turn first.

    Attributes:
        now: Simulated time of the present step, in nanoseconds.
    """

    def __init__(
        self,
        ids: Sequence[str],
        on_sent: Callable[[Message], Any],
        on_delivered: Callable[[Message], Any],
        listening: Container[str] | None = None,
    ) -> None:
        """Open an inbox for everybody who listens.

        Args:
            ids: All agents, in the roster's order.
            on_sent: Called with each message once it is on its way.
            on_delivered: Called with each message once it is readable.
            listening: Those who read their messages; None for everybody. What arrives for others is delivered, too,
                but not kept: a run of any length would fill the memory with it.
        """
        self._listening = ids if listening is None else listening
        self._rank = {id: rank for rank, id in enumerate(ids)}
        self._sent_by: dict[str, int] = defaultdict(int)
        self._under_way: list[Message] = []
        self._inboxes: dict[str, list[Message]] = {}
        self.now = 0
        self._on_sent = on_sent
        self._on_delivered = on_delivered

    def send(self, message: Message) -> None:
        """Take a message; what its payload refers to is copied.

        Raises:
            UnknownReceiverError: There is no agent of the receiver's id, or of the sender's.
        """
        for id in (message.sender, message.receiver):
            if id not in self._rank:
                raise UnknownReceiverError(f"there is no agent `{id}` to exchange messages with")
        sequence = self._sent_by[message.sender]
        self._sent_by[message.sender] = sequence + 1
        payload = {name: _copied(value) for name, value in message.payload.items()}
        sent = replace(message, payload=payload, sequence=sequence, sent_time=self.now)
        self._under_way.append(sent)
        self._on_sent(sent)

    def deliver(self, now: int) -> None:
        """Begin a step: what was sent before becomes readable."""
        self.now = now
        if not self._under_way:
            return
        arrived = sorted(self._under_way, key=lambda each: (self._rank[each.sender], each.sequence))
        self._under_way = []
        for message in arrived:
            if message.receiver in self._listening:
                self._inboxes.setdefault(message.receiver, []).append(message)
            self._on_delivered(message)

    def receive(self, receiver: str) -> Sequence[Message]:
        """Hand over what arrived since the last call, oldest first."""
        return self._inboxes.pop(receiver, ())


def _copied(value: Any) -> Any:
    """Return a value that the sender cannot change any more."""
    if isinstance(value, np.ndarray):
        copy = value.copy()
        copy.flags.writeable = False
        return copy
    if isinstance(value, AwarenessVector):
        return AwarenessVector(value.id, value.state, value.intent, value.uncertainty, value.risk)
    if isinstance(value, Mapping):
        return {name: _copied(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_copied(each) for each in value]
    if isinstance(value, tuple):
        copies = [_copied(each) for each in value]
        return value._make(copies) if hasattr(value, "_make") else tuple(copies)
    if isinstance(value, set | frozenset):
        return frozenset(value)
    return value
