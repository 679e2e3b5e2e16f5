"""Components that take no turns."""

from __future__ import annotations

from typing import Any

from symaware_cli.engine.faults.component_fault import ComponentFault
from symaware_cli.engine.runtime.fault import FaultTargets


class Freeze(ComponentFault):
    """A component takes no turns."""

    @property
    def text(self) -> str:
        """Names the components."""
        return f"freezes {self.of}"

    def begin(self, run: FaultTargets) -> Any:
        """Suspend the components; the values that they wrote remain."""
        for each in self.components:
            run.suspend(each)

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Resume the components."""
        for each in self.components:
            run.resume(each)
