"""Observation of each run of a batch: contacts, distances, risks, goals and warnings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from symaware_cli.core import Event, Level, seconds
from symaware_cli.engine import Extreme, Observer, Simulation


class BatchObserver(Observer):
    """Observes each run of a batch.

    Attributes:
        contacts_of: The number of contacts that began in each run; shape (runs,).
        risks_now: The greatest current risk to any agent of each run; -infinity without risks; shape (runs,).
        going: Whether each run is still going; only such runs are observed. Shape (runs,).
    """

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation)
        runs = simulation.environment.roster.runs
        assert runs is not None
        self._runs = runs
        self._run_of = np.empty(runs.size, np.intp)
        self._run_of[runs] = np.arange(len(runs))[:, None]
        self.contacts_of = np.zeros(len(runs), np.intp)
        self._separations = np.full(len(runs), np.inf)
        self._pairs = np.zeros((len(runs), 2), np.intp)
        self._times = np.zeros(len(runs), np.int64)
        self._risks = np.full(len(runs), -np.inf)
        self._risk_times = np.zeros(len(runs), np.int64)
        self._risk_agents = np.zeros(len(runs), np.intp)
        self.risks_now = self._risks
        self.going = np.ones(len(runs), bool)
        self._goals_of: list[set[str]] = [set() for _ in runs]
        self._warnings_of: list[Counter[str]] = [Counter() for _ in runs]
        self._errors_of: list[Counter[str]] = [Counter() for _ in runs]

    def _on_event(self, event: Event) -> None:
        counts = {Level.WARNING: self._warnings_of, Level.ERROR: self._errors_of}.get(event.level)
        if counts is not None and event.source.startswith("agents."):
            run = _run(event.source.removeprefix("agents."))
            counts[run][event.name] += int(self.going[run])

    def _on_goal(self, event: Event) -> None:
        run, id = _agent(event)
        if self.going[run]:
            self._goals_of[run].add(id)

    def _on_goal_changed(self, event: Event) -> None:
        run, id = _agent(event)
        if self.going[run]:
            self._goals_of[run].discard(id)

    def sample(self, now: int) -> None:
        """Sample contacts, distances and risks."""
        begun = self._run_of.take(self._environment.contacts_begun())
        self.contacts_of += np.where(self.going, np.bincount(begun, minlength=len(self.contacts_of)), 0)
        if self._runs.shape[1] > 1:
            self._sample_distances(now)
        if all(group.awareness.risk.is_unwritten for group in self._simulation.groups):
            return
        peaks = np.full(self._runs.size, -np.inf)
        for group, start in zip(self._simulation.groups, self._environment.roster.starts, strict=True):
            peaks[start : start + len(group)] = group.awareness.risk.peaks()
        risks = peaks[self._runs]
        agents = risks.argmax(axis=1)
        best = risks[np.arange(len(risks)), agents]
        self.risks_now = best
        higher = (best > self._risks) & self.going
        self._risks[higher], self._risk_times[higher] = best[higher], now
        self._risk_agents[higher] = self._runs[np.arange(len(risks)), agents][higher]

    def _sample_distances(self, now: int) -> None:
        snapshot = self._environment.snapshot()
        headings = snapshot.headings if self._bodies.any_cornered else self._no_headings
        found = self._bodies.nearest_of_runs(
            snapshot.positions,
            headings,
            self._environment.proximity,
            self._run_of,
            np.where(self.going, self._separations, -np.inf),
        )
        runs, gaps, pairs = found
        self._separations[runs], self._pairs[runs], self._times[runs] = gaps, pairs, now

    def separation_of(self, run: int) -> Extreme | None:
        """Return the least distance between the outlines of two agents of a run [m]."""
        if not np.isfinite(self._separations[run]):
            return None
        pair = (self._id(self._pairs[run, 0]), self._id(self._pairs[run, 1]))
        return Extreme(float(self._separations[run]), seconds(int(self._times[run])), pair)

    def risk_of(self, run: int) -> Extreme | None:
        """Return the greatest risk to any agent during a run."""
        if self._risks[run] == -np.inf:
            return None
        agent = self._id(self._risk_agents[run])
        return Extreme(float(self._risks[run]), seconds(int(self._risk_times[run])), (agent,))

    def goals_of(self, run: int) -> tuple[str, ...]:
        """Return the agents of a run that have reached their current goal."""
        return tuple(sorted(self._goals_of[run]))

    def errors_of(self, run: int) -> Mapping[str, int]:
        """Return the number of errors from the agents of a run, by name."""
        return self._errors_of[run]

    def warnings_of(self, run: int) -> Mapping[str, int]:
        """Return the number of warnings from the agents of a run, by name."""
        return self._warnings_of[run]

    def _id(self, index: int) -> str:
        return self._environment.roster.ids[index].partition(":")[2]


def _agent(event: Event) -> tuple[int, str]:
    """Return the run and the id of the agent whose component fired an event."""
    run, _, path = event.source.removeprefix("agents.").partition(":")
    return int(run), path.rpartition(".")[0]


def _run(id: str) -> int:
    """Return the run that an agent belongs to."""
    return int(id.partition(":")[0])
