"""Sets of agents that do not reach each other."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field, RootModel

from symaware_cli.core.identifiers import Target
from symaware_cli.engine.faults.message_fault import MessageFault
from symaware_cli.engine.runtime.fault import FaultContext

_SETS = "Each is a list of ids, groups or patterns; all remaining agents form one more set."


class Partition(MessageFault):
    """Sets of agents that do not reach each other."""

    class Parameters(RootModel[Annotated[list[list[Target]], Field(min_length=1, description=_SETS)]]):
        """Sets of agents."""

        model_config = ConfigDict(frozen=True)

    loss = 1.0

    @property
    def text(self) -> str:
        """Names the sets."""
        return f"parts {', '.join('+'.join(each) for each in self.parameters.root)} from each other and from all others"

    def resolve(self, context: FaultContext) -> None:
        """Find the agents of each set, and those of none."""
        everybody = {id: None for group in context.groups for id in group.ids}
        parts: list[frozenset[str]] = []
        for number, patterns in enumerate(self.parameters.root):
            members: frozenset[str] = frozenset().union(
                *(context.ids(pattern, number, place) for place, pattern in enumerate(patterns))
            )
            twice = [id for id in everybody if id in members and any(id in part for part in parts)]
            if twice:
                context.refuse(f"{context.quoted(twice[0])} is in two sets", number)
            parts.append(members)
        rest = frozenset(everybody).difference(*parts)
        if len(parts) + bool(rest) < 2:
            context.refuse("all agents are in one set, so the partition has no effect")
        self.ways = [(part, frozenset(everybody) - part) for part in (*parts, rest) if part]
