"""The interface of faults: a class for each kind, the scenario in which it is checked, and the run that it acts on.

Reasons: docs/decisions/0065-kinds-of-faults.md
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Environment, Plugin
from symaware_cli.engine.network.disturbance import Disturbance

if TYPE_CHECKING:
    # Validating a scenario does not import the modules that run it.
    from symaware_cli.core.component import BaseComponent
    from symaware_cli.engine.runtime.environment_stepper import EnvironmentStepper
    from symaware_cli.engine.runtime.membership import Membership
    from symaware_cli.engine.runtime.restraint import Restraint
    from symaware_cli.engine.runtime.scheduler import TurnScheduler
    from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
    from symaware_cli.engine.runtime.supervision import Disturb
    from symaware_cli.engine.runtime.timing import Trigger
    from symaware_cli.world import ProbabilityDistribution

Array = NDArray[np.float64]

#: The keys of a fault that are no kinds.
TIMES = ("at", "on", "for")

#: Pairs of sets of ids: the senders and the receivers of messages.
Ways = Sequence[tuple[frozenset[str], frozenset[str]]]


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


class Fault(Plugin, ABC):
    """Base class of the kinds of faults, registered under the key that names the kind in a scenario.

    `Parameters` describes the value of that key: a model with fields, or a `pydantic.RootModel` for a single value. An
    instance is one fault of a scenario. It is part of the scenario, not of the state of the run: from `begin` on, its
    attributes must not change, and `end` receives the result of `begin`.

    Attributes:
        lasts: Whether it has a duration; if not, it happens at once, and a scenario cannot give it a `for`.
        component_key: Whether its parameters name a component of a plugin, as `use` and `with` do elsewhere.
        precedes: Whether it begins before other faults of the same instant.
        adds_components: Whether it may bring in components that other faults act on as well.
        kind: Its entry-point name.
        name: The name of the fault in the scenario.
        at: When it begins, in nanoseconds; None if it begins with an event.
        on: The event at whose first occurrence it begins.
        lasting: Its duration in nanoseconds; None for the rest of the run.
    """

    lasts: ClassVar[bool] = True
    component_key: ClassVar[bool] = False
    precedes: ClassVar[bool] = False
    adds_components: ClassVar[bool] = False

    #: A fault that is reached from a captured state, such as by a bound method of it, is that of the scenario.
    uncaptured: ClassVar[Collection[str]] = ("*",)

    kind: str = ""
    name: str = ""
    at: int | None = None
    on: Trigger | None = None
    lasting: int | None = None

    @property
    def source(self) -> str:
        """The source of the events `fault` and `fault-over`.

        It is ``agents.`` with the name or pattern of the agents or components concerned; ``exchange``, for messages; or
        ``faults``.
        """
        return "faults"

    @property
    @abstractmethod
    def text(self) -> str:
        """Its effect in a few words that follow its name: in the log, on the command line and in replays."""

    @property
    def limits_bandwidth(self) -> bool:
        """Whether it limits the bandwidth of links, so that channels without a bandwidth may have queues."""
        return False

    @property
    def effect_before(self) -> str | None:
        """How the run differs before the fault begins, in one sentence, so that no branch can add it; None if not."""
        return None

    @abstractmethod
    def resolve(self, context: FaultContext) -> None:
        """Find the agents, components or links concerned, and check everything that can be checked before the run.

        Args:
            context: The scenario, which finds them and reports problems at their places in the file.

        Raises:
            ValueError: The fault does not fit the scenario; it is reported at the fault.
        """

    @abstractmethod
    def begin(self, run: FaultTargets) -> Any:
        """Apply the effect.

        Args:
            run: The parts of the run that faults act on.

        Returns:
            The argument of `end`. It belongs to the state of the run, and is captured with it: use numbers, texts,
            arrays, lists, mappings, and functions of modules or methods of the fault. An array must be a copy of the
            scenario's, since restoring a state may write into it.
        """

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Undo the effect, if it can be undone.

        Args:
            run: The parts of the run that faults act on.
            begun: The result of `begin`.
        """
        return


