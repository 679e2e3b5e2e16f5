"""Parameters of a channel in a scenario: delay, loss, duplication, bandwidth and queue."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from symaware_cli.core import Parameters
from symaware_cli.engine.network.size import HEADER
from symaware_cli.world import Latency, Seconds

Probability = Annotated[float, Field(ge=0, le=1)]


class Bursts(Parameters):
    """Losses in bursts: the link changes between a good and a bad state from message to message.

    The model of Gilbert and Elliott (E. N. Gilbert, "Capacity of a Burst-Noise Channel", Bell System Technical Journal
    39, 1960; E. O. Elliott, "Estimates of Error Rates for Codes on Burst-Noise Channels", ibid. 42, 1963).
    """

    enter: Probability = Field(description="Probability that the bad state begins with a message.")
    leave: float = Field(gt=0, le=1, description="Probability that it ends with a message: one over its mean length.")
    good: Probability = Field(0.0, description="Probability that a message is lost in the good state.")
    bad: Probability = Field(1.0, description="Probability that a message is lost in the bad state.")


class ChannelParameters(Parameters):
    """Parameters of a link's channel."""

    delay: Latency = Field(
        0.0,
        description="How long a message travels [s]: a number, or a distribution such as {lognormal: [0.02, 0.5]}. "
        "What takes no time is readable at the next step of the world.",
    )
    jitter: Seconds = Field(0.0, description="How much longer it may take, drawn evenly [s].")
    loss: Probability | Bursts = Field(
        0.0,
        description="Probability that a message is lost; or losses in bursts, {enter: ..., leave: ...}: the "
        "probabilities that a bad state begins and ends with a message.",
    )
    duplication: Probability = Field(
        0.0, description="Probability that a message arrives a second time, with a delay of its own."
    )
    in_order: bool = Field(
        False, description="Whether messages wait for those that were sent before them over the same link."
    )
    bandwidth: float | None = Field(
        None,
        gt=0,
        le=1e15,
        description="How much the link carries [bytes/s]; messages that follow each other faster wait in a queue. "
        "No limit if left out.",
    )
    queue: float | None = Field(
        None,
        ge=HEADER,
        le=1e15,
        description="How much may wait or be on its way into the link [bytes]; any if left out. No message is smaller "
        f"than {HEADER}.",
    )
    queue_length: int | None = Field(
        None,
        ge=1,
        le=1000,
        description="How many messages may wait or be on their way into the link, of any size; no limit if left out.",
    )
    drop: Literal["tail", "head"] = Field(
        "tail", description="What is dropped from a full queue: the new message, or the one that waits longest."
    )
    max_age: float | None = Field(
        None, gt=0, le=1e9, description="A message that arrives later than this is dropped [s]; none if left out."
    )

    def changed(self, other: ChannelParameters) -> ChannelParameters:
        """Return a copy with the parameters that another one sets explicitly."""
        return self.model_copy(update={name: getattr(other, name) for name in other.model_fields_set})

    @property
    def is_bounded(self) -> bool:
        """Whether the queue has a limit."""
        return self.queue is not None or self.queue_length is not None

    @property
    def is_perfect(self) -> bool:
        """Whether every message is delivered without delay."""
        return self == ChannelParameters()
