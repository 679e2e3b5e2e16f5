"""Turns with a latency between computing and updating, or with a computation in a worker process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from symaware_cli.core import Event, Level
from symaware_cli.engine.runtime.guard import FAILED, Guard
from symaware_cli.engine.runtime.queue import Phase, Queue
from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.engine.runtime.turn import TurnsInProgress, computed_at, in_turn
from symaware_cli.engine.runtime.workers import WorkerError
from symaware_cli.world import Turn

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.workers import Computed, Workers

#: A row, its unfinished turn, and the value computed in it.
Landing = tuple[int, Turn, Any]

#: The kind of the queue entries of updates; their payload is a list of `Landing`.
_KIND = "update"


class DelayedTurns:
    """Runs the two halves of such turns: computing with the present data, and updating after the latency."""

    def __init__(
        self,
        simulation: Simulation,
        entry: ComponentEntry,
        place: int,
        queue: Queue,
        guard: Guard,
        progress: TurnsInProgress,
        workers: Workers,
        on_done: Callable[[int], object],
    ) -> None:
        """Prepare.

        Args:
            simulation: The simulation.
            entry: The component entry.
            place: Its index among all entries.
            queue: The queue for updates.
            guard: Calls the components.
            progress: The unfinished turns.
            workers: Run the computations of components with `run_in: process`.
            on_done: Called with the row of each finished turn.
        """
        self._simulation = simulation
        self._events = simulation.events
        self._entry = entry
        self._place = place
        self._queue = queue
        self._guard = guard
        self._progress = progress
        self._workers = workers
        self._on_done = on_done
        queue.register(place, {_KIND: self._land})

    def take(self, rows: Sequence[int]) -> None:
        """Compute with the components of some rows, and queue their updates.

        Raises:
            RunError: A component failed, and that ends the run.
        """
        progress, guard = self._progress, self._guard
        now, landings = self._queue.clock.now, dict[int, list[Landing]]()
        turns = {row: progress.begin(row, now) for row in rows}
        for row, value in self._values(turns):
            if value is FAILED:
                continue
            turn = turns[row]
            progress.add(row, turn)
            time = now + guard.supervision.latency(row, turn)
            if time == now:
                self._land(row, [(row, turn, value)])
            else:
                landings.setdefault(time, []).append((row, turn, value))
        for time, landing in sorted(landings.items()):
            self._queue.put(time, self._place, Phase.LANDING, landing[0][0], _KIND, landing)

    def _values(self, turns: Mapping[int, Turn]) -> Iterator[tuple[int, Any]]:
        """Yield the value that each component computes, in order; computations in workers run in parallel before."""
        guard, events = self._guard, self._events
        done: dict[int, Computed | WorkerError] | None = None
        if self._entry.timing.in_process:
            done = guard.attempt(next(iter(turns)), self._workers.compute, self._entry, turns)
            if done is FAILED:
                return
        for row, turn in turns.items():
            component = self._entry.components[row]
            if "computing" in events.wanted:
                component._announce("computing")
            if done is None:
                with in_turn(component, turn):
                    value = guard.attempt(row, component._compute)
                yield row, value
                continue
            outcome = done[row]
            if isinstance(outcome, WorkerError):
                guard.handle_failure(row, guard.failure(component, outcome.problem, outcome))
                yield row, FAILED
                continue
            for name, source, level, text, data in outcome.events:
                agent = self._simulation.agent_of(source)
                events.fire(Event(name, source, self._queue.clock.now, Level(level), text, data, component, agent))
            yield row, outcome.value

    def _land(self, row: int, landing: Sequence[Landing]) -> None:
        """Update with values computed before, unless the turn was cancelled in the meantime."""
        guard, wanted = self._guard, self._events.wanted
        before, landed = guard.snapshot(), []
        with guard.supervision.supervised():
            for row, turn, value in landing:
                if not self._progress.remove(row, turn):
                    continue
                component = self._entry.components[row]
                if "computed" in wanted:
                    component._announce("computed", value)
                with in_turn(component, turn), computed_at(component, turn.instant):
                    guard.attempt(row, component.update, value)
                landed.append(row)
        guard.check(before)
        for row in landed:
            self._on_done(row)
