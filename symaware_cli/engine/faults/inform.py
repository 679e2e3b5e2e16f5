"""Knowledge that is replaced."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from symaware_cli import core
from symaware_cli.core.identifiers import AgentPattern, Name
from symaware_cli.engine.runtime.fault import AgentSelection, Fault, FaultContext, FaultTargets


class Inform(Fault):
    """Knowledge that is replaced, such as a goal."""

    class Parameters(core.Parameters):
        """Knowledge that is replaced."""

        of: AgentPattern
        knowledge: dict[Name, Any] = Field(
            min_length=1, description="The new values, by name; each of the same kind as the one that it replaces."
        )

    lasts: ClassVar = False

    #: The agents, with the new values of each of them by name.
    known: Sequence[tuple[AgentSelection, Sequence[Mapping[str, Any]]]]

    @property
    def source(self) -> str:
        """The agents."""
        return f"agents.{self.parameters.of}"

    @property
    def text(self) -> str:
        """Names the agents and the knowledge."""
        return f"tells {self.parameters.of} another {', '.join(self.parameters.knowledge)}"

    def resolve(self, context: FaultContext) -> None:
        """Determine the new values, and check that each is of the same kind as the present one."""
        agents = context.agents(self.parameters.of, "of")
        self.known = [(each, self._known(context, each)) for each in agents]

    def _known(self, context: FaultContext, agents: AgentSelection) -> Sequence[Mapping[str, Any]]:
        values = self.parameters.knowledge
        known = context.knowledge(agents, values, "knowledge")
        before = dict(agents.group.knowledge[agents.rows[0]])
        for name in values:
            if name not in before:
                said = f"{context.quoted(agents.group.name)} has no knowledge {context.quoted(name)}"
                context.refuse(said, "knowledge", name, key=True, known=before)
            was = before[name]
            if _kind(was) != _kind(known[0][name]):
                shown = was.tolist() if isinstance(was, np.ndarray) else was
                said = f"the knowledge {context.quoted(name)} is of another kind"
                context.refuse(said, "knowledge", name, expected=f"as {shown!r}")
        return known

    def begin(self, run: FaultTargets) -> Any:
        """Replace the values."""
        for (group, rows), known in self.known:
            for row, values in zip(rows, known, strict=True):
                group.knowledge[row].update(values)


def _kind(value: Any) -> object:
    """What kind of knowledge a value is: numbers of a shape, a list of other things or of nothing, or another class."""
    try:
        numbers = np.asarray(value, float)
    except (TypeError, ValueError):
        return Sequence if isinstance(value, list | tuple) else type(value)
    return numbers.shape if numbers.shape != (0,) else Sequence
