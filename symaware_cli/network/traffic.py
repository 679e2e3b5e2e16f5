"""Traffic: many messages that reach a stage together, in columns, for whoever watches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery, Mailing, Message
from symaware_cli.core.message import Indices

Stage = Literal["sent", "delivered", "dropped"]


@dataclass(frozen=True, slots=True)
class Traffic:
    """Messages of one mailing at one stage.

    Attributes:
        stage: Which.
        delivery: The messages.
        size: Of each, in bytes.
        reasons: What the numbers below stand for.
        reason: Why each was dropped; shape (m,). None where none was.
    """

    stage: Stage
    delivery: Delivery
    size: int
    reasons: Sequence[str] = ()
    reason: NDArray[np.uint8] | None = None

    def messages(self, ids: Sequence[str]) -> Iterator[tuple[Message, str]]:
        """Each message as an object, with why it was dropped.

        Args:
            ids: All agents, in the roster's order.
        """
        reasons = [""] * len(self.delivery)
        if self.reason is not None:
            reasons = [self.reasons[number] for number in self.reason.tolist()]
        return zip(messages(self.delivery, ids, arrived=self.stage == "delivered"), reasons, strict=True)


def messages(delivery: Delivery, ids: Sequence[str], *, arrived: bool = True) -> Iterator[Message]:
    """Make an object of each message of a delivery; one that has not arrived does not say when it will."""
    mailing, payloads = delivery.mailing, {}
    due = delivery.due if arrived else np.zeros_like(delivery.due)
    columns = delivery.rows, delivery.receivers, delivery.sequences, due
    for row, receiver, sequence, time in zip(*(column.tolist() for column in columns), strict=True):
        if row not in payloads:
            payloads[row] = mailing.payload(row)
        sender = ids[mailing.senders[row]]
        yield Message(sender, ids[receiver], payloads[row], mailing.kind, sequence, delivery.sent_time, time)


def chosen(delivery: Delivery, places: Indices | NDArray[np.bool_] | slice) -> Delivery:
    """Some of the messages of a delivery."""
    return replace(
        delivery,
        rows=delivery.rows[places],
        receivers=delivery.receivers[places],
        sequences=delivery.sequences[places],
        due=delivery.due[places],
    )


def spoken(mailing: Mailing, speaks: NDArray[np.bool_]) -> Mailing:
    """What some of the senders of a mailing say."""
    if speaks.all():
        return mailing
    columns = {name: values[speaks] for name, values in mailing.columns.items()}
    receivers = None if mailing.receivers is None else mailing.receivers[speaks]
    return replace(mailing, senders=mailing.senders[speaks], columns=columns, receivers=receivers)
