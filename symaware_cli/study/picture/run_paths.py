"""The paths of the agents in runs that are made again: nothing of them need be kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Event
from symaware_cli.runtime.simulation import Simulation

Array = NDArray[np.float64]

#: A path has this many points at least, if the run has as many steps, and less than twice as many.
_POINTS = 80


class RunPaths:
    """Follows runs that are made, alone or in batches, and keeps a bounded number of positions of each agent.

    Attributes:
        goals_differ: Whether the knowledge of the agents differs from run to run, and with it perhaps their goals.
    """

    def __init__(self) -> None:
        self.goals_differ = False
        self._known: list[str] | None = None
        self._of: dict[int, tuple[_Followed, int]] = {}

    def follow(self, indices: Sequence[int], simulation: Simulation) -> None:
        """Follow runs that are about to begin.

        Args:
            indices: Their numbers, in the order of their rows.
            simulation: What runs.
        """
        followed = _Followed(simulation, len(indices))
        for place, index in enumerate(indices):
            self._of[index] = (followed, place)
            known = [
                repr(each) for group in simulation.groups for each in group.knowledge[_rows(group, len(indices), place)]
            ]
            self._known = self._known or known
            self.goals_differ = self.goals_differ or known != self._known

    def take(self, index: int) -> Array:
        """Return the positions (k, n, 2) of the agents of a run that ended [m]; NaN where one is absent."""
        followed, place = self._of.pop(index)
        return followed.positions(place)


class _Followed:
    """The runs of a simulation."""

    def __init__(self, simulation: Simulation, runs: int) -> None:
        self._simulation = simulation
        self._runs = runs
        self._stride = 1
        self._step = 0
        self._sampled: list[list[Array]] = []
        self._last: list[Array] = []
        simulation.events.subscribe("stepping", self._on_stepping)
        simulation.events.subscribe("stepped", self._on_stepped)

    def positions(self, place: int) -> Array:
        """Return the positions (k, n, 2) of the agents of one of the runs [m]."""
        instants = [*self._sampled, *([self._last] if self._last else [])]
        groups = self._simulation.groups
        parts = [
            np.stack([instant[number][_rows(group, self._runs, place)] for instant in instants])
            for number, group in enumerate(groups)
        ]
        found: Array = np.concatenate(parts, axis=1)
        return found

    def _on_stepping(self, event: Event) -> None:
        if self._step % self._stride == 0:
            self._sampled.append([self._positions(group) for group in self._simulation.groups])
            if len(self._sampled) == 2 * _POINTS:
                self._sampled = self._sampled[::2]
                self._stride *= 2
        self._step += 1

    def _on_stepped(self, event: Event) -> None:
        self._last = [self._positions(group) for group in self._simulation.groups]

    def _positions(self, group: AgentGroup) -> Array:
        positions = group.model.positions(self._simulation.environment.state(group))[:, :2].copy()
        if group.present is not None:
            positions[~group.present] = np.nan
        return positions


def _rows(group: AgentGroup, runs: int, place: int) -> slice:
    """The rows of a group that belong to one of the runs that share it."""
    share = len(group) // runs
    return slice(place * share, (place + 1) * share)
