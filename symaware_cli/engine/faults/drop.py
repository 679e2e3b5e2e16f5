"""Messages that are lost."""

from __future__ import annotations

from pydantic import Field

from symaware_cli.engine.faults.message_fault import LinkFault, LinkParameters
from symaware_cli.engine.runtime.fault import FaultContext


class Drop(LinkFault):
    """Messages that are lost."""

    class Parameters(LinkParameters):
        """Messages that are lost."""

        probability: float = Field(1.0, ge=0, le=1, description="Probability that a message is lost.")

    @property
    def text(self) -> str:
        """Names the links."""
        return f"drops messages {self.links}"

    def resolve(self, context: FaultContext) -> None:
        """Find the senders and receivers."""
        super().resolve(context)
        self.loss = self.parameters.probability
