"""Measurements during runs beyond their summaries: a hash of the states, path lengths, effort, times of goals.

Values are accumulated per agent and combined per run at the end, so that a run of a batch has bitwise the same values
as the run executed alone.
"""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Event, seconds
from symaware_cli.engine import Simulation
from symaware_cli.geometry import lengths

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Numbers = NDArray[np.uint64]

#: The maximum number of goals recorded in a run, the earliest ones; most runs have one per agent.
MOST_GOALS = 256

#: The numbers of steps processed and of rows hashed at a time, chosen to fit in the cache.
_STEPS, _ROWS = 32, 8192

#: Odd factors of the hash, from the digits of pi, e and the golden ratio.
_FIRST, _SECOND, _NEXT = np.uint64(0x243F6A8885A308D3), np.uint64(0xB7E151628AED2A6B), np.uint64(0x9E3779B97F4A7C15)
_HALF = np.uint64(32)


class GoalReached(NamedTuple):
    """A goal that an agent reached: the id of the agent, and the simulated time [s]."""

    agent: str
    time: float


@dataclass(frozen=True, slots=True)
class RunMeasurement:
    """The measurements of one run.

    Attributes:
        digest: A hash of the states and control inputs of all agents at every step, in hexadecimal.
        path_length: The total path length of all agents [m].
        effort: The integral of the squared control inputs over time, summed over agents.
        goals: The agent and time [s] of each goal that was reached, in order of time; at most the first `MOST_GOALS`.
        goal_time: The time at which the last goal was reached [s]; None if none was.
    """

    digest: str
    path_length: float
    effort: float
    goals: tuple[GoalReached, ...]
    goal_time: float | None


class Measurement:
    """Measures a run, or the runs of a batch, step by step."""

    def __init__(self, simulation: Simulation) -> None:
        """Attach to a run that has not begun.

        Args:
            simulation: The simulation.
        """
        self._simulation = simulation
        self._runs = max((group.runs for group in simulation.groups), default=1)
        self._is_batch = any(group.seeds for group in simulation.groups)
        self._step = seconds(simulation.environment.time_step)
        self._groups = [_GroupMeasurement(group) for group in simulation.groups]
        self._goals: list[list[GoalReached]] = [[] for _ in range(self._runs)]
        self._ended: dict[int, RunMeasurement] = {}
        self._goal_times: list[float | None] = [None] * self._runs
        simulation.events.subscribe("stepping", self._on_step)
        simulation.events.subscribe("goal-reached", self._on_goal)

    def finish(self) -> list[RunMeasurement]:
        """Add the last state, and return the measurements of each run."""
        self.leave([run for run in range(self._runs) if run not in self._ended])
        return [self._ended[run] for run in range(self._runs)]

    def leave(self, runs: Sequence[int]) -> None:
        """Finish the measurements of runs that are over, adding their last state; later steps are ignored."""
        chosen, parts = np.array(runs, np.intp), []
        for each in self._groups:
            share = len(each.group) // self._runs
            rows = (chosen[:, None] * share + np.arange(share)).ravel()
            parts.append((share, each.part(rows, self._simulation.environment.state(each.group))))
        for place, run in enumerate(runs):
            own = [(part, slice(place * share, (place + 1) * share)) for share, part in parts]
            self._ended[run] = self._measured(run, own)

    def _on_step(self, event: Event) -> None:
        environment = self._simulation.environment
        for each in self._groups:
            each.add(environment.state(each.group), each.group.control_input)

    def _on_goal(self, event: Event) -> None:
        agent = event.source.removeprefix("agents.").rpartition(".")[0]
        run = 0
        if self._is_batch:
            number, _, agent = agent.partition(":")
            run = int(number)
        if run in self._ended:
            return
        reached = GoalReached(agent, seconds(event.time))
        self._goal_times[run] = reached.time
        if len(self._goals[run]) < MOST_GOALS:
            self._goals[run].append(reached)

    def _measured(self, run: int, parts: Sequence[tuple[_GroupMeasurement, slice]]) -> RunMeasurement:
        """Combine the measurements of the agents of a run."""
        digest, path_length, effort = hashlib.blake2b(digest_size=16), 0.0, 0.0
        for each, own in parts:
            digest.update(each.hashes[own].tobytes())
            path_length += float(np.sum(each.path_lengths[own]))
            effort += float(np.sum(each.efforts[own]))
        goals = tuple(self._goals[run])
        return RunMeasurement(digest.hexdigest(), path_length, effort * self._step, goals, self._goal_times[run])


class _GroupMeasurement:
    """The measurements of the agents of a group.

    Attributes:
        group: The group.
        hashes: A hash of the states and control inputs of each agent; shape (n,).
        path_lengths: The path length of each agent [m]; shape (n,).
        efforts: The sum of the squared control inputs of each agent over all steps; shape (n,).
    """

    def __init__(self, group: AgentGroup) -> None:
        self.group = group
        self.hashes: Numbers = np.full(len(group), _FIRST)
        self.path_lengths: Array = np.zeros(len(group))
        self.efforts: Array = np.zeros(len(group))
        self._states: list[Array] = []
        self._inputs: list[Array] = []
        self._position: Array | None = None

    def add(self, states: Array, control_inputs: Array) -> None:
        """Add a step."""
        self._states.append(states)
        self._inputs.append(control_inputs.copy())
        if len(self._states) == _STEPS:
            self.work_through()

    def part(self, rows: Indices, states: Array) -> _GroupMeasurement:
        """Return the measurements of some agents, with the last states of all agents added."""
        part = copy.copy(self)
        part.hashes = self.hashes[rows]
        part.path_lengths, part.efforts = self.path_lengths[rows], self.efforts[rows]
        part._states = [each[rows] for each in (*self._states, states)]
        part._inputs = [each[rows] for each in self._inputs]
        part._position = None if self._position is None else self._position[rows]
        part.work_through()
        return part

    def work_through(self) -> None:
        """Process the buffered steps."""
        for states in self._states:
            position = self.group.model.positions(states)
            if self._position is not None:
                # Axis by axis, because NumPy is many times slower at subtracting rows of two elements.
                apart = np.empty((position.shape[1], len(position)))
                for axis, moved in enumerate(apart):
                    np.subtract(position[:, axis], self._position[:, axis], out=moved)
                self.path_lengths += lengths(apart.T)
            self._position = position
        for inputs in self._inputs:
            for column in range(inputs.shape[1]):
                self.efforts += inputs[:, column] * inputs[:, column]
        for values in (self._states, self._inputs):
            share = max(1, _ROWS // max(1, len(self.group)))
            for begin in range(0, len(values), share):
                for hashed in _hashed(values[begin : begin + share]):
                    self.hashes *= _NEXT
                    self.hashes ^= hashed
        self._states.clear()
        self._inputs.clear()


def _hashed(values: list[Array]) -> Numbers:
    """Hash each row of m arrays of shape (n, k) separately; shape (m, n)."""
    bits: Numbers = np.stack(values).view(np.uint64)
    factors = _FIRST + _NEXT * np.arange(0, 2 * bits.shape[2], 2, dtype=np.uint64)
    factors |= np.uint64(1)
    hashed: Numbers = np.zeros(bits.shape[:2], np.uint64)
    for column, factor in enumerate(factors):
        mixed = bits[..., column] * factor
        mixed ^= mixed >> _HALF
        mixed *= _SECOND
        mixed ^= mixed >> _HALF
        hashed += mixed
    return hashed
