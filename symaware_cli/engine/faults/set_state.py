"""True states that are set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli import core
from symaware_cli.core.identifiers import AgentPattern
from symaware_cli.engine.runtime.fault import AgentSelection, Fault, FaultContext, FaultTargets
from symaware_cli.geometry import Number


class SetState(Fault):
    """A true state that is set, if the world supports sudden changes of it."""

    class Parameters(core.Parameters):
        """A true state that is set."""

        of: AgentPattern
        state: list[Number] = Field(min_length=1, description="The new true state, in the model's order and units.")

    lasts: ClassVar = False

    agents: Sequence[AgentSelection]
    state: NDArray[np.float64]

    @property
    def source(self) -> str:
        """The agents."""
        return f"agents.{self.parameters.of}"

    @property
    def text(self) -> str:
        """Names the agents."""
        return f"sets the state of {self.parameters.of}"

    def resolve(self, context: FaultContext) -> None:
        """Find the agents, and check that the world can do this."""
        self.agents = context.agents(self.parameters.of, "of")
        self.state = context.vector(self.parameters.state, [each.group for each in self.agents], "state")
        context.require_pushes()

    def begin(self, run: FaultTargets) -> Any:
        """Add the difference to each state."""
        for group, rows in self.agents:
            for row in rows:
                run.push(AgentSelection(group, [row]), self.state - run.environment.state(group)[row])
