"""Messages between agents."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import AwarenessVector
from symaware_cli.core.links import Links
from symaware_cli.world import record

Indices = NDArray[np.intp]
Times = NDArray[np.int64]

#: The receiver of a message to all neighbours of its sender.
EVERYBODY = "*"

#: Immutable types.
_FIXED = frozenset({str, int, float, bool, bytes, type(None)})


@record
class Message:
    """A message from one agent to another: one to send, or a view of one that arrived, see `Delivery.message`.

    Attributes:
        sender: The id of the sender.
        receiver: The id of the receiver; ``*`` for all neighbours of the sender.
        payload: Plain values, arrays, time series or awareness vectors, by name.
        kind: The kind of message; components read messages by their kinds.
        sequence: Counts the messages of one sender; set when it is sent.
        sent_time: Time of sending in nanoseconds; set when it is sent.
        arrival_time: Time of arrival in nanoseconds, which may be a little before it could be read; set on arrival.
    """

    sender: str
    receiver: str
    payload: Mapping[str, Any]
    kind: str = "message"
    sequence: int = 0
    sent_time: int = 0
    arrival_time: int = 0


@record
class MessageBatch:
    """The messages that agents send at one instant, in columns with a row for each message.

    A sender with several messages has a row for each, in the order of sending. No two rows have the same sender and
    receiver; in a batch to all neighbours, each sender has one row.

    Attributes:
        senders: The senders as indices in the roster, ascending; shape (s,).
        columns: The payload by name, with a row for each of `senders`: numbers, of shape (s, ...), or any values that a
            `Message` may have, as an array of objects of shape (s,). Must not be changed afterwards.
        kind: The kind of message; components read messages by their kinds.
        receivers: The receiver of each row as an index in the roster; shape (s,). None for all neighbours of each
            sender.
    """

    senders: Indices
    columns: Mapping[str, NDArray[Any]]
    kind: str = "message"
    receivers: Indices | None = None

    def payload(self, row: int) -> dict[str, Any]:
        """The payload of one row, by name; the caller may change it."""
        return {
            name: copied(values[row]) if values.dtype == object else values[row]
            for name, values in self.columns.items()
        }

    def messages(self, ids: Sequence[str]) -> Iterator[Message]:
        """Yield each row as a message to send.

        Args:
            ids: The ids of all agents, in the order of the roster.
        """
        for row, sender in enumerate(self.senders.tolist()):
            receiver = EVERYBODY if self.receivers is None else ids[self.receivers[row]]
            yield Message(ids[sender], receiver, self.payload(row), self.kind)

    def some(self, rows: NDArray[np.bool_]) -> MessageBatch:
        """The batch with some of the rows."""
        if rows.all():
            return self
        columns = {name: values[rows] for name, values in self.columns.items()}
        receivers = None if self.receivers is None else self.receivers[rows]
        return replace(self, senders=self.senders[rows], columns=columns, receivers=receivers)


@record
class Delivery:
    """Messages of one batch that arrived together, in columns.

    Attributes:
        batch: The batch with their payload.
        rows: The row of each message in the batch; shape (m,).
        receivers: The receiver of each as an index in the roster; shape (m,).
        sequences: The number of each among the messages of its sender; shape (m,).
        sent_time: Time of sending in nanoseconds.
        due: Time of arrival of each in nanoseconds, which may be a little before it could be read; shape (m,).
    """

    batch: MessageBatch
    rows: Indices
    receivers: Indices
    sequences: Times
    sent_time: int
    due: Times

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def senders(self) -> Indices:
        """The sender of each message as an index in the roster; shape (m,)."""
        return self.batch.senders.take(self.rows)

    def column(self, name: str) -> NDArray[Any]:
        """One entry of the payload of each message; shape (m, ...).

        Objects are shared with other receivers: see `copied`.
        """
        return self.batch.columns[name].take(self.rows, 0)

    def some(self, places: Indices | NDArray[np.bool_] | slice) -> Delivery:
        """Some of the messages."""
        return replace(
            self,
            rows=self.rows[places],
            receivers=self.receivers[places],
            sequences=self.sequences[places],
            due=self.due[places],
        )

    def message(self, place: int, ids: Sequence[str]) -> Message:
        """One of the messages.

        Args:
            place: Its position in this delivery.
            ids: The ids of all agents, in the order of the roster.
        """
        batch, row = self.batch, self.rows[place]
        return Message(
            ids[batch.senders[row]],
            ids[self.receivers[place]],
            batch.payload(row),
            batch.kind,
            int(self.sequences[place]),
            self.sent_time,
            int(self.due[place]),
        )

    def messages(self, ids: Sequence[str]) -> Iterator[Message]:
        """Each of the messages; see `message`."""
        return (self.message(place, ids) for place in range(len(self)))


class Exchange(Protocol):
    """Carries messages between agents."""

    def send(self, message: Message) -> None:
        """Send a message; the receiver can read it from the next step on."""

    def post(self, batch: MessageBatch) -> None:
        """Send the messages of many agents at once."""

    @property
    def links(self) -> Links | None:
        """The present links; the same object until they change. None if every agent reaches every other."""

    @property
    def present_indices(self) -> NDArray[np.intp]:
        """The indices in the roster of the agents that are present, ascending; shape (m,)."""

    def neighbours(self, sender: str) -> Sequence[str]:
        """The ids of all agents that an agent reaches now, in the order of the roster."""

    def receive(self, receiver: str, reader: str = "") -> Sequence[Message]:
        """Return all unread messages of an agent, oldest first.

        They are ordered by time of arrival, then by the sender's index in the roster, then by the sender's own order.

        Args:
            receiver: The id of the agent.
            reader: The path of the component that reads them, if it reads certain kinds only.
        """

    def collect(self, reader: str) -> Sequence[Delivery]:
        """Return all unread messages for the group of a component, given by the component's path.

        The messages of each receiver are in the order of `receive`; the order among receivers is undefined.
        """


def objects(values: Sequence[Any]) -> NDArray[Any]:
    """Return a column of any values; shape (s,)."""
    column = np.empty(len(values), object)
    for row, value in enumerate(values):
        column[row] = value
    return column


def copied(value: Any) -> Any:
    """Return a copy, so that changes do not affect the original; arrays of numbers are read-only."""
    if type(value) in _FIXED:
        return value
    if isinstance(value, np.ndarray):
        if not value.flags.writeable and value.base is None:
            return value
        copy = value.copy()
        copy.flags.writeable = False
        return copy
    if isinstance(value, AwarenessVector):
        return value.replaced()
    if isinstance(value, Mapping):
        return {name: copied(each) for name, each in value.items()}
    if isinstance(value, list):
        return [copied(each) for each in value]
    if isinstance(value, tuple):
        copies = [copied(each) for each in value]
        return value._make(copies) if hasattr(value, "_make") else tuple(copies)
    if isinstance(value, set | frozenset):
        return frozenset(value)
    return value
