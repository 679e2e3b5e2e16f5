"""Messages between agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from symaware_cli.core.topology import Links

Indices = NDArray[np.intp]
Times = NDArray[np.int64]

#: The receiver of a message that is for all whom its sender reaches.
EVERYBODY = "*"


@dataclass(frozen=True, slots=True)
class Message:
    """What one agent tells another.

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
class Mailing:
    """What many agents tell others at one instant, in columns: the rows of each array are what each of them says.

    Attributes:
        senders: Who sends, as indices in the roster, ascending; shape (s,).
        columns: Numbers by name, a row for each sender; each of shape (s, ...). Not to be changed any more.
        kind: A word for what it is about.
        receivers: For each sender the one whom it is for, as an index in the roster; shape (s,). None for all whom
            each reaches.
    """

    senders: Indices
    columns: Mapping[str, NDArray[Any]]
    kind: str = "message"
    receivers: Indices | None = None

    def payload(self, row: int) -> dict[str, Any]:
        """What one of the senders says, by name."""
        return {name: values[row] for name, values in self.columns.items()}


@dataclass(frozen=True, slots=True)
class Delivery:
    """Messages of one mailing that arrived together, in columns.

    Attributes:
        mailing: What they say.
        rows: Which row of it each message is, that is, whose; shape (m,).
        receivers: Whom each was for, as an index in the roster; shape (m,).
        sequences: The number of each among the messages of its sender; shape (m,).
        sent_time: When they were sent, in nanoseconds.
        due: When each arrived, in nanoseconds, which may be a little before it could be read; shape (m,).
    """

    mailing: Mailing
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
        return self.mailing.senders.take(self.rows)

    def column(self, name: str) -> NDArray[Any]:
        """What each message says under a name; shape (m, ...)."""
        return self.mailing.columns[name].take(self.rows, 0)


class Exchange(Protocol):
    """What carries messages between agents."""

    def send(self, message: Message) -> None:
        """Take a message; the receiver can read it from the next step on."""

    def post(self, mailing: Mailing) -> None:
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

    def collect(self, reader: str) -> Sequence[Delivery | Message]:
        """Hand over all that arrived for the group of a component, by the component's path.

        Of each receiver it is in the order of `receive`; what goes to different receivers may stand in any order.
        """
