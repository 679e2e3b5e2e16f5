"""Links that lose all messages."""

from __future__ import annotations

from pydantic import Field

from symaware_cli import core
from symaware_cli.core.identifiers import AGENTS, Target
from symaware_cli.engine.faults.message_fault import MessageFault
from symaware_cli.engine.runtime.fault import FaultContext


class Cut(MessageFault):
    """Links that lose all messages, in both directions."""

    class Parameters(core.Parameters):
        """Links that lose all messages, in both directions."""

        between: tuple[Target, Target] = Field(description=f"The two ends of the links. {AGENTS}")

    loss = 1.0

    @property
    def text(self) -> str:
        """Names both ends."""
        return f"cuts the links between {' and '.join(self.parameters.between)}"

    def resolve(self, context: FaultContext) -> None:
        """Find the agents at both ends."""
        one, other = (context.ids(pattern, "between", place) for place, pattern in enumerate(self.parameters.between))
        context.require_link(one, other, "between")
        self.ways = [(one, other), (other, one)] if one != other else [(one, other)]
