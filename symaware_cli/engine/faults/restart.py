"""Components that restart."""

from __future__ import annotations

from typing import Any, ClassVar

from symaware_cli.engine.faults.component_fault import ComponentFault
from symaware_cli.engine.runtime.fault import FaultTargets


class Restart(ComponentFault):
    """Components are restarted."""

    lasts: ClassVar = False

    @property
    def text(self) -> str:
        """Names the components."""
        return f"restarts {self.of}"

    def begin(self, run: FaultTargets) -> Any:
        """Cancel the present turns, and initialise the components again."""
        for each in self.components:
            run.restart(each)
