"""End conditions of a batch: `run.until` is evaluated for each run, and the batch ends with its last run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, seconds
from symaware_cli.engine import Simulation
from symaware_cli.geometry import Proximity
from symaware_cli.specification import Anchors, PlacedRegion
from symaware_cli.specification.expression import Expression, Lookup
from symaware_cli.studies.batch_observer import BatchObserver

Array = NDArray[np.float64]

#: The names that `run.until` may refer to in a batch, besides regions.
BATCH_NAMES = (
    "agents",
    "contacts",
    "goals_reached",
    "highest_risk",
    "min_separation",
    "position",
    "state",
    "time",
)


class BatchEnds(Expression):
    """`run.until` in each run of a batch; as the condition of the batch, it holds when all runs are over.

    Runs that are over are no longer observed, although their rows are still computed.
    """

    __slots__ = ("_ids_with_goal", "_least", "_leave", "_observer", "_regions", "_simulation")

    def __init__(
        self,
        until: Expression,
        simulation: Simulation,
        observer: BatchObserver,
        leave: Callable[[Sequence[int]], None],
    ) -> None:
        """Prepare.

        Args:
            until: The condition of one run.
            simulation: The batch.
            observer: Observes its runs.
            leave: Called with the runs that are over, to stop observing them.
        """
        super().__init__(until.text, until.names)
        self._simulation = simulation
        self._observer = observer
        self._leave = leave
        regions, anchors = simulation.groups[0].regions, Anchors(simulation.environment, simulation.groups)
        self._regions = {name: PlacedRegion(name, regions, anchors) for name in regions}
        self._ids_with_goal = sorted(
            id.partition(":")[2]
            for entry in simulation.entries
            if "goal-reached" in entry.components[0].events
            for id in entry.group.ids[: _share(entry.group)]
        )
        self._least: Array | None = None

    def holds(self, lookup: Lookup) -> bool:
        """Retire the runs that are over, and return whether all of them are.

        Raises:
            EvaluationError: The condition of a run has no value.
        """
        going, self._least = self._observer.going, None
        over = [run for run in np.flatnonzero(going).tolist() if super(BatchEnds, self).holds(partial(self._of, run))]
        if over:
            self._leave(over)
        return not going.any()

    def _of(self, run: int, name: str) -> Any:
        """Return the value of a name in one run, as `WorldScope` defines it."""
        simulation, observer = self._simulation, self._observer
        environment = simulation.environment
        match name:
            case "agents":
                return sum(map(_share, simulation.groups))
            case "contacts":
                return int(observer.contacts_of[run])
            case "goals_reached":
                reached = observer.goals_of(run)
                return np.array([id in reached for id in self._ids_with_goal], bool)
            case "highest_risk":
                return max(0.0, float(observer.risks_now[run]))
            case "min_separation":
                return self._separation(run)
            case "position":
                return _OfRun(simulation, run, lambda group: group.model.positions(environment.state(group)))
            case "state":
                return _OfRun(simulation, run, environment.state)
            case "time":
                return seconds(simulation.clock.now)
        return self._regions[name]

    def _separation(self, run: int) -> float:
        """Return the least distance between the centres of two agents of a run [m]; infinite for a single agent."""
        environment = self._simulation.environment
        positions, runs = environment.snapshot().positions, environment.roster.runs
        assert runs is not None
        if runs.shape[1] < 2:
            return np.inf
        if not environment.proximity.has_blocks:
            return Proximity().nearest(positions[runs[run]])
        if self._least is None:
            pairs = environment.proximity.pairs(positions, 0.0)
            self._least = pairs.distance.reshape(-1, pairs.runs).min(axis=0)
        return float(self._least[run])


class _OfRun:
    """A mapping from the ids of a run's agents to one value each, and from the names of its groups to arrays."""

    def __init__(self, simulation: Simulation, run: int, pick: Callable[[AgentGroup], Array]) -> None:
        self._simulation = simulation
        self._run = run
        self._pick = pick

    def __getitem__(self, name: str) -> Array:
        index = self._simulation.environment.roster.indices.get(f"{self._run}:{name}")
        for group in self._simulation.groups:
            share = _share(group)
            begin, start = self._run * share, self._simulation.environment.roster.start(group.name)
            if index is not None and begin <= index - start < begin + share:
                one: Array = self._pick(group)[index - start]
                return one
            if index is None and group.name == name:
                return self._pick(group)[begin : begin + share]
        raise KeyError(f"there is no agent or group `{name}`")


def _share(group: AgentGroup) -> int:
    """Return the number of agents per run in a group."""
    return len(group) // group.runs
