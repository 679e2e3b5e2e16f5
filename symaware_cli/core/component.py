"""Components: the functions that update an agent's situational awareness."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import AwarenessDatabase, AwarenessVector, KnowledgeDatabase, Part, Signal
from symaware_cli.core.agent import Agent, AgentGroup, Surroundings
from symaware_cli.core.environment import Environment
from symaware_cli.core.event import Event, Level, Subscriber, Subscription
from symaware_cli.core.external_inputs import ANSWER, ERROR, ExternalInputError
from symaware_cli.core.message import Delivery, Message, MessageBatch
from symaware_cli.core.scenario_view import ScenarioView
from symaware_cli.core.waiting import AllOf, AnyOf, EventWait, Sleep, Wait
from symaware_cli.world import SECOND, AgentChance, GroupChance, Plugin, Quantity, Turn, nanoseconds

Array = NDArray[np.float64]
Owner = TypeVar("Owner")


class BaseComponent(Plugin, ABC, Generic[Owner]):
    """Base class of components of single agents and of groups.

    In each turn a component computes a value from the awareness of its agent, then updates the awareness with this
    value.

    Attributes:
        batchable: Whether each row that it computes depends only on itself and on the agents that `AgentGroup.others`
            returns for it, so that the agents of many runs may share the columns; see docs/sweeps.md.
        bodies: Which of its parameters name an ``agent``, an ``agent or entity``, ``agents`` by a list of ids, groups
            and patterns, or ``agents or entities`` likewise; looked up before a run.
        events: The events that the component fires in addition to those of every component, with their meanings.
        knowledge: The entries of knowledge that the component requires, with their meanings.
        name: The component's key in the scenario.
        parts: The parts of awareness that it writes, in addition to those that every agent has.
        path: Its path, such as ``agents.robot.2.steer``; the source of its events.
        period: The time between two turns, in nanoseconds; None for a turn at each step of the world, or for triggered
            turns only.
        requires: Features that the world must provide (see `Environment.provides`), each with a
            description of worlds that do, to which messages add the names of the installed ones.
        specifications: The parameter that lists specifications of its agents by name, if it has one; looked up before a
            run.
        specifications_of_others: Whether they may be about agents of other groups alone.
        signals: The signals that it records in its turns; other components can read them.
        sees_world: Whether it reads the world itself, and not only the awareness of its agent. If it computes in a
            worker process, that process then has a copy of the world.
        use: The plugin's entry-point name.
        writes: The entries of knowledge that it writes, with their initial values if the scenario gives none; so
            components that require them need no value in the scenario.
    """

    batchable: ClassVar[bool] = False
    bodies: ClassVar[Mapping[str, str]] = {}
    events: ClassVar[Mapping[str, str]] = {}
    knowledge: ClassVar[Mapping[str, str]] = {}
    parts: ClassVar[Sequence[Part]] = ()
    requires: ClassVar[Mapping[str, str]] = {}
    sees_world: ClassVar[bool] = False
    signals: ClassVar[Sequence[Signal]] = ()
    specifications: ClassVar[str | None] = None
    specifications_of_others: ClassVar[bool] = False
    writes: ClassVar[Mapping[str, Any]] = {}

    # Class defaults, so that a subclass with its own __init__ need not call this one.
    name: str = ""
    path: str = ""
    use: str = ""
    period: int | None = None

    _surroundings: Surroundings

    def check(self, group: AgentGroup) -> None:
        """Check whether the component can work for a group; called before a run.

        Args:
            group: The group, with its model, states and knowledge; the run has not started.

        Raises:
            ValueError: It cannot. The message explains the reason to the author of the scenario.
        """

    def attachments(self) -> Mapping[str, bytes]:
        """Return files that the component adds to the log of a run; called before the run, after `check`.

        Returns:
            The content of each file by its name, the same whenever the scenario is run; empty by default.
        """
        return {}

    @property
    def repeatable_to(self) -> float | None:
        """The absolute and relative tolerance of numbers in the log of a repeated run; None for equality.

        It is for components whose results depend on the processor, because a library computes them. The log states it,
        and `symaware verify` and others that repeat runs compare to the greatest tolerance of all components. Such runs
        are not batched.
        """
        return None

    def check_specification(self, specification: Any, group: AgentGroup) -> None:
        """Check whether the component can work with one of the `specifications` that it names; called before a run.

        Args:
            specification: A `symaware_cli.specification.specification.Specification`.
            group: The group.

        Raises:
            ValueError: It cannot. The message explains the reason to the author of the scenario.
        """

    def check_scenario(self, view: ScenarioView) -> None:
        """Check the whole scenario before a run; see `Plugin.check_scenario`."""

    def find_warnings(self, view: ScenarioView) -> None:
        """Warn of valid but probably unintended values; see `Plugin.find_warnings`."""

    def perceives(self) -> Mapping[str, bool]:
        """Return whether the component perceives states without errors and delay, for each kind that it perceives.

        Returns:
            By ``own`` for the agent's own state and ``others`` for the states of others; empty by default.
        """
        return {}

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Return the names of the columns of the time series that the component sets, for readers of the log.

        A replay recognises the names that docs/log-format.md lists: it draws an intent with the names of the position
        as a path, and an uncertainty with covariances of the position as ellipses.

        Args:
            group: The group, with its model.

        Returns:
            Name and unit of each column, by the name of the part; empty by default.
        """
        return {}

    @abstractmethod
    def _compute(self) -> Any:
        """Compute a value from the awareness; must not change anything, including the component itself."""

    @abstractmethod
    def _update(self, value: Any) -> None:
        """Update the awareness, the knowledge or the control input with a computed value."""

    def misfit(self, value: Any) -> str | None:
        """Explain what `_compute` should have returned, for a value that `_update` cannot use.

        Args:
            value: The value that it returned.

        Returns:
            One sentence; None if the value is valid.
        """
        return None

    def explained(self, value: Any, error: Exception) -> Exception:
        """Return the exception to raise if `_update` fails: a clear `TypeError` if the value has the wrong type."""
        own = next(kind for kind in type(self).__mro__ if "_update" in vars(kind))
        # A class with its own `_update` may use another type of value than its base class. Only messages of Python's
        # own exceptions are read: converting others to text may fail.
        said = str(error) if type(error) in (TypeError, ValueError, AttributeError) else ""
        if "misfit" not in vars(own) and "unpack" not in said and not (value is None and "None" in said):
            return error
        misfit = self.misfit(value)
        return error if misfit is None else TypeError(misfit)

    async def _async_compute(self) -> Any:
        """Compute in the asynchronous mode; may await `sleep`, `happening` and `messages`."""
        return self._compute()

    async def _async_update(self, value: Any) -> None:
        """Update in the asynchronous mode; may await as well."""
        self._update(value)

    def sleep(self, duration: float) -> Wait:
        """Let simulated time pass within a turn of the asynchronous mode: ``await self.sleep(0.2)``.

        Args:
            duration: How long [s]; with 0, all other turns of this instant come first.

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

        `which` is the position of the first one, `value` its result. Everything that has completed by the time at which
        the component resumes counts as simultaneous; of several, the first one listed is returned. The others are
        cancelled; messages that were not returned stay unread.

        Args:
            waits: The awaitables, including `any_of` and `all_of`; in a paced run also awaitables of asyncio.

        Raises:
            ValueError: There is nothing to wait for.
            TypeError: Something cannot be awaited.
        """
        return AnyOf(waits)

    def all_of(self, *waits: Awaitable[Any]) -> Wait:
        """Wait for all of several, and return their results as a tuple in their order; otherwise like `any_of`."""
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
        """The time at which the value passed to `_update` was computed [ns]: now, unless the component has a latency.

        What `_update` writes refers to that time, however late it is written.
        """
        instant: int | None = self.__dict__.get("_computed_at")
        return self.now if instant is None else instant

    @property
    def turn(self) -> Turn:
        """The present turn, which keys random draws, also those of a delayed update."""
        turn: Turn | None = self.__dict__.get("_turn_begun")
        return Turn(self._surroundings.clock.now) if turn is None else turn

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self._surroundings.clock.now / SECOND

    @property
    def environment(self) -> Environment:
        """The world. Perception reads it; other components use the awareness of their agent."""
        return self._surroundings.environment

    def subscribe(self, name: str, callback: Subscriber) -> Subscription:
        """Call a function at an event of this component."""
        return self._surroundings.events.subscribe(name, callback, self.path)

    def emit(self, name: str, text: str = "", *, level: Level = Level.INFO, **data: Any) -> None:
        """Fire an event of this component; it is recorded.

        Args:
            name: The name of the event; declare it in `events`.
            text: One line for people.
            level: Its importance; the summary of the run counts events of the level `Level.WARNING` by name.
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

    def external_input(self, ask: Callable[[], Any]) -> Any:
        """Return an external input, such as the answer of another program.

        It is recorded. A run that is repeated from its log takes the input from the log, without a call of `ask`; so
        the input may depend on wall time, and the run can still be repeated. Call it in `_compute`.

        Args:
            ask: Returns the input as plain JSON values, or raises an exception, whose text is recorded.

        Returns:
            The input, as JSON has it: with lists in place of tuples.

        Raises:
            ExternalInputError: There is no input. The text is that of the exception that `ask` raised.
        """
        surroundings = self._surroundings
        now = surroundings.clock.now
        found = surroundings.inputs.take(self.path, now, ask)
        if "external-input" in surroundings.events.wanted:
            surroundings.events.fire(Event("external-input", self.path, now, Level.DEBUG, data=found, subject=self))
        # Raised here in both cases, so that the traceback in the log is the same when the run is repeated.
        if ERROR in found:
            raise ExternalInputError(found[ERROR])
        return found[ANSWER]

    @property
    def _agent_id(self) -> str | None:
        """The agent of this component; None for a component of a whole group."""
        return None


class Component(BaseComponent[Agent]):
    """A component of one agent; the runtime creates one instance for each agent of the group.

    Subclasses implement `_compute` and `_update` over ``self._agent``.
    """

    _agent: Agent

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Initialise the component for an agent. A subclass that overrides this calls it first.

        Args:
            agent: The agent of the component.
            initial_awareness_database: The initial awareness of the agent, by id.
            initial_knowledge_database: The initial knowledge of the agent, by id.
        """
        self._agent = agent
        self._surroundings = agent.surroundings

    @property
    def agent(self) -> Agent:
        """The agent of the component."""
        return self._agent

    @property
    def _agent_id(self) -> str | None:
        return self._agent.id

    def accept(self, specification: str) -> bool:
        """Accept a specification that is offered, in `_update`: from its beginning it counts for this agent.

        Args:
            specification: Its name.

        Returns:
            Whether the agent has accepted it; False if it is not offered now, another agent was faster, or this one has
            failed it already.

        Raises:
            ValueError: It is never offered, or it is about the agents of another group.
        """
        return _accept(self._agent.group, specification, self._agent.id, self.path)

    @property
    def random(self) -> np.random.Generator:
        """The random generator of the component, keyed by the seed of the run, the path of the component and the turn.

        In each turn it starts anew, independent of how much was drawn in others; so do not keep it in an attribute.
        """
        source: AgentChance | None = self.__dict__.get("_random")
        if source is None:
            source = self.__dict__["_random"] = AgentChance(self._surroundings.seed, self.path)
        return source.at(self.turn)

    def redraw(self, draw: str | None) -> None:
        """Let the generator draw from other keys from the next turn on; see `AgentChance.redraw`."""
        source: AgentChance | None = self.__dict__.get("_random")
        if source is None:
            source = self.__dict__["_random"] = AgentChance(self._surroundings.seed, self.path)
        source.redraw(draw)

    def record(self, signal: Signal, value: Any) -> None:
        """Record the present value of one of the component's `signals`; call it in `_update`.

        The value is a vector, shape (k,), a `TimeSeries`, or the rows of a table, shape (m, k).
        """
        self._agent.self_awareness[signal.field(self.name)] = value

    def send(self, message: Message) -> None:
        """Send a message; its receiver can read it from the next step on.

        Raises:
            ValueError: A part of the awareness that it contains is not finite.
        """
        surroundings = self._surroundings
        for value in message.payload.values():
            if isinstance(value, AwarenessVector):
                self._agent.group.awareness.check(value)
        if "sending" in surroundings.events.wanted:
            surroundings.events.fire(_sending(message, self.now))
        surroundings.exchange.send(message)


