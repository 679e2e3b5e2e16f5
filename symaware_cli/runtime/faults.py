"""Faults of a scenario: stopped agents, frozen or slow components, sensor errors, communication faults, pushes."""

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
    # Validating a scenario does not import the modules that run it.
    from symaware_cli.runtime.environment_stepper import EnvironmentStepper
    from symaware_cli.runtime.membership import Membership
    from symaware_cli.runtime.scheduler import TurnScheduler

Array = NDArray[np.float64]


class AgentSelection(NamedTuple):
    """Some agents of one group.

    Attributes:
        group: The group.
        rows: The agents' rows, ascending.
    """

    group: AgentGroup
    rows: Sequence[int]


class ComponentSelection(NamedTuple):
    """A component of some agents.

    Attributes:
        entry: The component entry.
        rows: The agents' rows, ascending.
    """

    entry: ComponentEntry
    rows: Sequence[int]


@dataclass(frozen=True)
class Targets:
    """The parts of a run that faults act on.

    Attributes:
        simulation: The simulation.
        schedulers: The turn scheduler of each entry, in their order.
        membership: Takes agents out of the run and back in.
        stepper: Steps the environment.
        end_fault: Ends another fault, by its name.
    """

    simulation: Simulation
    schedulers: Sequence[TurnScheduler]
    membership: Membership
    stepper: EnvironmentStepper
    end_fault: Callable[[str], object]

    def scheduler(self, components: ComponentSelection) -> TurnScheduler:
        """The turn scheduler of a component."""
        return self.schedulers[self.simulation.entries.index(components.entry)]


class Effect(ABC):
    """The effect of a fault."""

    @abstractmethod
    def begin(self, targets: Targets, name: str) -> Any:
        """Apply the effect.

        Args:
            targets: The parts of the run that the effect acts on.
            name: The fault's name, which keys its random draws.

        Returns:
            The data that `end` needs.
        """

    def end(self, targets: Targets, begun: Any) -> None:
        """Undo the effect, if it can be undone; `begun` is the result of `begin`."""
        return


