"""Traffic: many messages that reach a stage together, in columns, for whoever watches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery, Message

Stage = Literal["sent", "delivered", "dropped"]


@dataclass(frozen=True, slots=True)
class Traffic:
    """Messages of one batch at one stage.

    Attributes:
        stage: Which.
        delivery: The messages.
        sizes: Of what each row of the batch says, in bytes; shape (s,).
        reasons: What the numbers below stand for.
        reason: Why each was dropped; shape (m,). None where none was.
    """

    stage: Stage
    delivery: Delivery
    sizes: NDArray[np.int64]
    reasons: Sequence[str] = ()
    reason: NDArray[np.uint8] | None = None

    def messages(self, ids: Sequence[str]) -> Iterator[tuple[Message, str]]:
        """Each message as an object, with why it was dropped; one that has not arrived does not say when it will.

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
