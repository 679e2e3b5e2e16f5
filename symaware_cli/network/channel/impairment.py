"""Impairments: effects of disturbances on single messages, in addition to their channel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices, Times
from symaware_cli.world.chance import Array


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
