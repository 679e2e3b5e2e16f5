"""Base class of the faults of components."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from pydantic import BaseModel, RootModel

from symaware_cli.engine.runtime.fault import ComponentSelection, Fault, FaultContext
from symaware_cli.engine.runtime.target_parameters import ComponentParameters


class ComponentFault(Fault):
    """A fault of the components that its parameters name, either as ``of`` or with nothing else.

    Attributes:
        components: The components; none if the fault is not resolved.
    """

    Parameters: ClassVar[type[BaseModel]] = ComponentParameters

    components: Sequence[ComponentSelection] = ()

    @property
    def of(self) -> str:
        """The components as they are written."""
        written = self.parameters.root if isinstance(self.parameters, RootModel) else self.parameters.of
        return str(written)

    @property
    def source(self) -> str:
        """The components."""
        return f"agents.{self.of}"

    def resolve(self, context: FaultContext) -> None:
        """Find the components."""
        place = () if isinstance(self.parameters, RootModel) else ("of",)
        self.components = context.components(self.of, *place)
