"""Faults that a scenario asks for: what they do, from when on, and for how long."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup
from symaware_cli.network.disturbance import Disturbance
from symaware_cli.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.runtime.timing import Duration, Trigger
from symaware_cli.runtime.turn import Turns
from symaware_cli.world.chance import GroupChance, agent_numbers

if TYPE_CHECKING:
    # Whoever validates a scenario need not import what runs it.
    from symaware_cli.runtime.environment_stepper import EnvironmentStepper
    from symaware_cli.runtime.membership import Membership
    from symaware_cli.runtime.scheduler import TurnScheduler

Array = NDArray[np.float64]


class AgentSelection(NamedTuple):
    """Some agents of one group.

    Attributes:
        group: The group.
        rows: Which of it, ascending.
    """

    group: AgentGroup
    rows: Sequence[int]


class ComponentSelection(NamedTuple):
    """A component of some agents.

    Attributes:
        entry: The component.
        rows: Of which agents, ascending.
    """

    entry: ComponentEntry
    rows: Sequence[int]


@dataclass(frozen=True)
class Targets:
    """What faults may interfere with.

    Attributes:
        simulation: What runs.
        schedulers: The turns of each entry, in their order.
        membership: Which agents take part.
        motion: What the world does.
        ends: Ends another fault, by its name.
    """

    simulation: Simulation
    schedulers: Sequence[TurnScheduler]
    membership: Membership
    motion: EnvironmentStepper
    ends: Callable[[str], object]

    def scheduler(self, components: ComponentSelection) -> TurnScheduler:
        """The turns of a component."""
        return self.schedulers[self.simulation.entries.index(components.entry)]


class Effect(ABC):
    """What a fault does."""

    @abstractmethod
    def begin(self, targets: Targets, name: str) -> Any:
        """Do it.

        Args:
            targets: What it happens to.
            name: What the fault is called; keys what it draws.

        Returns:
            What `end` needs to know.
        """

    def end(self, targets: Targets, begun: Any) -> None:
        """Undo it, if it can be undone; `begun` is what `begin` returned."""
        return


@dataclass(frozen=True)
class Stop(Effect):
    """Agents take no part; when it is over they begin anew."""

    agents: Sequence[AgentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Take them out of the run."""
        for group, rows in self.agents:
            targets.membership.retire(group, rows, "safe", f"stopped by the fault `{name}`")

    def end(self, targets: Targets, begun: Any) -> None:
        """Let those begin anew whom nothing else keeps out of it."""
        for group, rows in self.agents:
            targets.membership.revive(group, rows)


