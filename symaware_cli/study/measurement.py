"""What is measured during a run beside its summary: a hash of its states, path lengths, effort, times of goals."""

from __future__ import annotations

import hashlib

import numpy as np

from symaware_cli.core import Event, seconds
from symaware_cli.geometry.vectors import lengths
from symaware_cli.runtime.simulation import Simulation


class Measurement:
    """Follows a run step by step.

    Attributes:
        path_length: The way that all agents went together [m].
        effort: The integral of the squared control inputs over time, summed over agents.
        goal_time: When the last goal was reached [s]; None if none was.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Follow a run that has not begun.

        Args:
            simulation: What runs.
        """
        self._simulation = simulation
        self._environment = simulation.environment
        self._step = seconds(simulation.environment.time_step)
        self._hash = hashlib.blake2b(digest_size=16)
        self._positions = [group.model.positions(self._environment.state(group)) for group in simulation.groups]
        self.path_length = 0.0
        self.effort = 0.0
        self.goal_time: float | None = None
        simulation.events.subscribe("stepping", self._on_step)
        simulation.events.subscribe("goal-reached", self._on_goal)

    def finish(self) -> str:
        """Take note of the last state, and return the hash of all of them in hexadecimal."""
        self._look()
        return self._hash.hexdigest()

    def _on_step(self, event: Event) -> None:
        self._look()
        for group in self._simulation.groups:
            values = group.control_input
            self._hash.update(values.tobytes())
            self.effort += float(np.sum(values * values)) * self._step

    def _on_goal(self, event: Event) -> None:
        self.goal_time = seconds(event.time)

    def _look(self) -> None:
        for number, group in enumerate(self._simulation.groups):
            state = self._environment.state(group)
            self._hash.update(state.tobytes())
            positions = group.model.positions(state)
            self.path_length += float(np.sum(lengths(positions - self._positions[number])))
            self._positions[number] = positions
