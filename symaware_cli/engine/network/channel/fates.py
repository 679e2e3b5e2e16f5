"""The fates of messages: when each arrives, or why it is dropped.

Apart from the channel, which is imported only where messages may have another fate than to arrive at the next step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices, Times
from symaware_cli.world import Array

#: The reason of messages that are queued and not decided yet.
WAITS = 255
#: The reasons why messages are dropped, by their numbers in `Fates.reason`; the first means not dropped.
REASONS = ("", "loss", "queue-full", "too-old", "no-link", "absent")
LOSS, QUEUE_FULL, TOO_OLD, NO_LINK, ABSENT = 1, 2, 3, 4, 5


class Impairment(NamedTuple):
    """The effects of disturbances on messages.

    Attributes:
        delay: Additional delay of each, in nanoseconds; shape (m,).
        bandwidth: Limit of the bandwidth of each one's link [bytes/s]; infinite for none; shape (m,).
        reason: The number of the reason why each is lost; 0 if not; shape (m,).
    """

    delay: Times
    bandwidth: Array
    reason: NDArray[np.uint8]

    @classmethod
    def none(cls, count: int) -> Impairment:
        """Return no effects for a number of messages."""
        return cls(np.zeros(count, np.int64), np.full(count, np.inf), np.zeros(count, np.uint8))

    def take(self, indices: Indices) -> Impairment:
        """Return the effects on some of the messages."""
        return Impairment(self.delay[indices], self.bandwidth[indices], self.reason[indices])


class Fates(NamedTuple):
    """The fates of messages.

    Attributes:
        due: The time of arrival of each, in nanoseconds; shape (m,).
        reason: Why each is dropped, as an index in `REASONS`; shape (m,). Messages too old are dropped on arrival.
        copies: The indices of messages that arrive a second time; shape (c,).
        copies_due: The times of their second arrival; shape (c,).
    """

    due: Times
    reason: NDArray[np.uint8]
    copies: Indices
    copies_due: Times
