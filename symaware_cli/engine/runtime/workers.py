"""A pool of worker processes for components with `run_in: process`: computations due together run in parallel."""

from __future__ import annotations

import os
import pickle
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, ClassVar

from symaware_cli.core import AgentGroup, Component, Environment, GroupComponent, Plugin
from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.world import Turn, record

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.replica import ComputationResult
    from symaware_cli.world import PythonChild


@record
class Computed:
    """The result of a computation in a worker.

    Attributes:
        value: The value that it returned.
        events: The events fired by it, in order: name, source, level, text and data of each.
    """

    value: Any
    events: tuple[tuple[Any, ...], ...]


class WorkerError(Exception):
    """A computation in a worker failed.

    Attributes:
        problem: The failure, in one line.
    """

    def __init__(self, problem: str, trace: str = "") -> None:
        super().__init__(problem)
        self.problem = problem
        if trace:
            self.add_note(f"In the worker process:\n{trace}")


class Workers:
    """Distributes the computations of some entries to worker processes.

    A component always computes in the same worker, so that objects that cannot be sent (such as a solver) keep their
    state. Results do not depend on the number of workers.
    """

    #: Workers have no state of their own: whatever differs is sent again.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, simulation: Simulation, entries: Sequence[ComponentEntry], count: int | None) -> None:
        """Prepare; `start` starts them.

        Args:
            simulation: The simulation.
            entries: The entries whose components compute in workers.
            count: The number of workers; None for one per core.
        """
        self._simulation = simulation
        self._entries = {entry.label: _RemoteEntry(simulation, entry, number) for number, entry in enumerate(entries)}
        self._workers = [_Worker(list(self._entries.values())) for _ in range(count or _cores())]

    def start(self) -> None:
        """Start all workers, if any entry needs them, and wait until they are ready."""
        if not self._entries:
            return
        for worker in self._workers:
            worker.start()
        for worker in self._workers:
            worker.wait_until_ready()

    def compute(self, entry: ComponentEntry, turns: Mapping[int, Turn]) -> dict[int, Computed | WorkerError]:
        """Run the computations of some components in parallel.

        Args:
            entry: The components' entry.
            turns: The turn that each component begins, by row.

        Returns:
            The results, by row.
        """
        remote, now = self._entries[entry.label], self._simulation.clock.now
        data = remote.transfer.knowledge(), remote.transfer.surroundings(sees_world=remote.sees_world)
        shares: dict[_Worker, list[int]] = {}
        for row in turns:
            shares.setdefault(self._workers[(remote.number + row) % len(self._workers)], []).append(row)
        results: dict[int, Computed | WorkerError] = {}
        requested = []
        try:
            for worker, share in shares.items():
                requested.append(worker)
                results |= worker.send_request(remote, now, data, {row: turns[row] for row in share})
            for worker, share in shares.items():
                results |= worker.receive_response(remote, [row for row in share if row not in results])
        except BaseException:
            # Interrupted: the responses will not be read.
            for worker in requested:
                worker.stop()
            raise
        return results

    def restart(self, entry: ComponentEntry, row: int) -> None:
        """Stop the worker of a component that restarts, as it may hold state that the component has not."""
        remote = self._entries[entry.label]
        self._workers[(remote.number + row) % len(self._workers)].stop()

    def close(self) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.stop()


class _RemoteEntry:
    """One entry as workers have it: its description, and the state that was sent."""

    def __init__(self, simulation: Simulation, entry: ComponentEntry, number: int) -> None:
        # Runs without such components import nothing of their processes.
        from symaware_cli.engine.runtime.replica import EntryDescription, EntryTransfer
        from symaware_cli.engine.runtime.state.transfer import packages

        self.entry = entry
        self.number = number
        environment, first = simulation.environment, entry.components[0]
        self.sees_world = first.sees_world
        is_group, known = isinstance(first, GroupComponent), packages(simulation)
        self.transfer = EntryTransfer(entry.group, simulation.groups, known, of_group=is_group)
        for component in entry.components:
            self.transfer.name({component.path: component})
        #: The state of each component as its worker has it, by row.
        self.sent: dict[int, bytes] = {}
        own = [None if type(each).Parameters is Plugin.Parameters else each.parameters for each in entry.components]
        self.transfer.name_parameters(own)
        description = EntryDescription(
            kind=type(first),
            parameters=own,
            attributes=[_attributes(each) for each in entry.components],
            group=entry.group.name,
            groups=[_arguments(each) for each in simulation.groups],
            time_step=environment.time_step,
            world=_world(environment) if self.sees_world else None,
            seed=simulation.seed,
            packages=known,
            known=(entry.group.regions, entry.group.sections),
            drive=entry.group.drive,
        )
        self.description = pickle.dumps(description)

    def changed(self, row: int) -> bytes | None:
        """Return the state of a component, or None if its worker has that state.

        Raises:
            StateError: The state cannot be captured.
        """
        state = self.transfer.component(self.entry.components[row])
        if state == self.sent.get(row):
            return None
        self.sent[row] = state
        return state

    def apply(self, outcome: ComputationResult) -> Computed | WorkerError:
        """Apply the new state of a component after a computation, and return its result."""
        row, component = outcome.row, self.entry.components[outcome.row]
        if outcome.value is None:
            return WorkerError(outcome.problem, outcome.trace)
        try:
            if outcome.state is not None:
                self.transfer.put(outcome.state)
                self.sent[row] = outcome.state
            return Computed(self.transfer.put_value(component, outcome.value), outcome.events)
        except StateError as error:
            return WorkerError(str(error))


