"""The simulation: agent groups, components, environment and message exchange, connected and ready to run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from itertools import groupby
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import Array
from symaware_cli.core import (
    AgentGroup,
    Clock,
    CommunicationReceiver,
    Component,
    Environment,
    Event,
    EventBus,
    ExternalInputs,
    GroupCommunicationReceiver,
    GroupComponent,
    Level,
    Obstacle,
    SubscriberError,
    Surroundings,
    WorldError,
)
from symaware_cli.core.event import RECURRING
from symaware_cli.engine.network.exchange import MessageExchange
from symaware_cli.engine.runtime.failure import RunError, describe
from symaware_cli.engine.runtime.finiteness import FinitenessCheck
from symaware_cli.engine.runtime.held_rows import HeldRows
from symaware_cli.engine.runtime.interruption import Interrupted
from symaware_cli.engine.runtime.queue import LivelockError
from symaware_cli.engine.runtime.timing import STEADY, Timing
from symaware_cli.engine.runtime.turn import in_turn
from symaware_cli.world import Turn

if TYPE_CHECKING:
    from symaware_cli.engine.network.network import Change, Network, TopologyPhase
    from symaware_cli.engine.network.traffic import Traffic

#: The greatest number of changed links for which the event names each link.
_MOST_LINKS_NAMED = 40


class ComponentEntry:
    """One component entry of one group: an instance for each agent, or a single group component.

    Attributes:
        group: The group.
        name: The entry's key in the scenario.
        use: The plugin's entry-point name.
        components: The instances, by row; one for a group component.
        section: The path of its section in the scenario.
        timing: When they take their turns; components know their `period`.
        is_substitute: Whether a fault lets it take the turns of another component of its name; until then it has none.
        own: The rows of the agents for which its parameters differ from those under ``with``, ascending.
        rows: The rows of the agents that use it, if it is a group component and others use one with other parameters;
            None for all.
        is_initialised: Whether any of its instances was initialised.
        turns: Each instance with its compute and update methods, for the hot loop; empty if `compute_and_update` is
            overridden.
    """

    __slots__ = (
        *("_timing", "components", "group", "is_initialised", "is_substitute"),
        *("name", "own", "path", "rows", "section", "turns", "use"),
    )

    def __init__(
        self,
        group: AgentGroup,
        name: str,
        use: str,
        components: Sequence[Component | GroupComponent],
        timing: Timing = STEADY,
        section: tuple[str | int, ...] | None = None,
        *,
        own: Sequence[int] = (),
        rows: Sequence[int] | None = None,
    ) -> None:
        """Give the instances their names.

        Args:
            group: See `ComponentEntry`.
            name: See `ComponentEntry`.
            use: See `ComponentEntry`.
            components: See `ComponentEntry`.
            timing: See `ComponentEntry`.
            section: The section of the fault that lets this component take the place of another; None for a component
                of the group's section.
            own: See `ComponentEntry`.
            rows: See `ComponentEntry`.
        """
        self.group = group
        self.name = name
        self.use = use
        self.own, self.rows = tuple(own), None if rows is None else tuple(rows)
        self.is_substitute, self.is_initialised = section is not None, False
        self.section: tuple[str | int, ...] = section or ("agents", group.name, "components", name)
        self.components: tuple[Component | GroupComponent, ...] = tuple(components)
        self.timing = timing
        plain = all(type(each).compute_and_update is Component.compute_and_update for each in self.components)
        self.turns = tuple((each, each._compute, each._update) for each in self.components) if plain else ()
        self.path = f"agents.{group.name}.{name}"
        for row, component in enumerate(self.components):
            component.name, component.use = name, use
            owner = group.name if isinstance(component, GroupComponent) else group.ids[row]
            component.path = f"agents.{owner}.{name}"

    @property
    def label(self) -> str:
        """The path, with an addition that distinguishes the entry from others with the same path."""
        return self.path + self.distinction

    @property
    def distinction(self) -> str:
        """What tells the entry from others with this path: the fault of a substitute, or whose parameters it has."""
        if self.is_substitute:
            return f", in {self.section[1]}"
        return f", of {self.group.ids[self.own[0]]}" if self.own and self.rows is not None else ""

    @property
    def others(self) -> Sequence[int]:
        """The rows of the agents that never use it."""
        return () if self.rows is None else sorted({*range(len(self.group))} - {*self.rows})

    @property
    def variations(self) -> Sequence[tuple[Component | GroupComponent, tuple[str | int, ...]]]:
        """An instance for each set of parameters that its agents have, and the path of the section of these."""
        if isinstance(self.components[0], GroupComponent):
            place = ("own", str(self.own[0])) if self.own else ("with",)
            return [(self.components[0], (*self.section, *place))]
        common = next((row for row in range(len(self.components)) if row not in self.own), None)
        own = [(self.components[row], (*self.section, "own", str(row))) for row in self.own]
        return own if common is None else [(self.components[common], (*self.section, "with")), *own]

    @property
    def timing(self) -> Timing:
        """When the components take their turns."""
        return self._timing

    @timing.setter
    def timing(self, timing: Timing) -> None:
        self._timing = timing
        for component in self.components:
            component.period = timing.period

    @property
    def listens(self) -> bool:
        """Whether the components read the messages that arrive for their agents."""
        return isinstance(self.components[0], CommunicationReceiver | GroupCommunicationReceiver)

    @property
    def kinds(self) -> frozenset[str] | None:
        """The kinds of messages that they read; None for all kinds that no component requests."""
        first = self.components[0]
        if isinstance(first, CommunicationReceiver | GroupCommunicationReceiver) and first.kinds is not None:
            return frozenset(first.kinds)
        return None

    def initialise(self) -> None:
        """Initialise every instance.

        Raises:
            RunError: An instance raised an exception.
        """
        for row in range(len(self.components)):
            self.initialise_one(row, 0)

    def initialise_one(self, row: int, now: int) -> None:
        """Initialise one instance, at the start or again.

        Args:
            row: The instance's row.
            now: The present time in nanoseconds.

        Raises:
            RunError: The instance raised an exception.
        """
        component, self.is_initialised = self.components[row], True
        try:
            with in_turn(component, Turn(now, -1)):
                self._initialise_instance(component, row)
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            raise RunError(component.path, self.use, now, describe(error), error) from error

    def _initialise_instance(self, component: Component | GroupComponent, row: int) -> None:
        if isinstance(component, GroupComponent):
            component.initialise_component(self.group)
        else:
            agent = self.group.agents[row]
            component.initialise_component(agent, agent.awareness_database, agent.knowledge_database)


#: See `Simulation.overrides`.
Overrides = Callable[[int], Mapping[AgentGroup, tuple[NDArray[np.bool_], Array]]]


class Simulation:
    """The objects of one run.

    Attributes:
        name: The scenario's name.
        seed: The seed in force.
        environment: The environment.
        groups: The groups of agents, sorted by name, so that their order in a file has no effect.
        entries: The component entries in execution order: groups by name, components in declared order.
        clock: Simulated time.
        events: The event bus.
        exchange: The message exchange.
        inputs: What components get from outside of the run.
        overrides: Returns, for a number of steps made, control inputs that replace those that components request: for
            each group concerned a mask of its rows, and the values for all rows. None to replace none.
    """

    def __init__(
        self,
        *,
        name: str,
        seed: int,
        environment: Environment,
        environment_use: str,
        groups: Sequence[AgentGroup],
        entries: Sequence[ComponentEntry],
        obstacles: Mapping[str, Obstacle],
    ) -> None:
        self.name = name
        self.seed = seed
        self.environment = environment
        self.environment_use = environment_use
        self.groups = tuple(sorted(groups, key=lambda group: group.name))
        self.entries = tuple(sorted(entries, key=lambda entry: entry.group.name))
        self.overrides: Overrides | None = None
        self.clock = Clock()
        self.events = EventBus()
        self.inputs = ExternalInputs()
        self._ids = frozenset(id for group in groups for id in group.ids)
        try:
            environment.initialise(self.groups, obstacles, seed)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise self.environment_failure(error) from error
        for group in self.groups:
            with suppress(WorldError):
                group.drive = environment.drive(group)
        # A substitute reads what the component that it replaces would read.
        own = [entry for entry in self.entries if not entry.is_substitute]
        listening = {id for entry in own if entry.listens and entry.kinds is None for id in entry.group.ids}
        self.exchange = MessageExchange(
            environment.roster.ids,
            listening,
            on_traffic=self._announce_traffic,
            on_change=self._announce_link_change,
            seed=seed,
            time_step=environment.time_step,
        )
        self.exchange.present = environment.present
        for entry in own:
            if entry.kinds is not None:
                columns = isinstance(entry.components[0], GroupComponent)
                name = entry.path if columns else entry.name
                self.exchange.inboxes.open(name, entry.group.ids, entry.kinds, columns=columns)
        self.events.name_components(self._components)
        surroundings = Surroundings(seed, environment, self.exchange, self.clock, self.events, self.inputs)
        for group in self.groups:
            group.surroundings = surroundings
            group.awareness.clock = self.clock

    def _components(self) -> Mapping[str, object]:
        """All components, by names that are theirs alone."""
        return {
            component.path + entry.distinction: component for entry in self.entries for component in entry.components
        }

    @property
    def tolerances(self) -> Mapping[str, float]:
        """The components whose results are repeated to a tolerance only, by their paths; usually none."""
        found: dict[str, float] = {}
        for component in (each for entry in self.entries for each in entry.components):
            greatest = component.repeatable_to
            if greatest is not None:
                found[component.path] = max(greatest, found.get(component.path, 0.0))
        return found

    def reseed(self, seed: int) -> None:
        """Let latencies and faults that begin from now on draw from another seed."""
        self.seed = seed

    @property
    def agent_count(self) -> int:
        """The number of agents, present or absent."""
        return len(self.environment.roster)

    def initialise(self) -> None:
        """Initialise all components but substitutes.

        Raises:
            RunError: A component raised an exception, or wrote a value that is not finite.
        """
        self.exchange.renew_links()
        for path, entries in groupby((each for each in self.entries if not each.is_substitute), lambda each: each.path):
            self.announce("initialising", path)
            for entry in entries:
                with self.held(entry):
                    entry.initialise()
                for rows, problem in FinitenessCheck(entry.group, path, entry.use).violations(None):
                    raise RunError(f"agents.{entry.group.ids[rows[0]]}.{entry.name}", entry.use, 0, problem)
            self.announce("initialised", path)

    def held(self, entry: ComponentEntry) -> AbstractContextManager[object]:
        """A context in which a component is initialised: it acts for none of the agents that never use it."""
        return self.holding(entry, entry.others) if entry.others else nullcontext()

    def holding(self, entry: ComponentEntry, rows: Sequence[int]) -> HeldRows:
        """A context for the turns of a group component in which it acts for none of some agents."""
        return HeldRows(entry.group, entry.name, rows, self.environment.roster, self.exchange, self.events)

    def announce(self, name: str, source: str, text: str = "", *, level: Level = Level.INFO, **data: object) -> None:
        """Fire an event on behalf of the run; a recurring event only if it has subscribers."""
        if name in self.events.wanted or name not in RECURRING:
            self.events.fire(Event(name, source, self.clock.now, level, text, data, self, self.agent_of(source)))

    def environment_failure(self, error: BaseException) -> RunError:
        """Return the failure of the world that an exception of its is."""
        return RunError("environment", self.environment_use, self.clock.now, describe(error), error)

    def livelock_failure(self, error: LivelockError) -> RunError:
        """Return the failure of the components that take turn after turn at one instant."""
        entries = [self.entries[place] for place in error.places if place >= 0]
        names = ", ".join(f"`{entry.path}`" for entry in entries)
        problem = f"no time passes any more: {names} take turn after turn at one instant"
        source, plugin = (entries[0].path, entries[0].use) if entries else ("run", "symaware")
        return RunError(source, plugin, self.clock.now, problem)

    def subscriber_failure(self, error: SubscriberError) -> RunError:
        """Return the failure of a subscriber; it is that of its component if it is a method of one."""
        cause = error.__cause__ or error
        problem = f"{error}: {describe(cause)}"
        owner = getattr(error.subscriber, "__self__", None)
        source, plugin = error.event.source, "subscriber"
        if isinstance(owner, Component | GroupComponent):
            source, plugin = owner.path, owner.use
        return RunError(source, plugin, self.clock.now, problem, cause)

    def agent_of(self, source: str) -> str | None:
        """The id of the agent that a path denotes, or whose component it denotes; None for other paths."""
        path = source.removeprefix("agents.")
        ids = self._ids
        return path if path in ids else owner if (owner := path.rpartition(".")[0]) in ids else None

    def connect(self, network: Network) -> None:
        """Send messages over a network, instead of directly and without delay between all agents."""
        network.on_failure = self._raise_topology_failure
        self.exchange.network = network

    def _raise_topology_failure(self, phase: TopologyPhase, error: BaseException) -> NoReturn:
        """Raise the failure of a topology as a failure of the run."""
        if isinstance(error, Interrupted):
            raise error
        raise RunError(phase.source, phase.use, self.clock.now, describe(error), error) from error

    def _announce_traffic(self, traffic: Traffic) -> None:
        """Fire one event for a batch of messages, and one for each message if that event has subscribers."""
        now, wanted = self.clock.now, self.events.wanted
        if "traffic" in wanted:
            self.events.fire(Event("traffic", "exchange", now, subject=traffic))
        name = {"sent": "sent", "delivered": "received", "dropped": "dropped"}[traffic.stage]
        if name not in wanted:
            return
        for message, reason in traffic.messages(self.environment.roster.ids):
            agent = message.receiver if name == "received" else message.sender
            text, data = (f"lost by `{reason}`", {"reason": reason}) if reason else ("", {})
            source = f"agents.{agent}"
            self.events.fire(
                Event(name, source, now, text=text, data=data, subject=message, agent=agent, value=message)
            )

    def _announce_link_change(self, change: Change) -> None:
        """Fire an event for changed links."""
        text = f"{change.links} links"
        if change.begun or change.ended:
            text += f": {len(change.begun)} new, {len(change.ended)} no more"
        data: dict[str, object] = {"links": change.links, "begun": len(change.begun), "ended": len(change.ended)}
        if len(change.begun) + len(change.ended) <= _MOST_LINKS_NAMED:
            data |= {"begun": [list(each) for each in change.begun], "ended": [list(each) for each in change.ended]}
        # Links between moving agents change all the time, which few readers want to see.
        level = Level.WARNING if change.breaks else Level.DEBUG if change.moves else Level.INFO
        if change.parts is not None:
            data["parts"] = change.parts
            text += f"; not connected: {change.parts} parts" if change.parts > 1 else "; connected"
        self.announce("links-changed", "topology", text, level=level, **data)
