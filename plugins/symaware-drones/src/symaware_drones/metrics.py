"""Metrics of sweeps: how often rounds were limited or a constraint relaxed."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from symaware_cli import AgentGroup, Metric, Parameters
from symaware_drones.controller import ROUND


class RoundShare(Metric):
    """The share of an agent's instants, from its first round on, at which a condition holds in its last round."""

    class Parameters(Parameters):
        """The agent, the component and the condition."""

        agent: str = Field(description="The id of the agent.")
        component: str = Field("steer", description="The name of its `drones.barrier`.")
        of: Literal["limited", "relaxed"] = Field(
            "limited",
            description="Whether gamma was limited to the interval from 0 to 1, or a constraint had to be relaxed.",
        )

    def begin(self) -> None:
        """Find the agent.

        Raises:
            ValueError: There is no such agent, or it has no such component.
        """
        self._instants = self._count = 0
        self._group, self._row = self._find()

    def _find(self) -> tuple[AgentGroup, int]:
        name = self.parameters.agent
        found = next(((group, group.ids.index(name)) for group in self.groups if name in group.ids), None)
        if found is None or ROUND.field(self.parameters.component) not in found[0].awareness.columns:
            raise ValueError(f"there is no agent `{name}` with a `drones.barrier` named `{self.parameters.component}`")
        return found

    def look(self, now: int) -> None:
        """Count the instant."""
        last = self._group.awareness.columns[ROUND.field(self.parameters.component)].present(self._row)
        gamma, wanted, _, missing, _ = np.asarray(last, float)
        if np.isfinite(gamma):
            self._instants += 1
            self._count += bool(missing > 0.0 if self.parameters.of == "relaxed" else gamma != wanted)

    def value(self) -> float | None:
        """The share; None if there was no round."""
        return self._count / self._instants if self._instants else None
