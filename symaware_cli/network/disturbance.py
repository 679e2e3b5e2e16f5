"""Disturbances: what a fault does to messages."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What happens to messages of some agents to others while it lasts.

    Attributes:
        name: What it is called, as the reason for a loss; keys what it draws.
        senders: Whose messages.
        receivers: To whom.
        loss: Probability that a message is lost.
        delay: How much later a message arrives, in nanoseconds.
        bandwidth: How much gets into each link at most [bytes/s].
    """

    name: str
    senders: Container[str]
    receivers: Container[str]
    loss: float
    delay: int
    bandwidth: float = math.inf

    def concerned(self, ids: Sequence[str], senders: Indices, receivers: Indices) -> NDArray[np.bool_]:
        """Which messages are among those; shape (m,)."""
        if len(senders) < len(ids):
            pairs = zip(senders.tolist(), receivers.tolist(), strict=True)
            hit = (ids[one] in self.senders and ids[other] in self.receivers for one, other in pairs)
            return np.fromiter(hit, bool, len(senders))
        sends = np.fromiter((id in self.senders for id in ids), bool, len(ids))
        receives = np.fromiter((id in self.receivers for id in ids), bool, len(ids))
        concerned: NDArray[np.bool_] = sends[senders] & receives[receivers]
        return concerned
