"""The summary of a run: status, durations, contacts, separation, risk, goals, warnings, specifications."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, field
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.core import Contact, Environment, Event, Level, seconds
from symaware_cli.engine.runtime.pacer import Pace
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.geometry import BodyOutlines
from symaware_cli.world import record

if TYPE_CHECKING:
    from symaware_cli.specification import Outcome


@record
class Extreme:
    """The greatest or least value of a quantity in a run.

    Attributes:
        value: The value.
        time: The simulated time at which it occurred [s].
        who: The ids of the agents concerned.
    """

    value: float
    time: float
    who: tuple[str, ...]


@record
class RunSummary:
    """The figures of a run.

    Attributes:
        name: The scenario's name.
        seed: The seed in force.
        status: ``finished``, ``failed`` or ``interrupted``.
        agents: The number of agents that took part.
        steps: The number of steps made.
        simulated_time: Simulated time that passed [s].
        wall_time: Wall time that passed [s].
        updates: Rows of awareness, control and knowledge that were recorded.
        contacts: The number of contacts that began.
        minimum_separation: The least distance between the outlines of two agents at any step, negative if they
            overlapped [m].
        highest_risk: The greatest risk that an agent estimated.
        goals_reached: The ids of the agents that reached their final goals, sorted.
        log: The log's path, if there is one.
        log_size: The log's size in bytes.
        failure: Why the run failed, if it did.
        traceback: The traceback, if an exception was the cause.
        turns: The total number of turns of all components.
        overruns: The number of turns that were due while the previous one still computed.
        failures: The number of failures of components that did not end the run.
        warnings: The number of events of the level `Level.WARNING` from agents and their components, by name; sorted.
        errors: The number of events of the level `Level.ERROR` from agents and their components, likewise: the run went
            on, but something does not hold that they are to ensure.
        pace: How well the pace was kept, if one was requested.
        began: The simulated time at which this process joined the run [s].
        specifications: The outcomes of the specifications, in the scenario's order.
        on_contact: What contacts do to bodies, as in `Environment.on_contact`.
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
    errors: Mapping[str, int] = field(default_factory=dict)
    pace: Pace | None = None
    began: float = 0.0
    specifications: tuple[Outcome, ...] = ()
    on_contact: str | None = None

    @property
    def violated(self) -> tuple[str, ...]:
        """The names of the specifications that are violated."""
        return tuple(each.name for each in self.specifications if each.verdict == "violated")

    @property
    def falls_short(self) -> bool:
        """Whether a specification is violated, or an agent reported an error."""
        return bool(self.violated or self.errors)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second of wall time."""
        return (self.simulated_time - self.began) / self.wall_time if self.wall_time > 0 else math.inf

    def to_json(self) -> dict[str, Any]:
        """Return the figures as plain data."""
        return {**asdict(self), "real_time_factor": self.real_time_factor}


class Observer:
    """Collects the figures of the summary during a run.

    Attributes:
        contacts: The number of contacts that began.
        goals: The ids of the agents that have reached their present goals.
        left: The ids of the agents that have left the world.
        warnings: The number of warnings from agents and their components, by name.
        errors: The number of errors from them that did not end the run, by name.
        reported: The greatest risk that each other process reported last, with the id of the agent that estimates it.
    """

    def __init__(self, simulation: Simulation, *, is_member: bool = False) -> None:
        """Subscribe to the events that are counted.

        Args:
            simulation: The simulation.
            is_member: Whether another process steps the world; then that one measures distances.
        """
        self._simulation = simulation
        self._measures = simulation.agent_count > 1 and not is_member
        self._environment: Environment = simulation.environment
        self.contacts = 0
        self.goals: set[str] = set()
        #: Agents without a path to their goal: where they wait is no goal, even if what steers them takes it for one.
        self._without_path: set[str] = set()
        self.left: set[str] = set()
        self.warnings: Counter[str] = Counter()
        self.errors: Counter[str] = Counter()
        self.reported: dict[object, tuple[float, str]] = {}
        groups = self._environment.groups
        shapes = [group.entity.shape for group in groups]
        self._bodies = BodyOutlines(
            [shape.pieces[0] if shape else None for shape in shapes], [len(group) for group in groups]
        )
        self._no_headings = np.zeros(len(self._bodies))
        #: The ids of each group, and the risks of its agents.
        self._risk_columns = [(group.ids, group.awareness.risk) for group in simulation.groups]
        self._separation = math.inf
        self._separation_time = 0
        self._separation_pair: tuple[int, ...] = (0, 0)
        self._risk: Extreme | None = None
        simulation.events.subscribe("contact", self._on_contact)
        simulation.events.subscribe("goal-reached", self._on_goal)
        simulation.events.subscribe("goal-changed", self._on_goal_changed)
        simulation.events.subscribe("goal-unreachable", self._on_goal_unreachable)
        simulation.events.subscribe("path-planned", self._on_path)
        simulation.events.subscribe("removed", self._on_removed)
        simulation.events.subscribe("*", self._on_event)

    def _on_contact(self, event: Event) -> None:
        if isinstance(event.subject, Contact) and event.subject.begins:
            self.contacts += 1

    def _on_goal(self, event: Event) -> None:
        if (id := _agent(event)) not in self._without_path:
            self.goals.add(id)

    def _on_goal_unreachable(self, event: Event) -> None:
        self._without_path.add(_agent(event))
        self.goals.discard(_agent(event))

    def _on_path(self, event: Event) -> None:
        self._without_path.discard(_agent(event))

    def _on_goal_changed(self, event: Event) -> None:
        self.goals.discard(_agent(event))

    def _on_removed(self, event: Event) -> None:
        self.left.add(event.source.removeprefix("agents."))

    def _on_event(self, event: Event) -> None:
        if event.source.startswith("agents."):
            if event.level is Level.WARNING:
                self.warnings[event.name] += 1
            elif event.level is Level.ERROR and event.name != "failed":
                self.errors[event.name] += 1

    def sample(self, now: int) -> None:
        """Sample the distances and risks of the present instant."""
        if self._measures:
            self._sample_distances(now)
        peak = self.peak()
        if peak is not None and (self._risk is None or peak[0] > self._risk.value):
            self._risk = Extreme(peak[0], seconds(now), (peak[1],))

    def peak(self) -> tuple[float, str] | None:
        """The greatest risk that an agent estimates now, and the first such agent in the roster; None without risks."""
        peaks = []
        for ids, risks in self._risk_columns:
            peak = None if risks.is_unwritten else risks.maximum()
            if peak is not None:
                peaks.append((peak[0], ids[peak[1]]))
        if not self.reported:
            return max(peaks, key=lambda each: each[0]) if peaks else None
        index = self._environment.roster.index
        return max((*peaks, *self.reported.values()), key=lambda each: (each[0], -index(each[1])), default=None)

    def _sample_distances(self, now: int) -> None:
        snapshot = self._environment.snapshot()
        # Headings are looked up only if a body has corners.
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
