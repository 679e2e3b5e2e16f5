"""Traffic: messages that are sent, delivered or dropped together, in columns, for observers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery, Message
from symaware_cli.world import record

Stage = Literal["sent", "delivered", "dropped"]


@record
class Traffic:
    """Messages of one batch at one stage.

    Attributes:
        stage: The stage.
        delivery: The messages.
        sizes: The size of the message in each row of the batch, in bytes; shape (s,).
        reasons: The reasons by number.
        reason: The number of the reason why each was dropped; shape (m,). None if none was.
    """

    stage: Stage
    delivery: Delivery
    sizes: NDArray[np.int64]
    reasons: Sequence[str] = ()
    reason: NDArray[np.uint8] | None = None

    def messages(self, ids: Sequence[str]) -> Iterator[tuple[Message, str]]:
        """Yield each message with the reason why it was dropped; the arrival time is 0 if not delivered.

        Args:
            ids: All agents, in the roster's order.
        """
        delivery = self.delivery
        if self.stage != "delivered":
            delivery = replace(delivery, due=np.zeros_like(delivery.due))
        reasons = [""] * len(delivery)
        if self.reason is not None:
            reasons = [self.reasons[number] for number in self.reason.tolist()]
        return zip(delivery.messages(ids), reasons, strict=True)