class GroupComponent(BaseComponent[AgentGroup]):
    """A component of a whole group: one instance, whose `_compute` and `_update` work on arrays of all its agents."""

    _group: AgentGroup

    def initialise_component(self, group: AgentGroup) -> None:
        """Initialise the component for a group. A subclass that overrides this calls it first."""
        self._group = group
        self._surroundings = group.surroundings

    @property
    def group(self) -> AgentGroup:
        """The group of the component."""
        return self._group

    @property
    def triggered(self) -> Sequence[int] | None:
        """The rows of the agents that the triggering events of this turn concern, ascending.

        None if no event triggered the turn. Available only until `_compute` has returned, or until a coroutine waits.
        """
        rows: Sequence[int] | None = self.__dict__.get("_triggered")
        return rows

    @property
    def acting(self) -> Sequence[int]:
        """The rows of the agents for which it acts in this turn, ascending.

        These are in the world, are not suspended by a fault, and do not use another component instead. Values written
        for others have no effect; actions outside of the run, such as a message to another program, must be limited to
        these.
        """
        muted = self._surroundings.events.muted
        return [row for row in self._group.rows.tolist() if self.agent_path(row) not in muted]

    def agent_path(self, row: int) -> str:
        """The path of the component for one agent, such as ``agents.robot.2.sense``."""
        return f"agents.{self._group.ids[row]}.{self.name}"

    @property
    def random(self) -> GroupChance:
        """A random generator for each agent, keyed by the seed of the run, the path of the agent and the turn."""
        source: GroupChance | None = self.__dict__.get("_random")
        if source is None:
            roster = self._surroundings.environment.roster
            start = roster.start(self._group.name)
            numbers = roster.numbers[start : start + len(self._group)]
            seed = self._group.seeds or self._surroundings.seed
            source = self.__dict__["_random"] = GroupChance(seed, f"component {self.name}", numbers)
        return source.at(self.turn)

    def record(self, signal: Signal, value: Any) -> None:
        """Record the present value of one of the component's `signals` for each agent; call it in `_update`.

        The value is an array, shape (n, k), times [ns] and values as for `SeriesColumn.set`, or a list of tables.
        """
        awareness, field = self._group.awareness, signal.field(self.name)
        if signal.kind == "series":
            awareness[field].set(*value)
        else:
            awareness[field] = value

    def accept_for(self, row: int, specification: str) -> bool:
        """Accept a specification that is offered, for one agent of the group; see `Component.accept`."""
        return _accept(self._group, specification, self._group.ids[row], self.agent_path(row))

    def emit_for(self, row: int, name: str, text: str = "", *, level: Level = Level.INFO, **data: Any) -> None:
        """Fire an event on behalf of one agent of the group."""
        self._emit_from(self.agent_path(row), self._group.ids[row], name, text, level, data)

    def post(self, batch: MessageBatch) -> None:
        """Send messages of agents of the group; their receivers can read them from the next step on."""
        surroundings = self._surroundings
        if "sending" in surroundings.events.wanted:
            # An event for each message, as its subscribers want them.
            for message in batch.messages(surroundings.environment.roster.ids):
                surroundings.events.fire(_sending(message, self.now))
        surroundings.exchange.post(batch)


def _sending(message: Message, now: int) -> Event:
    return Event("sending", f"agents.{message.sender}", now, subject=message, agent=message.sender, value=message)


class GroupCommunicationReceiver(GroupComponent):
    """Receives messages for all agents of a group; `_compute` returns them, and `_update` processes them."""

    @property
    @abstractmethod
    def kinds(self) -> Collection[str]:
        """The kinds of messages that it reads; other components get these only if they ask for them as well."""

    def _compute(self) -> Any:
        return self._surroundings.exchange.collect(self.path)

    @abstractmethod
    def _update(self, value: Sequence[Delivery]) -> None:
        """Process the messages that arrived, in columns, oldest first for each agent."""


def _accept(group: AgentGroup, specification: str, agent: str, path: str) -> bool:
    if group.offers is None:
        raise ValueError(f"no specification `{specification}` is offered in this scenario")
    return group.offers.accept(specification, agent, path)


def may_wait(kind: type[BaseComponent[Any]]) -> bool:
    """Whether components of a class may wait within their turns, which are then coroutines."""
    methods = ("_async_compute", "_async_update", "async_compute_and_update")
    return any(getattr(kind, name) is not getattr(Component, name) for name in methods)
