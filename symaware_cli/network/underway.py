"""What is under way: messages in the order in which they arrive."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery, Message
from symaware_cli.network.traffic import chosen


class Letter(NamedTuple):
    """A single message under way.

    Attributes:
        due: When it arrives, in nanoseconds.
        sender: Whose it is, as an index in the roster.
        sequence: Its number among those of its sender.
        receiver: Whom it is for, as an index in the roster.
        number: Tells copies apart.
        reason: The number of the reason for which it will be dropped as it arrives; 0 for none.
        message: It.
    """

    due: int
    sender: int
    sequence: int
    receiver: int
    number: int
    reason: int
    message: Message


@dataclass(slots=True)
class _Flight:
    """What is under way of one mailing, in the order in which it arrives.

    Attributes:
        delivery: What.
        reason: Why each will be dropped as it arrives; shape (m,).
        next: The first that is still under way.
        size: Of each, in bytes.
    """

    delivery: Delivery
    reason: NDArray[np.uint8]
    size: int
    next: int = 0


class Arrival(NamedTuple):
    """Messages of one mailing that arrive.

    Attributes:
        delivery: The messages.
        reason: Why each is dropped; shape (m,).
        size: Of each, in bytes.
    """

    delivery: Delivery
    reason: NDArray[np.uint8]
    size: int


class UnderWay:
    """Holds messages until they arrive: single ones, and those of mailings in columns."""

    def __init__(self) -> None:
        self._letters: list[Letter] = []
        self._flights: list[tuple[int, int, _Flight]] = []
        self._number = 0

    def __len__(self) -> int:
        return len(self._letters) + sum(len(flight.delivery) - flight.next for _, _, flight in self._flights)

    @property
    def next_time(self) -> int | None:
        """When the next message arrives, in nanoseconds."""
        return min((heap[0][0] for heap in (self._letters, self._flights) if heap), default=None)

    def put(self, message: Message, sender: int, receiver: int, due: int, reason: int = 0) -> None:
        """Take a single message; see `Letter`."""
        self._number += 1
        heapq.heappush(self._letters, Letter(due, sender, message.sequence, receiver, self._number, reason, message))

    def launch(self, delivery: Delivery, reason: NDArray[np.uint8], size: int) -> None:
        """Take messages of a mailing; see `Arrival`."""
        due, senders = delivery.due, delivery.senders
        later, next_one = due[1:] > due[:-1], due[1:] == due[:-1]
        if not (later | (next_one & (senders[1:] >= senders[:-1]))).all():
            order = np.lexsort((delivery.sequences, senders, due))
            delivery, reason = chosen(delivery, order), reason[order]
        self._number += 1
        heapq.heappush(self._flights, (int(delivery.due[0]), self._number, _Flight(delivery, reason, size)))

    def take(self, now: int) -> list[Letter | Arrival]:
        """Hand over what arrives until now.

        Returns:
            By when the first of each arrives, then by sender and number: not by who took its turn first.
        """
        arrivals: list[Letter | Arrival] = []
        while self._letters and self._letters[0].due <= now:
            arrivals.append(heapq.heappop(self._letters))
        while self._flights and self._flights[0][0] <= now:
            _, number, flight = heapq.heappop(self._flights)
            first, due = flight.next, flight.delivery.due
            last = len(due) if due[-1] <= now else int(np.searchsorted(due, now, "right"))
            if first == 0 and last == len(due):
                arrivals.append(Arrival(flight.delivery, flight.reason, flight.size))
                continue
            some = slice(first, last)
            arrivals.append(Arrival(chosen(flight.delivery, some), flight.reason[some], flight.size))
            if last < len(due):
                flight.next = last
                heapq.heappush(self._flights, (int(due[last]), number, flight))
        arrivals.sort(key=_order)
        return arrivals


def _order(arrival: Letter | Arrival) -> tuple[int, int, int]:
    if isinstance(arrival, Letter):
        return arrival.due, arrival.sender, arrival.sequence
    delivery = arrival.delivery
    return int(delivery.due[0]), int(delivery.mailing.senders[delivery.rows[0]]), int(delivery.sequences[0])
