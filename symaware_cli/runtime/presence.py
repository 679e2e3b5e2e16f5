"""Presence: when an agent enters and leaves the world, as declared in a scenario."""

from __future__ import annotations

from dataclasses import dataclass

from symaware_cli.runtime.timing import Trigger
from symaware_cli.specification.expression import Expression

#: An instant in nanoseconds, a condition, or an event.
Moment = int | Expression | Trigger


@dataclass(frozen=True, slots=True)
class PresenceInterval:
    """The interval in which an agent is in the world.

    Attributes:
        begin: When it enters; a condition is evaluated in the scope of the world. None for the start of the run.
        end: When it leaves; a condition is evaluated in the scope of the agent. None for never.
    """

    begin: Moment | None = None
    end: Moment | None = None

    @property
    def is_late(self) -> bool:
        """Whether the agent is absent when the run begins."""
        return self.begin is not None and self.begin != 0
