"""Another fault that does not happen.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field, RootModel

from symaware_cli.core.identifiers import Name
from symaware_cli.engine.runtime.fault import Fault, FaultContext, FaultTargets


class Prevent(Fault):
    """Another fault that does not happen: from now on it does not begin, and it ends if it has begun.

    It acts before other faults of the same instant. The effect of an earlier instantaneous fault stays.
    """

    class Parameters(RootModel[Annotated[Name, Field(description="The name of that fault.")]]):
        """The name of another fault."""

        model_config = ConfigDict(frozen=True)

    lasts: ClassVar = False
    precedes: ClassVar = True

    @property
    def text(self) -> str:
        """Names the other fault."""
        return f"prevents {self.parameters.root}"

    def resolve(self, context: FaultContext) -> None:
        """Check that there is such a fault."""
        name = self.parameters.root
        if name not in context.others:
            context.refuse_unknown("other fault", name, context.others)

    def begin(self, run: FaultTargets) -> Any:
        """End the other fault, if it is active, and let it not begin any more."""
        run.prevent_fault(self.parameters.root)
