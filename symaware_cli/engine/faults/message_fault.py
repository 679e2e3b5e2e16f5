"""Base class of the faults of messages and links."""

from __future__ import annotations

import math
from typing import Any

from pydantic import Field

from symaware_cli import core
from symaware_cli.core.identifiers import AgentPattern
from symaware_cli.engine.runtime.fault import Fault, FaultContext, FaultTargets, Ways


class MessageFault(Fault):
    """A fault that lets messages from some agents to others be lost or delayed.

    Attributes:
        ways: The senders and receivers concerned.
        loss: Probability that a message is lost.
        delay: Additional delay of a message, in nanoseconds.
        bandwidth: Greatest data rate of each link [bytes/s].
        in_time: Whether messages are neither lost nor delayed.
        draw: Names other random draws for the fates of messages; empty for those of the run.
    """

    ways: Ways
    loss: float = 0.0
    delay: int = 0
    bandwidth: float = math.inf
    in_time: bool = False
    draw: str = ""

    @property
    def source(self) -> str:
        """The message exchange."""
        return "exchange"

    def begin(self, run: FaultTargets) -> Any:
        """Disturb the message exchange."""
        return run.disturb_messages(
            self.name, self.ways, self.loss, self.delay, self.bandwidth, in_time=self.in_time, draw=self.draw
        )

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Remove the disturbance."""
        run.restore_messages(begun)


class LinkParameters(core.Parameters):
    """The links that a fault is about."""

    sender: AgentPattern = Field("*")
    receiver: AgentPattern = Field("*")


class LinkFault(MessageFault):
    """A fault of the messages from senders to receivers."""

    Parameters = LinkParameters

    @property
    def links(self) -> str:
        """The links in words."""
        return f"from {self.parameters.sender} to {self.parameters.receiver}"

    def resolve(self, context: FaultContext) -> None:
        """Find the senders and receivers, and check that there can be a link."""
        senders = context.ids(self.parameters.sender, "sender")
        receivers = context.ids(self.parameters.receiver, "receiver")
        context.require_link(senders, receivers)
        self.ways = [(senders, receivers)]
