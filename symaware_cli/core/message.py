"""Messages between agents."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.awareness import AwarenessVector
from symaware_cli.core.links import Links

Indices = NDArray[np.intp]
Times = NDArray[np.int64]

#: The receiver of a message that is for all whom its sender reaches.
EVERYBODY = "*"

#: Types of which nothing can be changed.
_FIXED = frozenset({str, int, float, bool, bytes, type(None)})


@dataclass(frozen=True, slots=True)
class Message:
    """What one agent tells another: to be sent, or as a view of one of those that arrived, see `Delivery.message`.

    Attributes:
        sender: The id of the agent that sends.
        receiver: The id of the agent that shall read it; ``*`` for all whom the sender reaches.
        payload: Plain values, arrays, time series or awareness vectors, by name.
        kind: A word for what it is about.
        sequence: Counts the messages of one sender; set when it is sent.
        sent_time: When it was sent, in nanoseconds; set when it is sent.
        arrival_time: When it arrived, in nanoseconds, which may be a little before it could be read; set then.
    """

    sender: str
    receiver: str
    payload: Mapping[str, Any]
    kind: str = "message"
    sequence: int = 0
    sent_time: int = 0
    arrival_time: int = 0


@dataclass(frozen=True, slots=True)
class MessageBatch:
    """What agents tell others at one instant, in columns with a row for each thing that is said.

    Who says several things has a row for each, in the order in which it says them. No two rows go from one agent to the
    same receiver; in a batch for all whom the senders reach, each sender has one row.

    Attributes:
        senders: Who sends, as indices in the roster, ascending; shape (s,).
        columns: What they say, by name, a row for each in `senders`: numbers, of shape (s, ...), or any values that a
            `Message` may have, as an array of objects of shape (s,). Not to be changed any more.
        kind: A word for what it is about.
        receivers: For each row the one whom it is for, as an index in the roster; shape (s,). None for all whom each
            reaches.
    """

    senders: Indices
    columns: Mapping[str, NDArray[Any]]
    kind: str = "message"
    receivers: Indices | None = None

    def payload(self, row: int) -> dict[str, Any]:
        """What one of the rows says, by name; the caller may change it."""
        return {
            name: copied(values[row]) if values.dtype == object else values[row]
            for name, values in self.columns.items()
        }

    def some(self, rows: NDArray[np.bool_]) -> MessageBatch:
        """What some of the rows say."""
        if rows.all():
            return self
        columns = {name: values[rows] for name, values in self.columns.items()}
        receivers = None if self.receivers is None else self.receivers[rows]
        return replace(self, senders=self.senders[rows], columns=columns, receivers=receivers)


@dataclass(frozen=True, slots=True)
class Delivery:
    """Messages of one batch that arrived together, in columns.

    Attributes:
        batch: What they say.
        rows: Which row of it each message is, that is, whose; shape (m,).
        receivers: Whom each was for, as an index in the roster; shape (m,).
        sequences: The number of each among the messages of its sender; shape (m,).
        sent_time: When they were sent, in nanoseconds.
        due: When each arrived, in nanoseconds, which may be a little before it could be read; shape (m,).
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
        """Whose each message is, as an index in the roster; shape (m,)."""
        return self.batch.senders.take(self.rows)

    def column(self, name: str) -> NDArray[Any]:
        """What each message says under a name; shape (m, ...).

        Objects are those that other receivers get, too: see `copied`.
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
            place: Which.
            ids: All agents, in the roster's order.
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
    """What carries messages between agents."""

    def send(self, message: Message) -> None:
        """Take a message; the receiver can read it from the next step on."""

    def post(self, batch: MessageBatch) -> None:
        """Take the messages of many agents at once."""

    @property
    def links(self) -> Links | None:
        """Who reaches whom now; the same object until that changes. None where everybody reaches everybody."""

    def neighbours(self, sender: str) -> Sequence[str]:
        """The ids of all whom an agent reaches now, in the roster's order."""

    def receive(self, receiver: str, reader: str = "") -> Sequence[Message]:
        """Hand over all messages that arrived for an agent and were not handed over before, oldest first.

        They are ordered by when they arrived, then by the sender's place in the roster, then by the sender's own order.

        Args:
            receiver: Whose messages.
            reader: The path of the component that reads them, where it reads certain kinds.
        """

    def collect(self, reader: str) -> Sequence[Delivery]:
        """Hand over all that arrived for the group of a component, by the component's path.

        Of each receiver it is in the order of `receive`; what goes to different receivers may stand in any order.
        """


def objects(values: Sequence[Any]) -> NDArray[Any]:
    """A column of any values; shape (s,)."""
    column = np.empty(len(values), object)
    for row, value in enumerate(values):
        column[row] = value
    return column


def copied(value: Any) -> Any:
    """Return a value whose changes do not reach the one that was given; arrays of numbers are read-only."""
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
