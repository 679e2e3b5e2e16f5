"""Messages that arrive in time, and the placebo: messages whose fates are drawn anew.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

from pydantic import Field

from symaware_cli.engine.faults.message_fault import LinkFault, LinkParameters
from symaware_cli.engine.runtime.fault import FaultContext


class Deliver(LinkFault):
    """Messages that arrive in time; or, as a placebo, messages whose fates are drawn anew.

    A message in time can be read at the next step, as without a network, regardless of its channel and other faults.
    Only a link that the topology lacks stays without messages. The channel keeps its memory of the message, so that
    other messages meet the same fates as without this fault; a queue that drops its head does not hold it.

    With the placebo, the draws of the channels and faults for these messages have other keys: other messages of the
    same links are lost or late.
    """

    class Parameters(LinkParameters):
        """Messages that arrive in time."""

        placebo: bool = Field(False, description="Whether the fates of the messages are drawn anew instead.")
        draw: int = Field(0, ge=0, le=2**53, description="With `placebo: true`, tells one placebo from another.")

    @property
    def text(self) -> str:
        """Names the links."""
        does = "draws anew the fates of" if self.parameters.placebo else "delivers in time"
        return f"{does} messages {self.links}"

    def resolve(self, context: FaultContext) -> None:
        """Find the senders and receivers."""
        super().resolve(context)
        self.in_time = not self.parameters.placebo
        self.draw = str(self.parameters.draw) if self.parameters.placebo else ""
