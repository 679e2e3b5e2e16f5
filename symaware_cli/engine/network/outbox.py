"""The outbox: joins messages that agents send singly at one instant to batches.

Reasons: docs/decisions/0019-one-message-batch.md
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from symaware_cli.core import MessageBatch
from symaware_cli.core.message import objects

_Key = tuple[str, tuple[str, ...], bool]


@dataclass(slots=True)
class _Draft:
    """A batch that is being assembled; see `MessageBatch`.

    Attributes:
        key: Its kind, the names in its payloads, and whether it is for all neighbours of the senders.
        links: The pairs of sender and receiver in it.
    """

    key: _Key
    senders: list[int] = field(default_factory=list)
    receivers: list[int] = field(default_factory=list)
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    links: set[tuple[int, int | None]] = field(default_factory=set)

    def batch(self) -> MessageBatch:
        """Return the batch."""
        kind, names, is_for_all = self.key
        senders = np.array(self.senders, np.intp)
        order = np.argsort(senders, kind="stable")
        payloads = [self.rows[row] for row in order.tolist()]
        columns = {name: objects([each[place] for each in payloads]) for place, name in enumerate(names)}
        receivers = None if is_for_all else np.array(self.receivers, np.intp)[order]
        return MessageBatch(senders[order], columns, kind, receivers)


class Outbox:
    """Joins single messages of one kind, whose payloads have the same names, to batches.

    Across all batches, the messages of each sender stay in the order in which it sent them.

    Attributes:
        drafts: The batches so far; public, since the exchange looks at each instant whether there are any.
    """

    def __init__(self) -> None:
        self.drafts: list[_Draft] = []
        #: The last draft of each key, and the last draft of each sender.
        self._open: dict[_Key, int] = {}
        self._last: dict[int, int] = {}

    def put(self, sender: int, receiver: int | None, payload: Mapping[str, Any], kind: str) -> None:
        """Add a message.

        Args:
            sender: Its sender, as an index in the roster.
            receiver: Its receiver, as an index in the roster; None for all neighbours of the sender.
            payload: Its content; not to be changed any more.
            kind: Its kind.
        """
        key, link = (kind, tuple(payload), receiver is None), (sender, receiver)
        number = self._open.get(key, -1)
        if number < self._last.get(sender, 0) or link in self.drafts[number].links:
            number = self._open[key] = len(self.drafts)
            self.drafts.append(_Draft(key))
        draft = self.drafts[number]
        self._last[sender] = number
        draft.senders.append(sender)
        if receiver is not None:
            draft.receivers.append(receiver)
        draft.rows.append(tuple(payload.values()))
        draft.links.add(link)

    def empty(self) -> list[MessageBatch]:
        """Remove and return all messages as batches."""
        drafts = self.drafts
        self.__init__()  # type: ignore[misc]
        return [draft.batch() for draft in drafts]
