"""Attendance: which agents take part in a run, and what becomes of those who do not any more."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from symaware_cli.core import AgentGroup, Level, Model
from symaware_cli.core.column import Array, is_finite
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.runtime.timing import Coast

if TYPE_CHECKING:
    from symaware_cli.runtime.activity import Activity


class Attendance:
    """Takes agents out of a run and lets them come back."""

    def __init__(self, simulation: Simulation, activities: Sequence[Activity]) -> None:
        self._simulation = simulation
        self._activities = activities
        self._retired: set[tuple[str, int]] = set()

    def retire(self, group: AgentGroup, rows: Iterable[int], coast: Coast, reason: str) -> None:
        """Take agents out of the run: their components take no further turns, and the world moves them on.

        What has arrived for them and was not read is thrown away, and what still arrives is not kept.

        Args:
            group: Their group.
            rows: Which agents of it.
            coast: Their control input from now on: the last one, or one that makes them stop as far as they can.
            reason: Why, in one sentence.
        """
        for row in rows:
            if (group.name, row) in self._retired:
                continue
            self._retired.add((group.name, row))
            if coast == "safe":
                one = slice(row, row + 1)
                safe = safe_input(group.model, group.control_input[one], group.awareness.state[one])
                group.control_column.set_row(row, safe)
            for activity in self._activities:
                if activity.slot.group is group:
                    activity.hold(row)
            self._simulation.exchange.inboxes.close(group.ids[row])
            self._simulation.announce("terminated", f"agents.{group.ids[row]}", reason, level=Level.WARNING)

    def is_retired(self, group: AgentGroup, row: int) -> bool:
        """Whether an agent was taken out of the run."""
        return (group.name, row) in self._retired

    def revive(self, group: AgentGroup, rows: Sequence[int]) -> None:
        """Let agents that were taken out of the run begin anew, with components that were initialised again."""
        for row in rows:
            self._retired.discard((group.name, row))
            self._simulation.exchange.inboxes.reopen(group.ids[row])
        for activity in self._activities:
            if activity.slot.group is group:
                for row in rows:
                    activity.release(row)
                activity.begin_anew(rows)


def safe_input(model: Model, before: Array, state: Array) -> Array:
    """The control input that makes an agent stop, as far as its model can.

    Args:
        model: Its dynamics.
        before: Its control input until now; shape (1, nu).
        state: Its state; shape (1, nx).

    Returns:
        Shape (nu,).
    """
    try:
        chosen = model.limit(model.slowed(state, before, np.zeros(1)))
    except NotImplementedError:
        chosen = model.limit(np.zeros_like(before))
    safe: Array = chosen[0] if is_finite(chosen) else before[0]
    return safe
