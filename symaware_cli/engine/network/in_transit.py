"""Messages in transit, ordered by their arrival."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery


@dataclass(slots=True)
class _BatchInTransit:
    """The messages of one batch that are in transit, in the order of arrival.

    Attributes:
        delivery: The messages.
        reason: Why each will be dropped on arrival; shape (m,).
        sizes: The size of the payload in each row of the batch, in bytes; shape (s,).
        next: The index of the first message still in transit.
    """

    delivery: Delivery
    reason: NDArray[np.uint8]
    sizes: NDArray[np.int64]
    next: int = 0


class Arrival(NamedTuple):
    """Messages of one batch that arrive.

    Attributes:
        delivery: The messages.
        reason: Why each is dropped; 0 if delivered; shape (m,).
        sizes: The size of the payload in each row of the batch, in bytes; shape (s,).
    """

    delivery: Delivery
    reason: NDArray[np.uint8]
    sizes: NDArray[np.int64]


class MessagesInTransit:
    """Holds messages until they arrive."""

    def __init__(self) -> None:
        self._flights: list[tuple[int, int, _BatchInTransit]] = []
        self._number = 0

    def __len__(self) -> int:
        return sum(len(flight.delivery) - flight.next for _, _, flight in self._flights)

    @property
    def next_time(self) -> int | None:
        """The next time of arrival, in nanoseconds."""
        return self._flights[0][0] if self._flights else None

    def launch(self, delivery: Delivery, reason: NDArray[np.uint8], sizes: NDArray[np.int64]) -> None:
        """Add messages of a batch; see `Arrival`."""
        due, senders = delivery.due, delivery.senders
        later, next_one = due[1:] > due[:-1], due[1:] == due[:-1]
        if not (later | (next_one & (senders[1:] >= senders[:-1]))).all():
            order = np.lexsort((delivery.sequences, senders, due))
            delivery, reason = delivery.some(order), reason[order]
        self._number += 1
        heapq.heappush(self._flights, (int(delivery.due[0]), self._number, _BatchInTransit(delivery, reason, sizes)))

    def take(self, now: int) -> list[Arrival]:
        """Remove and return the messages that have arrived by now.

        Returns:
            Ordered by the first arrival of each batch, then by sender and number, which is independent of turns.
        """
        arrivals: list[Arrival] = []
        while self._flights and self._flights[0][0] <= now:
            _, number, flight = heapq.heappop(self._flights)
            first, due = flight.next, flight.delivery.due
            last = len(due) if due[-1] <= now else int(np.searchsorted(due, now, "right"))
            if first == 0 and last == len(due):
                arrivals.append(Arrival(flight.delivery, flight.reason, flight.sizes))
                continue
            some = slice(first, last)
            arrivals.append(Arrival(flight.delivery.some(some), flight.reason[some], flight.sizes))
            if last < len(due):
                flight.next = last
                heapq.heappush(self._flights, (int(due[last]), number, flight))
        if len(arrivals) > 1:
            arrivals.sort(key=_order)
        return arrivals


def _order(arrival: Arrival) -> tuple[int, int, int]:
    delivery = arrival.delivery
    return int(delivery.due[0]), int(delivery.batch.senders[delivery.rows[0]]), int(delivery.sequences[0])
