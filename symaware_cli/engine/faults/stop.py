"""Agents that stop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from symaware_cli.engine.runtime.fault import AgentSelection, Fault, FaultContext, FaultTargets
from symaware_cli.engine.runtime.target_parameters import AgentParameters


class Stop(Fault):
    """Agents take no part; afterwards they restart."""

    Parameters = AgentParameters

    agents: Sequence[AgentSelection]

    @property
    def source(self) -> str:
        """The agents."""
        return f"agents.{self.parameters.root}"

    @property
    def text(self) -> str:
        """Names the agents."""
        return f"stops {self.parameters.root}"

    def resolve(self, context: FaultContext) -> None:
        """Find the agents."""
        self.agents = context.agents(self.parameters.root)

    def begin(self, run: FaultTargets) -> Any:
        """Take the agents out of the run."""
        for each in self.agents:
            run.stop(each, f"stopped by the fault `{self.name}`")

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Restart the agents that have no other reason to be stopped."""
        for each in self.agents:
            run.revive(each)
