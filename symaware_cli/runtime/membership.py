"""Membership: which agents take part in a run, and what becomes of those who do not any more."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from symaware_cli.core import AgentGroup, Level, Model
from symaware_cli.core.column import Array, is_finite
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.runtime.timing import Coast

if TYPE_CHECKING:
    from symaware_cli.runtime.scheduler import TurnScheduler


class Membership:
    """Takes agents out of a run and lets them come back."""

    def __init__(self, simulation: Simulation, schedulers: Sequence[TurnScheduler]) -> None:
        self._simulation = simulation
        self._schedulers = schedulers
        #: How many reasons there are against each agent that takes no part: faults, and failures, which stay.
        self._reasons: Counter[tuple[str, int]] = Counter()

    def retire(self, group: AgentGroup, rows: Iterable[int], coast: Coast, reason: str) -> None:
        """Take agents out of the run: their components take no further turns, and the world moves them on.

        What has arrived for them and was not read is thrown away, and what still arrives is not kept. They come back
        when `revive` was called as often as this.

        Args:
            group: Their group.
            rows: Which agents of it.
            coast: Their control input from now on: the last one, or one that makes them stop as far as they can.
            reason: Why, in one sentence.
        """
        for row in rows:
            self._reasons[group.name, row] += 1
            if self._reasons[group.name, row] > 1:
                continue
            if coast == "safe":
                one = slice(row, row + 1)
                safe = safe_input(group.model, group.control_input[one], group.awareness.state[one])
                group.control_column.set_row(row, safe)
            for scheduler in self._schedulers:
                if scheduler.slot.group is group:
                    scheduler.hold(row)
            self._simulation.exchange.inboxes.close(group.ids[row])
            self._simulation.announce("terminated", f"agents.{group.ids[row]}", reason, level=Level.WARNING)

    def revive(self, group: AgentGroup, rows: Iterable[int]) -> None:
        """There is a reason less against some agents; those without any begin anew, as do their components."""
        rows = [row for row in rows if self._is_free(group, row)]
        for row in rows:
            self._simulation.exchange.inboxes.reopen(group.ids[row])
        for scheduler in self._schedulers:
            if scheduler.slot.group is group:
                for row in rows:
                    scheduler.release(row)
                scheduler.begin_anew(rows)

    def _is_free(self, group: AgentGroup, row: int) -> bool:
        """Take a reason away, and tell whether it was the last."""
        self._reasons[group.name, row] -= 1
        return not self._reasons[group.name, row]


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
