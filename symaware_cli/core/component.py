"""Components: the functions that update an agent's situational awareness."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Collection, Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.database import AwarenessDatabase
from symaware_cli.awareness.knowledge import KnowledgeDatabase
from symaware_cli.awareness.part import Part
from symaware_cli.awareness.signal import Signal
from symaware_cli.core.agent import Agent, AgentGroup, Surroundings
from symaware_cli.core.environment import Environment
from symaware_cli.core.event import Event, Level, Subscriber, Subscription
from symaware_cli.core.message import Delivery
from symaware_cli.core.waiting import AllOf, AnyOf, EventWait, Sleep, Wait
from symaware_cli.world.chance import AgentChance, GroupChance, Turn
from symaware_cli.world.model import Quantity
from symaware_cli.world.plugin import Plugin
from symaware_cli.world.time import SECOND, nanoseconds

Array = NDArray[np.float64]
Owner = TypeVar("Owner")


class BaseComponent(Plugin, ABC, Generic[Owner]):
    """What components of agents and of groups have in common.

    A turn of a component computes a value from what its agent is aware of, then updates the awareness with it.

    Attributes:
        bodies: Which of its parameters name an ``agent``, an ``agent or entity``, or ``agents`` by a list of ids,
            groups and patterns; looked up before a run.
        events: The events that the component fires besides those of every component, with what each means.
        knowledge: What an agent must know for the component to work, with what each means.
        name: The component's key in the scenario.
        parts: The parts of awareness that it writes, beside those that every agent has.
        path: Where it stands, such as ``agents.robot.2.steer``; the source of its events.
        requires: What the world must have for the component to work, as in `Environment.provides`, with where it is.
        signals: What it hands out in its turns beside awareness, to be recorded and for others to look at.
        sees_world: Whether it looks at the world itself, and not only at what its agent is aware of; where it computes
            in a process of its own, that process then follows the world.
        use: The plugin's entry-point name.
    """

    bodies: ClassVar[Mapping[str, str]] = {}
    events: ClassVar[Mapping[str, str]] = {}
    knowledge: ClassVar[Mapping[str, str]] = {}
    parts: ClassVar[Sequence[Part]] = ()
    requires: ClassVar[Mapping[str, str]] = {}
    sees_world: ClassVar[bool] = False
    signals: ClassVar[Sequence[Signal]] = ()

    # Class defaults, so that a subclass with an __init__ of its own need not call this one.
    name: str = ""
    path: str = ""
    use: str = ""

    _surroundings: Surroundings

    def check(self, group: AgentGroup) -> None:
        """Look whether the component can work for a group; called before a run, to find fault early.

        Args:
            group: Has its model, states and knowledge; nothing runs yet.

        Raises:
            ValueError: It cannot, and why, in words for the author of the scenario.
        """

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Name the columns of the time series that the component sets, for whoever reads or draws the log.

        Where the names are those that docs/log-format.md lists, a replay knows what they mean: an intent with the names
        of the position is drawn as a path, an uncertainty with covariances of it as ellipses.

        Args:
            group: Has its model.

        Returns:
            Name and unit of each column, by the name of the part; nothing by default.
        """
        return {}

    @abstractmethod
    def _compute(self) -> Any:
        """Compute a value from what is known; changes nothing, the component itself included."""

    @abstractmethod
    def _update(self, value: Any) -> None:
        """Update the awareness, the knowledge or the control input with a value that was computed."""

    def misfit(self, value: Any) -> str | None:
        """Say what `_compute` should have returned, for a value that `_update` cannot take.

        Args:
            value: What it returned.

        Returns:
            One sentence; None where there is nothing to object to.
        """
        return None

    def explained(self, value: Any, error: Exception) -> Exception:
        """Return what to raise where `_update` could not take a value: in plain words, if that is of the wrong kind."""
        own = next(kind for kind in type(self).__mro__ if "_update" in vars(kind))
        # A class with an `_update` of its own may agree with its `_compute` on something else than its base does.
        # Python's own words; those of other exceptions are their classes' affair, which may fail at that.
        said = str(error) if type(error) in (TypeError, ValueError, AttributeError) else ""
        if "misfit" not in vars(own) and "unpack" not in said and not (value is None and "None" in said):
            return error
        misfit = self.misfit(value)
        return error if misfit is None else TypeError(misfit)

    async def _async_compute(self) -> Any:
        """Compute in the asynchronous mode; may await `sleep`, `happening` and `messages`."""
        return self._compute()

    async def _async_update(self, value: Any) -> None:
        """Update in the asynchronous mode; may await, too."""
        self._update(value)

    def sleep(self, duration: float) -> Wait:
        """Let simulated time pass within a turn of the asynchronous mode: ``await self.sleep(0.2)``.

        Args:
            duration: How long [s]; 0 lets all others go first who have something to do at this instant.

        Raises:
            ValueError: The duration is negative or not finite.
        """
        if not 0 <= duration < math.inf:
            raise ValueError(f"cannot sleep for {duration} s")
        return Sleep(nanoseconds(duration))

    def happening(self, name: str, source: str = "*") -> Wait:
        """Wait for an event within a turn of the asynchronous mode: ``event = await self.happening("contact")``.

        Args:
            name: The event's name.
            source: A path, in which ``*`` matches anything.
        """
        return EventWait(name, source)

    def any_of(self, *waits: Awaitable[Any]) -> Wait:
        """Wait for the first of several: ``which, value = await self.any_of(self.messages(), self.sleep(0.2))``.

        `which` is its position, `value` what it came to. What has come by the time that the component goes on, in its
        place in the order of the instant, counts as having come at once; of several the first one listed is taken. The
        others are cancelled; messages that were not taken stay unread.

        Args:
            waits: What to wait for, `any_of` and `all_of` included; in a paced run also what asyncio can await.

        Raises:
            ValueError: There is nothing to wait for.
            TypeError: Something cannot be awaited.
        """
        return AnyOf(waits)

    def all_of(self, *waits: Awaitable[Any]) -> Wait:
        """Wait for several, and return what they came to, as a tuple in their order; otherwise as `any_of`."""
        return AllOf(waits)

    def compute(self) -> Any:
        """Compute, with the events ``computing`` and ``computed``."""
        wanted = self._surroundings.events.wanted
        if "computing" in wanted:
            self._announce("computing")
        value = self._compute()
        if "computed" in wanted:
            self._announce("computed", value)
        return value

    def update(self, value: Any) -> None:
        """Update, with the events ``updating`` and ``updated``."""
        wanted = self._surroundings.events.wanted
        if "updating" in wanted:
            self._announce("updating", value)
        try:
            self._update(value)
        except Exception as error:
            raise self.explained(value, error) from error
        if "updated" in wanted:
            self._announce("updated", value)

    def compute_and_update(self) -> Any:
        """Take one turn: compute, then update with the value, which is returned."""
        if self._surroundings.events.turns_wanted:
            value = self.compute()
            self.update(value)
        else:
            value = self._compute()
            try:
                self._update(value)
            except Exception as error:
                raise self.explained(value, error) from error
        return value

    async def async_compute_and_update(self) -> Any:
        """Take one turn in the asynchronous mode."""
        wanted = self._surroundings.events.wanted
        if "computing" in wanted:
            self._announce("computing")
        value = await self._async_compute()
        if "computed" in wanted:
            self._announce("computed", value)
        await self.async_update(value)
        return value

    async def async_update(self, value: Any) -> None:
        """Update in the asynchronous mode, with the events ``updating`` and ``updated``."""
        wanted = self._surroundings.events.wanted
        if "updating" in wanted:
            self._announce("updating", value)
        try:
            await self._async_update(value)
        except Exception as error:
            raise self.explained(value, error) from error
        if "updated" in wanted:
            self._announce("updated", value)

    @property
    def now(self) -> int:
        """Simulated time in nanoseconds."""
        return self._surroundings.clock.now

    @property
    def computed_at(self) -> int:
        """When the value was computed that `_update` is given, in nanoseconds: now, unless the component has a latency.

        What `_update` writes is about that instant, however late it lands.
        """
        instant: int = self.__dict__.get("_computed_at", self.now)
        return instant

    @property
    def turn(self) -> Turn:
        """The turn that is under way, which keys what it draws, whenever its update lands."""
        turn: Turn | None = self.__dict__.get("_turn_begun")
        return Turn(self._surroundings.clock.now) if turn is None else turn

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._surroundings.clock.now / SECOND

    @property
    def environment(self) -> Environment:
        """The world. Perception reads it; other components live on what their agent is aware of."""
        return self._surroundings.environment

    def subscribe(self, name: str, callback: Subscriber) -> Subscription:
        """Be told of an event of this component."""
        return self._surroundings.events.subscribe(name, callback, self.path)

    def emit(self, name: str, text: str = "", *, level: Level = Level.INFO, **data: Any) -> None:
        """Fire an event of this component; it is recorded.

        Args:
            name: What happened; declare it in `events`.
            text: One line for people.
            level: How much it matters; the run's summary counts events of the level `Level.WARNING` by name.
            data: Further facts, as plain JSON values.
        """
        self._emit_from(self.path, self._agent_id, name, text, level, data)

    def _emit_from(
        self, path: str, agent: str | None, name: str, text: str, level: Level, data: Mapping[str, Any]
    ) -> None:
        self._surroundings.events.fire(Event(name, path, self.now, level, text, data, self, agent))

    def _announce(self, name: str, value: Any = None) -> None:
        event = Event(name, self.path, self.now, Level.DEBUG, subject=self, agent=self._agent_id, value=value)
        self._surroundings.events.fire(event)

    @property
    def _agent_id(self) -> str | None:
        """The agent whose component this is; None where it serves a whole group."""
        return None


