"""Sudden changes of the true state."""

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


class Push(Fault):
    """A sudden change of the true state, if the world supports it."""

    class Parameters(core.Parameters):
        """A sudden change of the true state."""

        of: AgentPattern
        by: list[Number] = Field(min_length=1, description="Change of the true state, in the model's order and units.")

    lasts: ClassVar = False

    agents: Sequence[AgentSelection]
    change: NDArray[np.float64]

    @property
    def source(self) -> str:
        """The agents."""
        return f"agents.{self.parameters.of}"

    @property
    def text(self) -> str:
        """Names the agents."""
        return f"pushes {self.parameters.of}"

    def resolve(self, context: FaultContext) -> None:
        """Find the agents, and check that the world can do this."""
        self.agents = context.agents(self.parameters.of, "of")
        self.change = context.vector(self.parameters.by, [each.group for each in self.agents], "by")
        context.require_pushes()

    def begin(self, run: FaultTargets) -> Any:
        """Change the states."""
        for each in self.agents:
            run.push(each, self.change)
