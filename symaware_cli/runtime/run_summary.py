"""What there is to say about a run when it is over."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.core import Contact, Environment, Event, Level, seconds
from symaware_cli.geometry.body_outlines import BodyOutlines
from symaware_cli.runtime.pacer import Pace
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.specification.outcome import Outcome

if TYPE_CHECKING:
    from symaware_cli.recording.recorder import Recorder
    from symaware_cli.runtime.failure import RunError


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
class RunSummary:
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
        minimum_separation: The least distance between the outlines of two agents at any step, negative where they
            overlapped [m].
        highest_risk: The greatest risk that an agent saw.
        goals_reached: The agents that reached the goal that they have at the end, sorted.
        log: The log's path, if there is one.
        log_size: Its size in bytes.
        failure: Why the run failed, if it did.
        traceback: Where, if an exception was the cause.
        turns: How many turns the components took, all in all.
        overruns: How many turns were due while the one before still computed.
        failures: How many times a component failed without ending the run.
        warnings: How many events of the level `Level.WARNING` agents and their components fired, by name; sorted.
        pace: How well the pace was kept, if one was asked for.
        began: The simulated time at which this process began to take part [s].
        specifications: What has become of the specifications, in the scenario's order.
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
    traceback: str | None = None
    turns: int = 0
    overruns: int = 0
    failures: int = 0
    warnings: Mapping[str, int] = field(default_factory=dict)
    pace: Pace | None = None
    began: float = 0.0
    specifications: tuple[Outcome, ...] = ()

    @property
    def violated(self) -> tuple[str, ...]:
        """The names of the specifications that are violated."""
        return tuple(each.name for each in self.specifications if each.verdict == "violated")

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
        goals: The agents that reached the goal that they have.
        warnings: How many warnings of each name came from agents and their components.
        reported: The greatest risk that each other process reported last, and who sees it.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._environment: Environment = simulation.environment
        self.contacts = 0
        self.goals: set[str] = set()
        self.warnings: Counter[str] = Counter()
        self.reported: dict[object, tuple[float, str]] = {}
        groups = self._environment.groups
        shapes = [group.entity.shape for group in groups]
        self._bodies = BodyOutlines(
            [shape.pieces[0] if shape else None for shape in shapes], [len(group) for group in groups]
        )
        self._no_headings = np.zeros(len(self._bodies))
        self._separation = math.inf
        self._separation_time = 0
        self._separation_pair: tuple[int, ...] = (0, 0)
        self._risk: Extreme | None = None
        simulation.events.subscribe("contact", self._on_contact)
        simulation.events.subscribe("goal-reached", self._on_goal)
        simulation.events.subscribe("goal-changed", self._on_other_goal)
        simulation.events.subscribe("*", self._on_event)

    def _on_contact(self, event: Event) -> None:
        if isinstance(event.subject, Contact) and event.subject.begins:
            self.contacts += 1

    def _on_goal(self, event: Event) -> None:
        self.goals.add(_agent(event))

    def _on_other_goal(self, event: Event) -> None:
        self.goals.discard(_agent(event))

    def _on_event(self, event: Event) -> None:
        if event.level is Level.WARNING and event.source.startswith("agents."):
            self.warnings[event.name] += 1

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
        snapshot = self._environment.snapshot()
        # Headings are looked up only where they count.
        headings = snapshot.headings if self._bodies.any_cornered else self._no_headings
        found = self._bodies.nearest(snapshot.positions, headings, self._environment.proximity, self._separation)
        if found is not None:
            self._separation, *pair = found
            self._separation_time, self._separation_pair = now, tuple(pair)

    @property
    def minimum_separation(self) -> Extreme | None:
        """The least distance between the outlines of two agents so far [m]."""
        if not np.isfinite(self._separation):
            return None
        ids = self._environment.roster.ids
        first, second = self._separation_pair
        return Extreme(self._separation, seconds(self._separation_time), (ids[first], ids[second]))

    @property
    def highest_risk(self) -> Extreme | None:
        """The greatest risk so far."""
        return self._risk


def _agent(event: Event) -> str:
    """The id of the agent whose component fired an event."""
    return event.source.removeprefix("agents.").rpartition(".")[0]


def summarise(
    simulation: Simulation,
    observer: Observer,
    recorder: Recorder | None,
    *,
    status: str,
    agents: int,
    turns: int,
    overruns: int,
    failures: int,
    steps: int,
    began: int,
    wall_time: float,
    pace: Pace | None = None,
    failure: RunError | None = None,
    specifications: tuple[Outcome, ...] = (),
) -> RunSummary:
    """The figures of a run.

    Args:
        simulation: What ran.
        observer: Who watched it.
        recorder: Who wrote it down, if somebody did.
        status: See `RunSummary`.
        agents: How many were ever in the world.
        turns: See there, as for the next two.
        overruns: See there.
        failures: See there.
        steps: How many were made.
        began: The first instant, in nanoseconds.
        wall_time: How long it took [s].
        pace: See `RunSummary`.
        failure: Why it failed, if it did.
        specifications: See `Summary`.
    """
    return RunSummary(
        name=simulation.name,
        seed=simulation.seed,
        status=status,
        agents=agents,
        steps=steps,
        simulated_time=seconds(simulation.clock.now),
        wall_time=wall_time,
        updates=recorder.updates if recorder else 0,
        contacts=observer.contacts,
        minimum_separation=observer.minimum_separation,
        highest_risk=observer.highest_risk,
        goals_reached=tuple(sorted(observer.goals)),
        log=str(recorder.writer.path) if recorder else None,
        log_size=recorder.writer.size if recorder else None,
        failure=str(failure) if failure else None,
        traceback=failure.trace or None if failure else None,
        turns=turns,
        overruns=overruns,
        failures=failures,
        warnings=dict(sorted(observer.warnings.items())),
        pace=pace,
        began=seconds(began),
        specifications=specifications,
    )
