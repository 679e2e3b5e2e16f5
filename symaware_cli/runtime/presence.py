"""Presence: when an agent is in the world, as a scenario says it."""

from __future__ import annotations

from dataclasses import dataclass

from symaware_cli.runtime.timing import Trigger
from symaware_cli.specification.expression import Expression

#: An instant in nanoseconds, a condition, or an event.
Moment = int | Expression | Trigger


@dataclass(frozen=True, slots=True)
class PresenceInterval:
    """When an agent is in the world.

    Attributes:
        begin: When it enters: a condition is one of the world. None for the beginning of the run.
        end: When it leaves: a condition is one of the agent. None for never.
    """

    begin: Moment | None = None
    end: Moment | None = None

    @property
    def is_late(self) -> bool:
        """Whether the agent is not there when the run begins."""
        return self.begin is not None and self.begin != 0