class Component(BaseComponent[Agent]):
    """A component of one agent; the runtime makes one instance for each agent of the group.

    Subclasses implement `_compute` and `_update` over ``self._agent``.
    """

    _agent: Agent

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Take up work for an agent. A subclass that overrides this calls it first.

        Args:
            agent: Whom the component belongs to.
            initial_awareness_database: What the agent is aware of at the start, by id.
            initial_knowledge_database: What it knows at the start, by id.
        """
        self._agent = agent
        self._surroundings = agent.surroundings

    @property
    def agent(self) -> Agent:
        """Whom the component belongs to."""
        return self._agent

    @property
    def _agent_id(self) -> str | None:
        return self._agent.id

    @property
    def random(self) -> np.random.Generator:
        """The component's own source of chance, keyed by the run's seed, its path and the turn.

        In each turn it stands at a place of its own, however much was drawn in others; so ask for it in each.
        """
        source: AgentChance | None = self.__dict__.get("_random")
        if source is None:
            source = self.__dict__["_random"] = AgentChance(self._surroundings.seed, self.path)
        return source.at(self.turn)

    def record(self, signal: Signal, value: Any) -> None:
        """Hand out what one of the component's `signals` says now, in `_update`.

        That is a vector, shape (k,), a `TimeSeries`, or the rows of a table, shape (m, k).
        """
        self._agent.self_awareness[signal.field(self.name)] = value


class GroupComponent(BaseComponent[AgentGroup]):
    """A component of a whole group: one instance, whose `_compute` and `_update` work on arrays of all its agents."""

    _group: AgentGroup

    def initialise_component(self, group: AgentGroup) -> None:
        """Take up work for a group. A subclass that overrides this calls it first."""
        self._group = group
        self._surroundings = group.surroundings

    @property
    def group(self) -> AgentGroup:
        """Whom the component belongs to."""
        return self._group

    @property
    def triggered(self) -> Sequence[int] | None:
        """The rows of the agents whom the events concern that triggered this turn, ascending.

        None where the turn was due without. It is known as the turn begins: until `_compute` has returned, or a
        coroutine waits.
        """
        rows: Sequence[int] | None = self.__dict__.get("_triggered")
        return rows

    def agent_path(self, row: int) -> str:
        """Where the component stands for one agent, such as ``agents.robot.2.sense``."""
        return f"agents.{self._group.ids[row]}.{self.name}"

    @property
    def random(self) -> GroupChance:
        """A source of chance for each agent, keyed by the run's seed, the agent's path and the turn."""
        source: GroupChance | None = self.__dict__.get("_random")
        if source is None:
            roster = self._surroundings.environment.roster
            start = roster.start(self._group.name)
            numbers = roster.numbers[start : start + len(self._group)]
            source = self.__dict__["_random"] = GroupChance(self._surroundings.seed, f"component {self.name}", numbers)
        return source.at(self.turn)

    def record(self, signal: Signal, value: Any) -> None:
        """Hand out what one of the component's `signals` says now of each agent, in `_update`.

        That is an array, shape (n, k), times [ns] and values as `SeriesColumn.set` takes them, or a list of tables.
        """
        awareness, field = self._group.awareness, signal.field(self.name)
        if signal.kind == "series":
            awareness[field].set(*value)
        else:
            awareness[field] = value

    def emit_for(self, row: int, name: str, text: str = "", *, level: Level = Level.INFO, **data: Any) -> None:
        """Fire an event on behalf of one agent of the group."""
        self._emit_from(self.agent_path(row), self._group.ids[row], name, text, level, data)


class GroupCommunicationReceiver(GroupComponent):
    """Listens for all agents of a group at once; `_compute` returns what arrived, and `_update` is given it."""

    @property
    @abstractmethod
    def kinds(self) -> Collection[str]:
        """The kinds of messages that it reads; nobody else in the group gets these, unless it asks for them, too."""

    def _compute(self) -> Any:
        return self._surroundings.exchange.collect(self.path)

    @abstractmethod
    def _update(self, value: Sequence[Delivery]) -> None:
        """Make something of what was heard, in columns, oldest first for each agent."""
