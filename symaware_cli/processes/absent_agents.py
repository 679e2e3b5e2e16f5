"""The steps that the agents of a member missed, because its process died and the run went on."""

from __future__ import annotations

from collections.abc import Sequence

from symaware_cli.core import AgentGroup
from symaware_cli.core.message import Indices
from symaware_cli.engine import Coast, Shared


class Absence:
    """Stops the agents of a member for the steps that they missed, as the fault `stop` does.

    Attributes:
        first: The number of the first of these steps.
        until: The number of the step at which the agents take part again; None until the host has sent it.
        is_in_force: Whether the agents are stopped.
    """

    def __init__(self, first: int, run: Shared, rows: Sequence[tuple[AgentGroup, Indices]]) -> None:
        """Initialise; the agents still take part.

        Args:
            first: See `Absence`.
            run: The run.
            rows: The agents, by group.
        """
        self.first = first
        self.until: int | None = None
        self.is_in_force = False
        self._run = run
        self._rows = [(group, each.tolist()) for group, each in rows]

    def covers(self, step: int) -> bool:
        """Whether the agents miss a step."""
        return step >= self.first and (self.until is None or step < self.until)

    def update(self, step: int) -> bool:
        """Stop the agents or let them take part again, before the turns of a step; return whether the absence is over.

        Args:
            step: The number of the step.
        """
        membership = self._run.membership
        if self.covers(step) and not self.is_in_force:
            self.is_in_force = True
            for group, rows in self._rows:
                timings = [each.entry.timing for each in self._run.schedulers if each.entry.group is group]
                coast: Coast = "safe" if any(each.coast == "safe" for each in timings) else "last"
                membership.retire(group, rows, coast, "their process is gone")
        is_over = self.until is not None and step >= self.until
        if is_over and self.is_in_force:
            self.is_in_force = False
            for group, rows in self._rows:
                membership.revive(group, rows)
        return is_over