class FaultContext(ABC):
    """The scenario around a fault, while it is checked.

    Its methods look up the objects that parameters name. A problem is reported at the place of the parameter, and ends
    the checks of this fault. A place consists of the keys and indices under the key of the kind: ``"between", 0``.

    Attributes:
        groups: All groups of agents.
        environment: The environment, not initialised yet.
        others: The other faults of the scenario by name, not necessarily resolved; None for an invalid one.
    """

    groups: Sequence[AgentGroup]
    environment: Environment
    others: Mapping[str, Fault | None]

    @abstractmethod
    def agents(self, pattern: str, *place: str | int) -> list[AgentSelection]:
        """The agents that an id, the name of a group or a pattern matches, at least one."""

    @abstractmethod
    def ids(self, pattern: str, *place: str | int) -> frozenset[str]:
        """The ids of these agents."""

    @abstractmethod
    def components(self, pattern: str, *place: str | int, substitutes: bool = True) -> list[ComponentSelection]:
        """The components that a pattern matches, at least one.

        Args:
            pattern: The agents and the name of the component, as in ``robot.2.steer``.
            place: The place of the pattern.
            substitutes: Whether to include components that other faults bring in.
        """

    @abstractmethod
    def vector(self, values: Sequence[float], groups: Iterable[AgentGroup], *place: str | int) -> Array:
        """A vector with one number for each element of the state of all groups; shape (nx,)."""

    @abstractmethod
    def duration(self, latency: Any) -> ProbabilityDistribution:
        """The duration that a `Latency` defines: constant, or drawn for each computation."""

    @abstractmethod
    def require_link(self, one: frozenset[str], other: frozenset[str], *place: str | int) -> None:
        """Check that there can be a link between two sets of agents, given by their ids."""

    @abstractmethod
    def require_pushes(self) -> None:
        """Check that the world supports sudden changes of states."""

    @abstractmethod
    def knowledge(
        self, agents: AgentSelection, values: Mapping[str, Any], *place: str | int
    ) -> Sequence[Mapping[str, Any]]:
        """The values of knowledge that a mapping, in the form of a group's, defines for each of the agents."""

    @abstractmethod
    def variants(
        self, components: ComponentSelection, changed: Mapping[str, Any], *place: str | int
    ) -> Sequence[BaseComponent[Any]]:
        """Create a component with some other parameters for each one that is selected, and check that it can work."""

    @abstractmethod
    def substitute(
        self, components: ComponentSelection, changed: Mapping[str, Any] | None = None, *place: str | int
    ) -> ComponentEntry:
        """Create a component in place of another one, and add it to the scenario.

        Args:
            components: The components in whose place it takes turns.
            changed: Parameters that differ from those of the other one; None for the component that the fault's
                parameters name.
            place: Where these are written.
        """

    @abstractmethod
    def quoted(self, text: str) -> str:
        """A text of the scenario in backticks, shortened if it is long, for a message."""

    @abstractmethod
    def refuse(
        self,
        message: str,
        *place: str | int,
        code: str = "invalid-value",
        key: bool = False,
        beside: bool = False,
        expected: str | None = None,
        known: Iterable[str] | None = None,
    ) -> NoReturn:
        """Report a problem, and end the checks of this fault.

        Args:
            message: The problem, in one sentence.
            place: Its place.
            code: A stable identifier for tools.
            key: Whether it is at the last key of the place, not at its value.
            beside: Whether the place is beside the key of the kind, such as ``"at"``.
            expected: A description of valid values.
            known: The valid texts at the place; the nearest is suggested.
        """

    @abstractmethod
    def refuse_unknown(self, noun: str, name: str, known: Iterable[str], *place: str | int) -> NoReturn:
        """Report that nothing has a name, with the existing names.

        Args:
            noun: The word for the missing thing, such as ``component``.
            name: The name.
            known: The existing names.
            place: The place of the name.
        """


