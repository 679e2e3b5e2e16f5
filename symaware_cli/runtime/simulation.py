"""A run that is ready to begin: agents, components and world, brought together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli.core import (
    AgentGroup,
    Clock,
    CommunicationReceiver,
    Component,
    Environment,
    Event,
    EventBus,
    GroupComponent,
    Level,
    Message,
    Obstacle,
    SubscriberError,
    Surroundings,
)
from symaware_cli.core.event import RECURRING
from symaware_cli.network.exchange import MemoryExchange
from symaware_cli.runtime.faults import RunError, describe
from symaware_cli.runtime.interruption import Interrupted


class Slot:
    """One component entry of one group: an instance for each agent, or one for all of them.

    Attributes:
        group: The group.
        name: The entry's key in the scenario.
        use: The plugin's entry-point name.
        components: The instances, by row; a single one where it is a group component.
        turns: Each instance with its two methods, for the hot loop; empty where a turn is not just the two.
    """

    __slots__ = ("components", "group", "name", "path", "turns", "use")

    def __init__(
        self, group: AgentGroup, name: str, use: str, components: Sequence[Component] | Sequence[GroupComponent]
    ) -> None:
        self.group = group
        self.name = name
        self.use = use
        self.components: tuple[Component | GroupComponent, ...] = tuple(components)
        plain = all(type(each).compute_and_update is Component.compute_and_update for each in self.components)
        self.turns = tuple((each, each._compute, each._update) for each in self.components) if plain else ()
        self.path = f"agents.{group.name}.{name}"
        for row, component in enumerate(self.components):
            component.name, component.use = name, use
            owner = group.name if isinstance(component, GroupComponent) else group.ids[row]
            component.path = f"agents.{owner}.{name}"

    @property
    def listens(self) -> bool:
        """Whether the components read the messages that arrive for their agents."""
        return isinstance(self.components[0], CommunicationReceiver)

    def initialise(self) -> None:
        """Let every instance take up its work.

        Raises:
            RunError: One raised.
        """
        for row, component in enumerate(self.components):
            try:
                if isinstance(component, GroupComponent):
                    component.initialise_component(self.group)
                else:
                    agent = self.group.agents[row]
                    component.initialise_component(agent, agent.awareness_database, agent.knowledge_database)
            except (SubscriberError, Interrupted, KeyboardInterrupt):
                raise
            except BaseException as error:
                raise RunError(component.path, self.use, 0, describe(error), error) from error


class Simulation:
    """Everything that a run consists of.

    Attributes:
        name: The scenario's name.
        seed: The seed in force.
        environment: The world.
        groups: The groups of agents, in the order of the scenario.
        slots: The components in execution order: groups in scenario order, components in declared order.
        clock: Simulated time.
        events: Who is told of what happens.
        exchange: What carries messages.
    """

    def __init__(
        self,
        *,
        name: str,
        seed: int,
        environment: Environment,
        environment_use: str,
        groups: Sequence[AgentGroup],
        slots: Sequence[Slot],
        obstacles: Mapping[str, Obstacle],
    ) -> None:
        self.name = name
        self.seed = seed
        self.environment = environment
        self.environment_use = environment_use
        self.groups = tuple(groups)
        self.slots = tuple(slots)
        self.clock = Clock()
        self.events = EventBus()
        self._obstacles = obstacles
        try:
            environment.initialise(self.groups, obstacles, seed)
        except Exception as error:
            raise RunError("environment", environment_use, 0, describe(error), error) from error
        listening = {id for slot in self.slots if slot.listens for id in slot.group.ids}
        self.exchange = MemoryExchange(environment.roster.ids, self._sent, self._received, listening)
        surroundings = Surroundings(seed, environment, self.exchange, self.clock, self.events)
        for group in self.groups:
            group.surroundings = surroundings

    @property
    def agent_count(self) -> int:
        """How many agents there are."""
        return len(self.environment.roster)

    def initialise(self) -> None:
        """Let all components take up their work.

        Raises:
            RunError: One raised.
        """
        for slot in self.slots:
            self.announce("initialising", slot.path)
            slot.initialise()
            self.announce("initialised", slot.path)

    def announce(self, name: str, source: str, text: str = "", *, level: Level = Level.INFO, **data: object) -> None:
        """Fire an event on behalf of the run; one that recurs only if somebody listens."""
        if name in self.events.wanted or name not in RECURRING:
            self.events.fire(Event(name, source, self.clock.now, level, text, data, self))

    def _sent(self, message: Message) -> None:
        if "sent" in self.events.wanted:
            self.events.fire(Event("sent", f"agents.{message.sender}", self.clock.now, subject=message))

    def _received(self, message: Message) -> None:
        if "received" in self.events.wanted:
            self.events.fire(Event("received", f"agents.{message.receiver}", self.clock.now, subject=message))
