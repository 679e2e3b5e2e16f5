"""Messages between agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True, slots=True)
class Message:
    """What one agent tells another.

    Attributes:
        sender: The id of the agent that sends.
        receiver: The id of the agent that shall read it.
        payload: Plain values, arrays, time series or awareness vectors, by name.
        kind: A word for what it is about.
        sequence: Counts the messages of one sender; set when it is sent.
        sent_time: When it was sent, in nanoseconds; set when it is sent.
    """

    sender: str
    receiver: str
    payload: Mapping[str, Any]
    kind: str = "message"
    sequence: int = 0
    sent_time: int = 0


class Exchange(Protocol):
    """What carries messages between agents."""

    def send(self, message: Message) -> None:
        """Take a message; the receiver can read it from the next step on."""

    def receive(self, receiver: str) -> Sequence[Message]:
        """Hand over all messages that arrived for an agent and were not handed over before, oldest first."""