@dataclass(frozen=True)
class Stop(Effect):
    """Agents stop; when the fault ends, they restart."""

    agents: Sequence[AgentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Take the agents out of the run."""
        for group, rows in self.agents:
            targets.membership.retire(group, rows, "safe", f"stopped by the fault `{name}`")

    def end(self, targets: Targets, begun: Any) -> None:
        """Restart the agents that have no other reason to be stopped."""
        for group, rows in self.agents:
            targets.membership.revive(group, rows)


@dataclass(frozen=True)
class Restart(Effect):
    """Components cancel their present turns and restart."""

    components: Sequence[ComponentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Initialise the components again."""
        for each in self.components:
            targets.scheduler(each).restart_agents(each.rows)


@dataclass(frozen=True)
class Freeze(Effect):
    """Components take no turns; the values that they wrote remain."""

    components: Sequence[ComponentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Suspend the components."""
        for each in self.components:
            for row in each.rows:
                targets.scheduler(each).hold(row)

    def end(self, targets: Targets, begun: Any) -> None:
        """Resume the components."""
        for each in self.components:
            for row in each.rows:
                targets.scheduler(each).release(row)


@dataclass(frozen=True)
class Slow(Effect):
    """Computations take a different time; of several such faults, the longest time applies."""

    components: Sequence[ComponentSelection]
    latency: Duration

    def begin(self, targets: Targets, name: str) -> Any:
        """Add the latency."""
        for each in self.components:
            targets.scheduler(each).supervision.slow_down(each.rows, self.latency)

    def end(self, targets: Targets, begun: Any) -> None:
        """Restore the latency of the scenario, or of other faults."""
        for each in self.components:
            targets.scheduler(each).supervision.speed_up(each.rows, self.latency)


@dataclass(frozen=True)
class Blind(Effect):
    """Sensors detect no other agents; they still measure the agent's own state."""

    components: Sequence[ComponentSelection]

    def begin(self, targets: Targets, name: str) -> Any:
        """Remove what the sensors detect from now on, and what they detected before."""
        begun = []
        for each in self.components:
            disturbance = partial(_blindfold, frozenset(each.rows))
            scheduler = targets.scheduler(each)
            scheduler.supervision.add_disturbance(disturbance)
            disturbance(scheduler.entry.group, ())
            begun.append((scheduler, disturbance))
        return begun

    def end(self, targets: Targets, begun: Any) -> None:
        """Let the sensors detect agents again, from their next turns on."""
        for scheduler, disturbance in begun:
            scheduler.supervision.remove_disturbance(disturbance)


def _blindfold(rows: frozenset[int], group: AgentGroup, measured: Sequence[int]) -> None:
    """Remove what some agents believe about others."""
    awareness = group.awareness
    for row in sorted(rows):
        database = group.agents[row].awareness_database
        for id in list(database.others):
            del database[id]
        if database.world is not awareness.world:
            database.world = None
    if awareness.world is not None and awareness.seen is None:
        # One snapshot is shared by all agents; if it is removed for some, each of the others needs tracks.
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
    """Sensors measure the agent's own state with an error: a bias, or noise drawn at each turn, or both."""

    components: Sequence[ComponentSelection]
    bias: Array
    deviation: Array

    def begin(self, targets: Targets, name: str) -> Any:
        """Add the error to all measurements from now on."""
        begun = []
        for each in self.components:
            scheduler = targets.scheduler(each)
            noise = _Noise(self.deviation, scheduler.entry, targets.simulation.seed, name)
            disturbance = partial(_mismeasure, self, each.rows, noise)
            scheduler.supervision.add_disturbance(disturbance)
            begun.append((scheduler, disturbance))
        return begun

    def end(self, targets: Targets, begun: Any) -> None:
        """Stop adding the error."""
        for scheduler, disturbance in begun:
            scheduler.supervision.remove_disturbance(disturbance)


class _Noise:
    """The measurement noise of one fault in one component; draws are keyed by both, the agent and the turn."""

    def __init__(self, deviation: Array, entry: ComponentEntry, seed: int, fault: str) -> None:
        self._deviation = deviation
        self._seed = seed
        self._purpose = f"component {entry.name} fault {fault}"
        self._numbers = agent_numbers(entry.group.ids)
        self._turns = Turns()

    def reseed(self, seed: int) -> None:
        """Draw from another seed from now on."""
        self._seed = seed

    def draw(self, rows: Sequence[int], now: int) -> Array:
        """Draw the noise of some agents for the turn that ends now [ns]; shape (k, nx)."""
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
    """Add errors to the measurements of some agents in a turn."""
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
    """Messages from some agents to others are lost or delayed.

    Attributes:
        ways: Pairs of sets of agents: senders and receivers.
        loss: Probability that a message is lost.
        delay: Additional delay of a message, in nanoseconds.
        bandwidth: Greatest data rate of each link [bytes/s].
    """

    ways: Sequence[tuple[frozenset[str], frozenset[str]]]
    loss: float = 0.0
    delay: int = 0
    bandwidth: float = math.inf

    def begin(self, targets: Targets, name: str) -> Any:
        """Disturb the message exchange."""
        disturbances = [Disturbance(name, *ends, self.loss, self.delay, self.bandwidth) for ends in self.ways]
        targets.simulation.exchange.add_disturbances(disturbances)
        return disturbances

    def end(self, targets: Targets, begun: Any) -> None:
        """Remove the disturbance."""
        targets.simulation.exchange.remove_disturbances(begun)


@dataclass(frozen=True)
class Restore(Effect):
    """Another fault ends early."""

    fault: str

    def begin(self, targets: Targets, name: str) -> Any:
        """End the other fault, if it is active."""
        targets.end_fault(self.fault)


@dataclass(frozen=True)
class Push(Effect):
    """The true state of agents changes instantaneously."""

    agents: Sequence[AgentSelection]
    change: Array

    def begin(self, targets: Targets, name: str) -> Any:
        """Change the states."""
        for group, rows in self.agents:
            targets.stepper.push(group, rows, self.change)


@dataclass(frozen=True)
class Fault:
    """A fault declared in a scenario.

    Attributes:
        name: Its name.
        text: A description in one line.
        source: The path of the agents, components or links affected.
        effect: Its effect.
        at: When it begins, in nanoseconds; None if it begins with an event.
        on: The event at whose first occurrence it begins.
        lasting: Its duration in nanoseconds; None for the rest of the run.
    """

    name: str
    text: str
    source: str
    effect: Effect
    at: int | None = None
    on: Trigger | None = None
    lasting: int | None = None
