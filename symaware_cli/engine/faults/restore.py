"""Another fault that ends early."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field, RootModel

from symaware_cli.core.identifiers import Name
from symaware_cli.engine.runtime.fault import Fault, FaultContext, FaultTargets


class Restore(Fault):
    """Another fault that ends early."""

    class Parameters(RootModel[Annotated[Name, Field(description="The name of that fault.")]]):
        """The name of another fault."""

        model_config = ConfigDict(frozen=True)

    lasts: ClassVar = False

    @property
    def text(self) -> str:
        """Names the other fault."""
        return f"ends {self.parameters.root}"

    def resolve(self, context: FaultContext) -> None:
        """Check that the other fault is active then, as far as that is known."""
        name = self.parameters.root
        if name not in context.others:
            context.refuse_unknown("other fault", name, context.others)
        other = context.others[name]
        if other is None:
            return
        if not other.lasts:
            said = f"{context.quoted(name)} is instantaneous and cannot be restored"
            context.refuse(said, expected="a fault that lasts")
        if self.at is None or other.at is None:
            return
        end = math.inf if other.lasting is None else other.at + other.lasting
        if not other.at < self.at < end:
            when = f"begins at {other.at / 1e9:g} s" if self.at <= other.at else f"is over at {end / 1e9:g} s"
            said = f"at {self.at / 1e9:g} s there is nothing to restore: {context.quoted(name)} {when}"
            context.refuse(said, "at", beside=True)

    def begin(self, run: FaultTargets) -> Any:
        """End the other fault, if it is active."""
        run.end_fault(self.parameters.root)
