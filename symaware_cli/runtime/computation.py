"""Computations that take simulated time, or a process of their own: begun now, and landing with an update later."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from symaware_cli.core import Event, Level
from symaware_cli.core.chance import Turn
from symaware_cli.runtime.agenda import Phase
from symaware_cli.runtime.task import FAILED, computed
from symaware_cli.runtime.turn import in_turn
from symaware_cli.runtime.workers import Computed, WorkerError

if TYPE_CHECKING:
    from symaware_cli.runtime.activity import Activity

#: A row, the turn that it is busy with, and what it computed then.
Landing = tuple[int, Turn, Any]


class Computation:
    """The halves of turns that are not coroutines: computing with the data of now, and updating when that is over."""

    def __init__(self, activity: Activity) -> None:
        self._activity = activity
        self._slot = activity.slot
        self._run = activity.run
        self._events = activity.run.simulation.events

    def begin(self, rows: Sequence[int]) -> None:
        """Let the components of some rows compute, and enter their updates.

        Raises:
            RunError: One failed, and that ends the run.
        """
        activity, agenda = self._activity, self._run.agenda
        now, landings = agenda.now, dict[int, list[Landing]]()
        turns = {row: activity.begin_turn(row) for row in rows}
        for row, value in self._values(turns):
            if value is FAILED:
                continue
            turn = turns[row]
            activity.occupy(row, turn)
            time = now + activity.supervision.latency(row, turn)
            if time == now:
                self._land([(row, turn, value)])
            else:
                landings.setdefault(time, []).append((row, turn, value))
        for time, landing in sorted(landings.items()):
            agenda.put(time, activity.place, Phase.LANDING, landing[0][0], partial(self._land, landing))

    def _values(self, turns: Mapping[int, Turn]) -> Iterator[tuple[int, Any]]:
        """Yield what each component computes, one after the other; in workers they compute all at once before."""
        activity, run, events = self._activity, self._run, self._events
        done: dict[int, Computed | WorkerError] | None = None
        if self._slot.timing.in_process:
            done = activity.attempt(next(iter(turns)), run.workers.compute, self._slot, turns)
            if done is FAILED:
                return
        for row, turn in turns.items():
            component = self._slot.components[row]
            if "computing" in events.wanted:
                component._announce("computing")
            if done is None:
                with in_turn(component, turn):
                    value = activity.attempt(row, component._compute)
                yield row, value
                continue
            outcome = done[row]
            if isinstance(outcome, WorkerError):
                activity.fail(row, activity.failure(component, outcome.problem, outcome))
                yield row, FAILED
                continue
            for name, source, level, text, data in outcome.events:
                events.fire(Event(name, source, run.agenda.now, Level(level), text, data, component))
            yield row, outcome.value

    def _land(self, landing: Sequence[Landing]) -> None:
        """Update with values that were computed before, unless their component was stopped meanwhile."""
        activity, wanted = self._activity, self._events.wanted
        before, landed = activity.present(), []
        with activity.supervision.watched():
            for row, turn, value in landing:
                if not activity.vacate(row, turn):
                    continue
                component = self._slot.components[row]
                if "computed" in wanted:
                    component._announce("computed")
                with in_turn(component, turn), computed(component, turn.instant):
                    activity.attempt(row, component.update, value)
                landed.append(row)
        activity.check(before)
        for row in landed:
            activity.over(row)
