"""What there is to say about a run when it is over."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.core import Contact, Environment, Event, seconds
from symaware_cli.runtime.pacer import Pace
from symaware_cli.runtime.simulation import Simulation

if TYPE_CHECKING:
    from symaware_cli.runtime.failure import RunError
    from symaware_cli.runtime.run import Run


@dataclass(frozen=True, slots=True)
class Extreme:
    """A greatest or least value: how much, when and whose.

    Attributes:
        value: The value.
        time: Simulated time [s].
        who: The agents concerned.
    """

    value: float
    time: float
    who: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Summary:
    """The figures of a run.

    Attributes:
        name: The scenario's name.
        seed: The seed in force.
        status: ``finished``, ``failed`` or ``interrupted``.
        agents: How many agents took part.
        steps: How many steps were made.
        simulated_time: Simulated time that passed [s].
        wall_time: Wall time that passed [s].
        updates: Rows of awareness, control and knowledge that were recorded.
        contacts: How many contacts began.
        minimum_separation: The least distance between the centres of two agents [m].
        highest_risk: The greatest risk that an agent saw.
        goals_reached: The agents that reached their goal, sorted.
        log: The log's path, if there is one.
        log_size: Its size in bytes.
        failure: Why the run failed, if it did.
        turns: How many turns the components took, all in all.
        overruns: How many turns were due while the one before still computed.
        failures: How many times a component failed without ending the run.
        pace: How well the pace was kept, if one was asked for.
        began: The simulated time at which this process began to take part [s].
    """

    name: str
    seed: int
    status: str
    agents: int
    steps: int
    simulated_time: float
    wall_time: float
    updates: int
    contacts: int
    minimum_separation: Extreme | None
    highest_risk: Extreme | None
    goals_reached: tuple[str, ...]
    log: str | None = None
    log_size: int | None = None
    failure: str | None = None
    turns: int = 0
    overruns: int = 0
    failures: int = 0
    pace: Pace | None = None
    began: float = 0.0

    @property
    def real_time_factor(self) -> float:
        """Simulated time for each second of wall time."""
        return (self.simulated_time - self.began) / self.wall_time if self.wall_time > 0 else math.inf

    def to_json(self) -> dict[str, Any]:
        """Return the figures as plain data."""
        return {**asdict(self), "real_time_factor": self.real_time_factor}


class Observer:
    """Watches a run for what the summary tells.

    Attributes:
        contacts: How many contacts began.
        goals: The agents that reached their goal.
        reported: The greatest risk that each other process reported last, and who sees it.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._environment: Environment = simulation.environment
        self.contacts = 0
        self.goals: set[str] = set()
        self.reported: dict[object, tuple[float, str]] = {}
        self._separation = math.inf
        self._separation_time = 0
        self._separation_pair = (0, 0)
        self._risk: Extreme | None = None
        simulation.events.subscribe("contact", self._on_contact)
        simulation.events.subscribe("goal-reached", self._on_goal)

    def _on_contact(self, event: Event) -> None:
        if isinstance(event.subject, Contact) and event.subject.begins:
            self.contacts += 1

    def _on_goal(self, event: Event) -> None:
        self.goals.add(event.source.removeprefix("agents.").rpartition(".")[0])

    def look(self, now: int) -> None:
        """Take note of what the world and the agents are like now."""
        if self._simulation.agent_count > 1:
            self._look_at_distances(now)
        peak = self.peak()
        if peak is not None and (self._risk is None or peak[0] > self._risk.value):
            self._risk = Extreme(peak[0], seconds(now), (peak[1],))

    def peak(self) -> tuple[float, str] | None:
        """The greatest risk that an agent sees now, and the first in the roster that does; None if nobody sees any."""
        peaks = [
            (peak[0], group.ids[peak[1]])
            for group in self._simulation.groups
            if (peak := group.awareness.risk.maximum()) is not None
        ]
        if not self.reported:
            return max(peaks, key=lambda each: each[0], default=None)
        index = self._environment.roster.index
        return max((*peaks, *self.reported.values()), key=lambda each: (each[0], -index(each[1])), default=None)

    def _look_at_distances(self, now: int) -> None:
        positions = self._environment.snapshot().positions
        proximity = self._environment.proximity
        if math.isinf(self._separation):
            # A little more, so that the nearest pair counts, be it at distance 0.
            self._separation = float(np.nextafter(proximity.nearest(positions) * (1 + 1e-12), np.inf))
        pairs = proximity.pairs(positions, self._separation)
        if pairs.least < self._separation:
            self._separation = pairs.least
            self._separation_time = now
            self._separation_pair = (int(pairs.first[pairs.closest]), int(pairs.second[pairs.closest]))

    @property
    def minimum_separation(self) -> Extreme | None:
        """The least distance between the centres of two agents so far [m]."""
        if not np.isfinite(self._separation):
            return None
        ids = self._environment.roster.ids
        first, second = self._separation_pair
        return Extreme(self._separation, seconds(self._separation_time), (ids[first], ids[second]))

    @property
    def highest_risk(self) -> Extreme | None:
        """The greatest risk so far."""
        return self._risk


def summarise(run: Run, status: str, failure: RunError | None, wall_time: float) -> Summary:
    """The figures of a run that is over.

    Args:
        run: The run.
        status: See `Summary`.
        failure: Why it failed, if it did.
        wall_time: How long it took [s].
    """
    simulation, recorder, observer = run.simulation, run.recorder, run.observer
    return Summary(
        name=simulation.name,
        seed=simulation.seed,
        status=status,
        agents=simulation.agent_count,
        steps=run.done,
        simulated_time=simulation.clock.now / 1e9,
        wall_time=wall_time,
        updates=recorder.updates if recorder else 0,
        contacts=observer.contacts,
        minimum_separation=observer.minimum_separation,
        highest_risk=observer.highest_risk,
        goals_reached=tuple(sorted(observer.goals)),
        log=str(recorder.writer.path) if recorder else None,
        log_size=recorder.writer.size if recorder else None,
        failure=str(failure) if failure else None,
        turns=sum(each.turns for each in run.activities),
        overruns=sum(each.overruns for each in run.activities),
        failures=sum(each.failures for each in run.activities),
        pace=run.pacer.kept if run.pacer else None,
        began=run.began / 1e9,
    )
