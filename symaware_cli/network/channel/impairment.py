"""Impairments: in what the links of some messages are worse than their channel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices, Times
from symaware_cli.world.chance import Array


class Impairment(NamedTuple):
    """What disturbs messages besides their channel.

    Attributes:
        delay: How much later each arrives, in nanoseconds; shape (m,).
        bandwidth: How much gets into the link of each at most [bytes/s]; infinite for no limit; shape (m,).
        reason: Why each is lost, as the number of a reason; 0 where it is not; shape (m,).
    """

    delay: Times
    bandwidth: Array
    reason: NDArray[np.uint8]

    @classmethod
    def none(cls, count: int) -> Impairment:
        """Nothing is worse."""
        return cls(np.zeros(count, np.int64), np.full(count, np.inf), np.zeros(count, np.uint8))

    def take(self, places: Indices) -> Impairment:
        """That of some of the messages."""
        return Impairment(self.delay[places], self.bandwidth[places], self.reason[places])
