"""Messages that are delayed."""

from __future__ import annotations

from pydantic import Field

from symaware_cli.core import nanoseconds
from symaware_cli.engine.faults.message_fault import LinkFault, LinkParameters
from symaware_cli.engine.runtime.fault import FaultContext


class Delay(LinkFault):
    """Messages that are delayed."""

    class Parameters(LinkParameters):
        """Messages that are delayed."""

        by: float = Field(gt=0, le=1e9, description="Additional delay [s].")

    @property
    def text(self) -> str:
        """Names the links."""
        return f"delays messages {self.links} by {self.parameters.by:g} s"

    def resolve(self, context: FaultContext) -> None:
        """Find the senders and receivers."""
        super().resolve(context)
        self.delay = nanoseconds(self.parameters.by)
