"""Disturbances: losses, delays and bandwidth limits that a fault imposes on messages, or takes from them."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices
from symaware_cli.world import record


@record
class Disturbance:
    """The effects of a fault on messages from some agents to others.

    Attributes:
        name: The name of the fault, which is the reason of its losses and keys its random draws.
        senders: The ids of the senders.
        receivers: The ids of the receivers.
        loss: Probability that a message is lost.
        delay: Additional delay of messages, in nanoseconds.
        bandwidth: Limit of the bandwidth of each link [bytes/s].
        in_time: Whether the messages are neither lost nor delayed, regardless of their links and other faults.
        draw: Names other random draws, which decide the fates of the messages; empty for those of the run.
    """

    name: str
    senders: Container[str]
    receivers: Container[str]
    loss: float
    delay: int
    bandwidth: float = math.inf
    in_time: bool = False
    draw: str = ""

    def concerned(self, ids: Sequence[str], senders: Indices, receivers: Indices) -> NDArray[np.bool_]:
        """Return which messages are affected; shape (m,)."""
        if len(senders) < len(ids):
            pairs = zip(senders.tolist(), receivers.tolist(), strict=True)
            hit = (ids[one] in self.senders and ids[other] in self.receivers for one, other in pairs)
            return np.fromiter(hit, bool, len(senders))
        sends = np.fromiter((id in self.senders for id in ids), bool, len(ids))
        receives = np.fromiter((id in self.receivers for id in ids), bool, len(ids))
        concerned: NDArray[np.bool_] = sends[senders] & receives[receivers]
        return concerned