@dataclass(frozen=True)
class Restart(Effect):
    """Components give up what they are doing and begin anew."""

    components: Sequence[ComponentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Initialise them again."""
        for each in self.components:
            targets.scheduler(each).begin_anew(each.rows)


@dataclass(frozen=True)
class Freeze(Effect):
    """Components take no turns; what they wrote stays."""

    components: Sequence[ComponentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Hold them."""
        for each in self.components:
            for row in each.rows:
                targets.scheduler(each).hold(row)

    def end(self, targets: Targets, begun: Any) -> None:
        """Let them go."""
        for each in self.components:
            for row in each.rows:
                targets.scheduler(each).release(row)


@dataclass(frozen=True)
class Slow(Effect):
    """Computations take another time; where several faults say so, the longest."""

    components: Sequence[ComponentSelection]
    latency: Duration

    def begin(self, targets: Targets, name: str) -> Any:
        """Add a latency."""
        for each in self.components:
            targets.scheduler(each).supervision.slow_down(each.rows, self.latency)

    def end(self, targets: Targets, begun: Any) -> None:
        """Let the latency be that of the scenario again, or of other faults."""
        for each in self.components:
            targets.scheduler(each).supervision.speed_up(each.rows, self.latency)


@dataclass(frozen=True)
class Blind(Effect):
    """Sensors see nobody; one's own state is still felt."""

    components: Sequence[ComponentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Take away what they see from now on, and what they saw."""
        begun = []
        for each in self.components:
            disturbance = partial(_blindfold, frozenset(each.rows))
            scheduler = targets.scheduler(each)
            scheduler.supervision.disturb(disturbance)
            disturbance(scheduler.entry.group, ())
            begun.append((scheduler, disturbance))
        return begun

    def end(self, targets: Targets, begun: Any) -> None:
        """Let them see again, with their next turns."""
        for scheduler, disturbance in begun:
            scheduler.supervision.undisturb(disturbance)


def _blindfold(rows: frozenset[int], group: AgentGroup, measured: Sequence[int]) -> None:
    """Take away what some agents believe of others."""
    awareness = group.awareness
    for row in sorted(rows):
        database = group.agents[row].awareness_database
        for id in list(database.others):
            del database[id]
        if database.world is not awareness.world:
            database.world = None
    if awareness.world is not None and awareness.seen is None:
        # One snapshot is shared by all; without some of them, everybody's picture has to be written out.
        awareness.seen = awareness.everybody(awareness.world)
        awareness.world = None
    if awareness.seen is not None:
        awareness.seen = awareness.seen.select(~np.isin(awareness.seen.observers, sorted(rows)))
    observation = awareness.observation
    if observation is not None:
        seen = observation.tracks.select(~np.isin(observation.tracks.observers, sorted(rows)))
        awareness.observation = replace(observation, tracks=seen)


@dataclass(frozen=True)
class MeasurementError(Effect):
    """Sensors measure one's own state with an error: an offset, or noise that is drawn at each turn, or both."""

    components: Sequence[ComponentSelection]
    bias: Array
    deviation: Array

    def begin(self, targets: Targets, name: str) -> Any:
        """Add the error to what they measure from now on."""
        begun = []
        for each in self.components:
            scheduler = targets.scheduler(each)
            noise = _Noise(self.deviation, scheduler.entry, targets.simulation.seed, name)
            disturbance = partial(_mismeasure, self, each.rows, noise)
            scheduler.supervision.disturb(disturbance)
            begun.append((scheduler, disturbance))
        return begun

    def end(self, targets: Targets, begun: Any) -> None:
        """Let them measure as before."""
        for scheduler, disturbance in begun:
            scheduler.supervision.undisturb(disturbance)


class _Noise:
    """The noise of one fault in what one component measures: keyed by both, the agent and the turn."""

    def __init__(self, deviation: Array, entry: ComponentEntry, seed: int, fault: str) -> None:
        self._deviation = deviation
        self._seed = seed
        self._purpose = f"component {entry.name} fault {fault}"
        self._numbers = agent_numbers(entry.group.ids)
        self._turns = Turns()

    def draw(self, rows: Sequence[int], now: int) -> Array:
        """The noise of some agents in the turn that ends now [ns]; shape (k, nx)."""
        noise = np.zeros((len(rows), len(self._deviation)))
        if not self._deviation.any():
            return noise
        turns = [self._turns.begin(row, now) for row in rows]
        for turn in set(turns):
            some = [place for place, each in enumerate(turns) if each == turn]
            numbers = self._numbers[[rows[place] for place in some]]
            chance = GroupChance(self._seed, self._purpose, numbers).at(turn)
            noise[some] = self._deviation * chance.standard_normal(len(self._deviation))
        return noise


def _mismeasure(
    error: MeasurementError, rows: Sequence[int], noise: _Noise, group: AgentGroup, measured: Sequence[int]
) -> None:
    """Add errors to what some agents have measured in a turn."""
    awareness, errors = group.awareness, np.zeros_like(group.awareness.state)
    struck = sorted(set(rows).intersection(measured))
    errors[struck] = error.bias + noise.draw(struck, group.surroundings.clock.now)
    if not errors.any():
        return
    awareness.state = awareness.state + errors
    observation = awareness.observation
    if observation is not None and observation.state is not None:
        awareness.observation = replace(observation, state=observation.state + errors)


@dataclass(frozen=True)
class Cut(Effect):
    """Messages of some agents to others are lost or late.

    Attributes:
        ways: Whose messages, and to whom.
        loss: Probability that one is lost.
        delay: How much later one arrives, in nanoseconds.
        bandwidth: How much gets into each link at most [bytes/s].
    """

    ways: Sequence[tuple[frozenset[str], frozenset[str]]]
    loss: float = 0.0
    delay: int = 0
    bandwidth: float = math.inf

    def begin(self, targets: Targets, name: str) -> Any:
        """Disturb the exchange."""
        disturbances = [Disturbance(name, *ends, self.loss, self.delay, self.bandwidth) for ends in self.ways]
        targets.simulation.exchange.disturb(disturbances)
        return disturbances

    def end(self, targets: Targets, begun: Any) -> None:
        """Let messages through again."""
        targets.simulation.exchange.relieve(begun)


@dataclass(frozen=True)
class Restore(Effect):
    """Another fault is over before its time."""

    fault: str

    def begin(self, targets: Targets, name: str) -> Any:
        """End it, unless it has not begun or is over already."""
        targets.ends(self.fault)


@dataclass(frozen=True)
class Push(Effect):
    """The true state of agents changes all at once."""

    agents: Sequence[AgentSelection]
    change: Array

    def begin(self, targets: Targets, name: str) -> Any:
        """Push them."""
        for group, rows in self.agents:
            targets.motion.push(group, rows, self.change)


@dataclass(frozen=True)
class Fault:
    """A fault that a scenario asks for.

    Attributes:
        name: What it is called.
        text: What it does, in one line.
        source: Whom it happens to, as a path.
        effect: What it does.
        at: When, in nanoseconds; None where it comes with an event.
        on: The event it comes with, the first time that it fires.
        lasting: For how long, in nanoseconds; None for the rest of the run.
    """

    name: str
    text: str
    source: str
    effect: Effect
    at: int | None = None
    on: Trigger | None = None
    lasting: int | None = None