def _arguments(group: AgentGroup) -> tuple[Any, ...]:
    """The arguments that create a group as it is at the start."""
    knowledge = [dict(each) for each in group.knowledge]
    parts, signals = tuple(group.awareness.parts.values()), group.awareness.signals
    return group.name, group.ids, group.model, group.entity, group.initial_state, knowledge, parts, signals


def _world(environment: Environment) -> tuple[Any, ...]:
    folders = environment.folder, environment.further_folders
    return type(environment), environment.parameters, folders, dict(environment.obstacles)


def _attributes(component: Component | GroupComponent) -> dict[str, Any]:
    return {"name": component.name, "path": component.path, "use": component.use, "period": component.period}


class _Worker:
    """One worker process and this process's ends of its two pipes."""

    def __init__(self, entries: Sequence[_RemoteEntry]) -> None:
        self._entries = entries
        self._child: PythonChild | None = None
        self._is_ready = False
        #: The knowledge and the surroundings sent last, by entry.
        self._known: dict[int, tuple[bytes, bytes]] = {}

    def start(self) -> None:
        """Start the process without waiting for it."""
        from symaware_cli.world import PythonChild, write

        if self._child is None:
            self._child = PythonChild("symaware_cli.engine.runtime.worker:serve")
            self._known.clear()
            with suppress(BrokenPipeError):  # `receive_response` finds out how the process ended
                write(self._child.requests, pickle.dumps([entry.description for entry in self._entries]))
            self._is_ready = False
            for entry in self._entries:
                entry.sent.clear()

    def wait_until_ready(self) -> None:
        """Wait until the process can respond.

        Raises:
            EOFError: The process ended before.
        """
        from symaware_cli.world import read

        if not self._is_ready:
            assert self._child is not None
            read(self._child.answers)
            self._is_ready = True

    def send_request(
        self, entry: _RemoteEntry, now: int, data: tuple[bytes, bytes], turns: Mapping[int, Turn]
    ) -> dict[int, WorkerError]:
        """Request computations, and return the errors of components that cannot be sent."""
        from symaware_cli.world import write

        states, wrong = [], {}
        with suppress(BrokenPipeError):  # `receive_response` finds out how the process ended
            self.start()
            known = self._known.get(entry.number, (None, None))
            news = [None if each == last else each for each, last in zip(data, known, strict=True)]
            self._known[entry.number] = data
            for row, turn in turns.items():
                try:
                    states.append((row, turn, entry.changed(row)))
                except StateError as error:
                    wrong[row] = WorkerError(str(error))
            assert self._child is not None
            write(self._child.requests, pickle.dumps((entry.number, now, *news, states)))
        return wrong

    def receive_response(self, entry: _RemoteEntry, rows: Sequence[int]) -> dict[int, Computed | WorkerError]:
        """Return the results, by row."""
        from symaware_cli.world import how_it_ended, read

        assert self._child is not None
        try:
            self.wait_until_ready()
            outcomes = pickle.loads(read(self._child.answers))
        except EOFError:
            error = WorkerError(f"its worker process {how_it_ended(self._child.close())}")
            self._child = None
            return dict.fromkeys(rows, error)
        return {outcome.row: entry.apply(outcome) for outcome in outcomes}

    def stop(self) -> None:
        """Kill the process."""
        if self._child is not None:
            self._child.kill()
            self._child.close()
            self._child = None


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
