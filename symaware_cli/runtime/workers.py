"""Worker processes: computations that are due together run together, each in one of a few processes."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO, ClassVar

from symaware_cli import processor
from symaware_cli.core import AgentGroup, Component, Environment, GroupComponent, Plugin
from symaware_cli.runtime.simulation import Simulation, Slot
from symaware_cli.runtime.worker import Codec, Part, State, group_data, read, write
from symaware_cli.world.chance import Turn


@dataclass(frozen=True, slots=True)
class Computed:
    """What a computation in a worker came to.

    Attributes:
        value: What it returned.
        events: What was fired meanwhile, in its order: name, source, level, text and data of each.
    """

    value: Any
    events: tuple[tuple[Any, ...], ...]


class WorkerError(Exception):
    """A computation in a worker failed.

    Attributes:
        problem: What happened, in one line.
    """

    def __init__(self, problem: str, trace: str = "") -> None:
        super().__init__(problem)
        self.problem = problem
        if trace:
            self.add_note(f"In the worker process:\n{trace}")


class Workers:
    """Computes for the components of some slots.

    A component always computes in the same worker, whatever the number of workers, so that what cannot be sent (such as
    a solver) stays what it was. Results do not depend on who computes.
    """

    #: They hold nothing that is not sent anew when it differs.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, simulation: Simulation, slots: Sequence[Slot], count: int | None) -> None:
        """Prepare; `start` starts them.

        Args:
            simulation: What runs.
            slots: Whose components compute in workers.
            count: How many workers; None for one for each core.
        """
        self._simulation = simulation
        self._offices = {slot.path: _Office(simulation, slot, number) for number, slot in enumerate(slots)}
        self._workers = [_Worker(list(self._offices.values())) for _ in range(count or _cores())]

    def start(self) -> None:
        """Start all workers, if there is anything for them to do, and wait until they are ready."""
        if not self._offices:
            return
        for worker in self._workers:
            worker.start()
        for worker in self._workers:
            worker.get_ready()

    def compute(self, slot: Slot, turns: Mapping[int, Turn]) -> dict[int, Computed | WorkerError]:
        """Let some components compute, all at once.

        Args:
            slot: Whose they are.
            turns: Which turn each begins, by row.

        Returns:
            What came of it, by row.
        """
        office, now = self._offices[slot.path], self._simulation.clock.now
        data = office.codec.encode(group_data(slot.group, sees_world=slot.components[0].sees_world))
        shares: dict[_Worker, list[int]] = {}
        for row in turns:
            shares.setdefault(self._workers[(office.number + row) % len(self._workers)], []).append(row)
        results: dict[int, Computed | WorkerError] = {}
        asked = []
        try:
            for worker, share in shares.items():
                asked.append(worker)
                worker.ask(office, now, data, {row: turns[row] for row in share})
            for worker, share in shares.items():
                results |= worker.answer(office, share)
        except BaseException:
            # Interrupted: nobody is going to listen to what they still have to say.
            for worker in asked:
                worker.stop()
            raise
        return results

    def restart(self, slot: Slot, row: int) -> None:
        """Let the worker of a component begin anew, too: it may hold what the component does not."""
        office = self._offices[slot.path]
        self._workers[(office.number + row) % len(self._workers)].stop()

    def close(self) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.stop()


class _Office:
    """What workers have to know of one slot, and how to talk about it."""

    def __init__(self, simulation: Simulation, slot: Slot, number: int) -> None:
        self.slot = slot
        self.number = number
        group = slot.group
        self.codec = Codec(group, group.surroundings, simulation.groups)
        first = slot.components[0]
        if not isinstance(first, GroupComponent):
            self.codec.name_agents()
        for row, component in enumerate(slot.components):
            self.codec.name_component(row, component)
        self.states = [State(self.codec, each) for each in slot.components]
        own = [None if type(each).Parameters is Plugin.Parameters else each.parameters for each in slot.components]
        environment = simulation.environment
        part = Part(
            kind=type(first),
            parameters=own,
            attributes=[_attributes(each) for each in slot.components],
            group=group.name,
            groups=[_arguments(each) for each in simulation.groups],
            time_step=environment.time_step,
            world=_world(environment) if first.sees_world else None,
            seed=simulation.seed,
        )
        self.part = pickle.dumps(part)


def _arguments(group: AgentGroup) -> tuple[Any, ...]:
    """What to make a group of again, as it is at the start."""
    knowledge = [dict(each) for each in group.knowledge]
    parts, signals = tuple(group.awareness.parts.values()), group.awareness.signals
    return group.name, group.ids, group.model, group.entity, group.initial_state, knowledge, parts, signals


def _world(environment: Environment) -> tuple[Any, ...]:
    return type(environment), environment.parameters, environment.folder, dict(environment.obstacles)


def _attributes(component: Component | GroupComponent) -> dict[str, str]:
    return {"name": component.name, "path": component.path, "use": component.use}


class _Worker:
    """One process, and both ends of its pipes that are ours."""

    def __init__(self, offices: Sequence[_Office]) -> None:
        self._offices = offices
        self._process: subprocess.Popen[bytes] | None = None
        self._is_ready = False
        self._requests: BinaryIO
        self._answers: BinaryIO
        #: The group's data that it has, by slot.
        self._known: dict[int, bytes] = {}

    def _start(self) -> None:
        theirs_in, ours_out = os.pipe()
        ours_in, theirs_out = os.pipe()
        code = f"from symaware_cli.runtime.worker import main; main({theirs_in}, {theirs_out}, {os.getpid()})"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", code],
            pass_fds=(theirs_in, theirs_out),
            stdin=subprocess.DEVNULL,
            env=processor.environment(),  # or results would depend on who computes them
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._requests, self._answers = os.fdopen(ours_out, "wb"), os.fdopen(ours_in, "rb")
        self._known.clear()
        write(self._requests, pickle.dumps(sys.path))
        write(self._requests, pickle.dumps([office.part for office in self._offices]))

    def start(self) -> None:
        """Start the process, and do not wait for it."""
        if self._process is None:
            self._start()
            self._is_ready = False
            for office in self._offices:
                for state in office.states:
                    state.forget()

    def get_ready(self) -> None:
        """Wait until it can answer.

        Raises:
            EOFError: It died before.
        """
        if not self._is_ready:
            read(self._answers)
            self._is_ready = True

    def ask(self, office: _Office, now: int, data: bytes, turns: Mapping[int, Turn]) -> None:
        """Let it compute."""
        try:
            self.start()
            known = self._known.get(office.number) == data
            self._known[office.number] = data
            states = [(row, turn, office.states[row].changed()) for row, turn in turns.items()]
            write(self._requests, pickle.dumps((office.number, now, None if known else data, states)))
        except BrokenPipeError:
            pass  # what became of it is found when its answer is asked for

    def answer(self, office: _Office, rows: Sequence[int]) -> dict[int, Computed | WorkerError]:
        """What came of it, by row."""
        try:
            self.get_ready()
            outcomes = pickle.loads(read(self._answers))
        except EOFError:
            error = WorkerError(f"its worker process {self._end()}")
            return dict.fromkeys(rows, error)
        found: dict[int, Computed | WorkerError] = {}
        for outcome in outcomes:
            if outcome.value is None:
                found[outcome.row] = WorkerError(outcome.problem, outcome.trace)
            else:
                office.states[outcome.row].take(outcome.state)
                found[outcome.row] = Computed(office.codec.decode(outcome.value), outcome.events)
        return found

    def _end(self) -> str:
        """Wait for the end of a worker that is dead, and say how it ended."""
        process = self._process
        assert process is not None
        self._requests.close()
        self._answers.close()
        status = process.wait()
        self._process = None
        if status < 0:
            return f"was killed by {signal.Signals(-status).name}"
        return f"ended with exit status {status}"

    def stop(self) -> None:
        """End it, whatever it is doing."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        self._process = None
        for pipe in (self._requests, self._answers):
            try:
                pipe.close()
            except BrokenPipeError:  # there was something left to say
                continue


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
