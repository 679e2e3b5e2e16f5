"""Components whose computations take longer."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from symaware_cli import core
from symaware_cli.core.identifiers import ComponentPattern
from symaware_cli.engine.faults.component_fault import ComponentFault
from symaware_cli.engine.runtime.fault import FaultContext, FaultTargets
from symaware_cli.world import Latency, ProbabilityDistribution


class Slow(ComponentFault):
    """A component whose computations take longer."""

    class Parameters(core.Parameters):
        """A component whose computations take longer."""

        of: ComponentPattern
        latency: Latency = Field(
            description="Duration of a computation during the fault [s]; see the `latency` of a component."
        )

    duration: ProbabilityDistribution

    @property
    def text(self) -> str:
        """Names the components."""
        return f"slows {self.of}"

    def resolve(self, context: FaultContext) -> None:
        """Find the components."""
        super().resolve(context)
        self.duration = context.duration(self.parameters.latency)

    def begin(self, run: FaultTargets) -> Any:
        """Impose the latency; of several such faults, the longest applies."""
        for each in self.components:
            run.slow_down(each, self.duration)

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Restore the latency of the scenario, or of other faults."""
        for each in self.components:
            run.speed_up(each, self.duration)
