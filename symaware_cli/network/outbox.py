"""The outbox: what agents send singly at one instant, joined to batches."""

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
    """A batch that is being written; see `MessageBatch`.

    Attributes:
        key: Its kind, the names in its payloads, and whether it is for all whom the senders reach.
        links: From whom to whom it goes.
    """

    key: _Key
    senders: list[int] = field(default_factory=list)
    receivers: list[int] = field(default_factory=list)
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    links: set[tuple[int, int | None]] = field(default_factory=set)

    def batch(self) -> MessageBatch:
        """What was written."""
        kind, names, is_for_all = self.key
        senders = np.array(self.senders, np.intp)
        order = np.argsort(senders, kind="stable")
        said = [self.rows[row] for row in order.tolist()]
        columns = {name: objects([each[place] for each in said]) for place, name in enumerate(names)}
        receivers = None if is_for_all else np.array(self.receivers, np.intp)[order]
        return MessageBatch(senders[order], columns, kind, receivers)


class Outbox:
    """Joins single messages of one kind, with payloads of the same names, to batches.

    The batches together have the messages of each sender in the order in which it sent them.
    """

    def __init__(self) -> None:
        self._drafts: list[_Draft] = []
        #: The last draft of each key, and the last to which a sender has added.
        self._open: dict[_Key, int] = {}
        self._last: dict[int, int] = {}

    def __len__(self) -> int:
        return len(self._drafts)

    def put(self, sender: int, receiver: int | None, payload: Mapping[str, Any], kind: str) -> None:
        """Add a message.

        Args:
            sender: Whose, as an index in the roster.
            receiver: Whom it is for, likewise; None for all whom the sender reaches.
            payload: What it says; not to be changed any more.
            kind: What it is about.
        """
        key, link = (kind, tuple(payload), receiver is None), (sender, receiver)
        number = self._open.get(key, -1)
        if number < self._last.get(sender, 0) or link in self._drafts[number].links:
            number = self._open[key] = len(self._drafts)
            self._drafts.append(_Draft(key))
        draft = self._drafts[number]
        self._last[sender] = number
        draft.senders.append(sender)
        if receiver is not None:
            draft.receivers.append(receiver)
        draft.rows.append(tuple(payload.values()))
        draft.links.add(link)

    def empty(self) -> list[MessageBatch]:
        """Hand over what was added."""
        drafts = self._drafts
        self.__init__()  # type: ignore[misc]
        return [draft.batch() for draft in drafts]