class FaultTargets:
    """The parts of a run that faults act on.

    Attributes:
        simulation: The simulation.
        schedulers: The turn scheduler of each component entry, in their order.
    """

    def __init__(
        self,
        simulation: Simulation,
        schedulers: Sequence[TurnScheduler],
        membership: Membership,
        stepper: EnvironmentStepper,
        end_fault: Callable[[str], object],
        prevent_fault: Callable[[str], object],
    ) -> None:
        """Prepare.

        Args:
            simulation: See `FaultTargets`.
            schedulers: See `FaultTargets`.
            membership: Takes agents out of the run and back in.
            stepper: Steps the environment.
            end_fault: Ends another fault, by its name.
            prevent_fault: Ends another fault, and lets it not begin any more, by its name.
        """
        self.simulation = simulation
        self.schedulers = schedulers
        self._membership = membership
        self._stepper = stepper
        self._end_fault = end_fault
        self._prevent_fault = prevent_fault

    @property
    def now(self) -> int:
        """Simulated time, in nanoseconds."""
        return self.simulation.clock.now

    @property
    def seed(self) -> int:
        """The seed of all random draws."""
        return self.simulation.seed

    @property
    def environment(self) -> Environment:
        """The world."""
        return self.simulation.environment

    def stop(self, agents: AgentSelection, reason: str) -> None:
        """Take agents out of the run; the world still moves their bodies."""
        self._membership.retire(*agents, "safe", reason)

    def revive(self, agents: AgentSelection) -> None:
        """Undo `stop`; agents that have no other reason to be stopped restart."""
        self._membership.revive(*agents)

    def push(self, agents: AgentSelection, change: Array) -> None:
        """Add to the true states of those of the agents that are present; shape (nx,)."""
        self._stepper.push(*agents, change)

    def restrain(self, restraint: Restraint) -> None:
        """Hold agents back in the steps of the world from now on; the world has to support sudden changes of states.

        A restraint that is not the fault itself belongs to the state of the run, like the result of `Fault.begin`.
        """
        self._stepper.restrain(restraint)

    def release(self, restraint: Restraint) -> None:
        """Undo `restrain`."""
        self._stepper.release(restraint)

    def restart(self, components: ComponentSelection) -> None:
        """Cancel the present turns of components, and initialise them again."""
        self.scheduler(components).restart_agents(components.rows)

    def suspend(self, components: ComponentSelection) -> None:
        """Let components take no turns; the values that they wrote remain."""
        for row in components.rows:
            self.scheduler(components).hold(row)

    def resume(self, components: ComponentSelection) -> None:
        """Undo `suspend`; the components take turns if there is no other reason not to."""
        for row in components.rows:
            self.scheduler(components).release(row)

    def slow_down(self, components: ComponentSelection, duration: ProbabilityDistribution) -> None:
        """Impose a latency on computations; of several, the longest applies."""
        self.scheduler(components).supervision.slow_down(components.rows, duration)

    def speed_up(self, components: ComponentSelection, duration: ProbabilityDistribution) -> None:
        """Undo `slow_down`."""
        self.scheduler(components).supervision.speed_up(components.rows, duration)

    def add_disturbance(self, components: ComponentSelection, disturb: Disturb) -> None:
        """Let a function change what components write.

        Args:
            components: The components.
            disturb: Called after each turn with the group, and the rows of the agents whose believed states were
                written in it.
        """
        self.scheduler(components).supervision.add_disturbance(disturb)

    def remove_disturbance(self, components: ComponentSelection, disturb: Disturb) -> None:
        """Undo `add_disturbance`."""
        self.scheduler(components).supervision.remove_disturbance(disturb)

    def disturb_messages(
        self,
        name: str,
        ways: Ways,
        loss: float = 0.0,
        delay: int = 0,
        bandwidth: float = math.inf,
        *,
        in_time: bool = False,
        draw: str = "",
    ) -> Sequence[Disturbance]:
        """Let messages from some agents to others be lost or delayed, or be neither.

        Args:
            name: The name of the fault, which is the reason of the losses and keys the random draws.
            ways: The senders and the receivers, by their ids.
            loss: Probability that a message is lost.
            delay: Additional delay of a message, in nanoseconds.
            bandwidth: Greatest data rate of each link [bytes/s].
            in_time: Whether messages are neither lost nor delayed, regardless of their links and other faults.
            draw: Names other random draws, which decide their fates; empty for those of the run.

        Returns:
            The argument of `restore_messages`.
        """
        disturbances = [Disturbance(name, *ends, loss, delay, bandwidth, in_time, draw) for ends in ways]
        self.simulation.exchange.add_disturbances(disturbances)
        return disturbances

    def restore_messages(self, disturbances: Sequence[Disturbance]) -> None:
        """Undo `disturb_messages`."""
        self.simulation.exchange.remove_disturbances(disturbances)

    def end_fault(self, name: str) -> None:
        """End another fault, if it has begun."""
        self._end_fault(name)

    def prevent_fault(self, name: str) -> None:
        """End another fault, if it has begun, and let it not begin any more."""
        self._prevent_fault(name)

    def scheduler(self, components: ComponentSelection) -> TurnScheduler:
        """The turn scheduler of a component."""
        return self.schedulers[self.simulation.entries.index(components.entry)]
