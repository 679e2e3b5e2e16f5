"""Replicas: copies of the components of one entry, and of the data that they use, in a worker process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Clock, Drive, Event, EventBus, GroupComponent, Roster, Surroundings
from symaware_cli.core.event import RECURRING
from symaware_cli.core.verdict import SpecificationStatus
from symaware_cli.engine.runtime.failure import describe
from symaware_cli.engine.runtime.state.transfer import Transfer, settle
from symaware_cli.engine.runtime.turn import in_turn
from symaware_cli.world import Turn, trace


@dataclass(frozen=True, slots=True)
class EntryDescription:
    """The data from which a worker creates the replica of one entry.

    Attributes:
        kind: The class of the components.
        parameters: The parameters of each component.
        attributes: Name, path, entry-point name and period of each component.
        group: The name of the group.
        groups: The arguments of all groups, as they are at the start.
        time_step: The time step of the world, in nanoseconds.
        world: The class, parameters, folder and obstacles of the world; None if the components do not use it.
        seed: The seed of the run.
        packages: The packages whose classes the run uses.
        known: The regions of the scenario by name, and its sections.
        drive: How the world moves the bodies of the group; None where it does not state that.
    """

    kind: type[Any]
    parameters: list[Any]
    attributes: list[dict[str, Any]]
    group: str
    groups: list[tuple[Any, ...]]
    time_step: int
    world: tuple[Any, ...] | None
    seed: int
    packages: frozenset[str]
    known: tuple[Mapping[str, Any], Mapping[str, Any]] = ({}, {})
    drive: Drive | None = None

    def environment(self, groups: Sequence[AgentGroup]) -> Any:
        """Create a world that follows the one of the run, or a placeholder."""
        if self.world is None:
            models = {group.name: group.model for group in groups}
            roster = Roster({group.name: group.ids for group in groups}, models)
            return Unavailable("world", roster=roster, time_step=self.time_step)
        kind, parameters, folders, obstacles = self.world
        environment = kind(parameters)
        environment.folder, environment.further_folders = folders
        environment.initialise(groups, obstacles, self.seed)
        return environment


@dataclass(frozen=True, slots=True)
class ComputationResult:
    """The result of one computation.

    Attributes:
        row: The row of the component.
        value: The computed value as bytes of `Transfer`; None if the computation failed.
        state: The component as bytes of `Transfer`; None if it did not change.
        events: The events fired meanwhile: name, source, level, text and data of each.
        problem: The failure in one line; empty if there was none.
        trace: The traceback of the failure.
    """

    row: int
    value: bytes | None = None
    state: bytes | None = None
    events: tuple[tuple[Any, ...], ...] = ()
    problem: str = ""
    trace: str = ""

    @classmethod
    def of_failure(cls, row: int, error: BaseException) -> ComputationResult:
        """The result of a computation that raised an exception."""
        return cls(row, problem=describe(error), trace=trace(error))


class Unavailable:
    """A placeholder for the world or the exchange where there is none."""

    def __init__(self, what: str, **known: Any) -> None:
        self.__dict__.update(known)
        self._what = what

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise RuntimeError(
            f"a component that computes in a process of its own has no {self._what}: it lives on what its agent is "
            "aware of"
        )


class ReceivedStatuses:
    """The statuses of one specification as the run sent them; see `SpecificationStatuses`."""

    def __init__(
        self, worst: tuple[Any, ...], by_agent: Mapping[str, tuple[Any, ...]], measured: Mapping[str, float]
    ) -> None:
        self.specification = None
        self.began: int | None = None
        self.worst = SpecificationStatus(*worst)
        self._by_agent = by_agent
        self._measured = measured

    def of(self, agent: str) -> SpecificationStatus | None:
        """Return the status for an agent; None where it has none."""
        status = self._by_agent.get(agent)
        return None if status is None else SpecificationStatus(*status)

    def measured(self, agent: str) -> float:
        """Return the robustness by the measured values of an agent; only of specifications that are offered."""
        if agent not in self._measured:
            raise RuntimeError("in a process of its own, a component has the robustness of what is offered alone")
        return self._measured[agent]


class EntryTransfer(Transfer):
    """Transfers the components of one entry, and the parts of their group and of the world that they may read."""

    def __init__(
        self, group: AgentGroup, groups: Sequence[AgentGroup], packages: frozenset[str], *, of_group: bool
    ) -> None:
        """Name the objects that both ends have.

        Args:
            group: The group of the components.
            groups: All groups.
            packages: The packages whose classes the run uses.
            of_group: Whether they are components of the whole group; only others have agents.
        """
        super().__init__(packages)
        self._group = group
        self._groups = groups
        self._agents = () if of_group else group.agents
        awareness, surroundings = group.awareness, group.surroundings
        columns = {f"part {name}": column for name, column in awareness.columns.items()}
        state = {"awareness": awareness, "control": group.control_column, **columns}
        knowledge: dict[str, Any] = {f"knowledge {row}": each for row, each in enumerate(group.knowledge)}
        knowledge |= {"changes": group.knowledge_changes, "known": group._known}
        self._state, self._knowledge = tuple(state), tuple(knowledge)
        self.name(state | knowledge)
        #: The names and values of the knowledge that was captured last, and the captured bytes.
        self._taken: tuple[list[Any], bytes] = [], b""
        self.name(
            {
                "surroundings": surroundings,
                "environment": surroundings.environment,
                "exchange": surroundings.exchange,
                "clock": surroundings.clock,
                "events": surroundings.events,
                "roster": awareness.roster,
                "parts": awareness.parts,
                "signals": awareness.signals,
            }
        )
        for other in groups:
            self.name({f"group {other.name}": other, f"model {other.name}": other.model})
        for row, agent in enumerate(self._agents):
            self.name(
                {
                    f"agent {row}": agent,
                    f"model {row}": agent.model,
                    f"self {row}": agent.self_awareness,
                    f"database {row}": agent.awareness_database,
                    f"knowledges {row}": agent.knowledge_database,
                }
            )

    def name_parameters(self, parameters: Sequence[Any]) -> None:
        """Name the parameters of components, by row; None for components without parameters of their own."""
        self.name({f"parameters {row}": each for row, each in enumerate(parameters) if each is not None})

    def surroundings(self, *, sees_world: bool) -> bytes:
        """The data that a computation may read besides knowledge and its component, and that changes during a run."""
        settle(self._group)
        environment = self._group.surroundings.environment
        values: dict[str, Any] = {
            "present": {each.name: each.present for each in self._groups if each.present is not None},
            "held": [each.awareness_database.held for each in self._agents],
        }
        if self._group.specifications:
            offered = () if self._group.offers is None else self._group.offers.open_to(self._group.name)
            values["specifications"] = {
                name: (
                    tuple(statuses.worst),
                    {id: tuple(status) for id in self._group.ids if (status := statuses.of(id))},
                    {id: statuses.measured(id) for id in self._group.ids} if name in offered else {},
                )
                for name, statuses in self._group.specifications.items()
            }
        if sees_world:
            values["world"] = environment.snapshot().time, dict(environment.share()), list(environment.contacts())
        return self.taken(self._state, values)

    def knowledge(self) -> bytes:
        """The knowledge of the agents; the same bytes until it changes, which it seldom does."""
        known = [entry for each in self._group.knowledge for entry in (*each, *each.values())]
        last, data = self._taken
        if not data or len(known) != len(last) or not all(map(is_, known, last)):
            data = self.taken(self._knowledge)
            self._taken = known, data
        return data

    def component(self, component: Any) -> bytes:
        """The state of a component, which is named by its path."""
        return self.taken([component.path])

    def value(self, component: Any, value: Any) -> bytes:
        """The value that a component computed."""
        return self.taken((), {f"what {component.path} computed": value})

    def put_value(self, component: Any, data: bytes) -> Any:
        """The value that a component computed at the other end."""
        return self.put(data)[f"what {component.path} computed"]


class Replica:
    """The components of one entry in a worker."""

    def __init__(self, description: EntryDescription) -> None:
        self._description = description
        groups = [AgentGroup(*arguments) for arguments in description.groups]
        self._groups = {group.name: group for group in groups}
        self._group = group = self._groups[description.group]
        self._fired: list[Event] = []
        events = EventBus()
        for name in ("*", *sorted(RECURRING)):
            events.subscribe(name, self._fired.append)
        self._world = description.environment(groups)
        self._clock = Clock()
        inputs: Any = Unavailable("inputs from outside")
        exchange = Unavailable("exchange")
        surroundings = Surroundings(description.seed, self._world, exchange, self._clock, events, inputs)
        for each in groups:
            each.regions, each.sections = description.known
            each.drive = description.drive
            each.awareness.roster = self._world.roster
            each.surroundings = surroundings
            each.awareness.clock = self._clock
        self._is_group = issubclass(description.kind, GroupComponent)
        self._transfer = EntryTransfer(group, groups, description.packages, of_group=self._is_group)
        self._transfer.name_parameters(description.parameters)
        self._components: dict[int, Any] = {}
        #: The state of each component at the other end, by row.
        self._sent: dict[int, bytes] = {}

    def compute(
        self, now: int, knowledge: bytes | None, surroundings: bytes | None, rows: list[tuple[int, Turn, bytes | None]]
    ) -> list[ComputationResult]:
        """Compute for some rows.

        Args:
            now: Simulated time, in nanoseconds.
            knowledge: The bytes of `EntryTransfer.knowledge`; None if it did not change.
            surroundings: The bytes of `EntryTransfer.surroundings`; None if they did not change.
            rows: The row, the turn and the state of each component; None if that did not change.
        """
        if knowledge is not None:
            self._transfer.put(knowledge)
        if surroundings is not None:
            found = self._transfer.put(surroundings)
            self._take_presence(found["present"])
            if "world" in found:
                self._world.follow(*found["world"])
            self._group.specifications = {
                name: ReceivedStatuses(*each) for name, each in found.get("specifications", {}).items()
            }
            for agent, held in zip(self._group.agents if found["held"] else (), found["held"], strict=True):
                agent.awareness_database.held = held
        self._clock.now = now
        return [self._compute_one(*each) for each in rows]

    def _take_presence(self, present: Mapping[str, NDArray[np.bool_]]) -> None:
        """Let agents enter and leave the world as in the run; all are present in a new world."""
        for name, flags in present.items():
            group = self._groups[name]
            before = group.in_world
            group.present = flags
            if self._description.world is not None:
                for move, rows in ((self._world.dismiss, before & ~flags), (self._world.admit, flags & ~before)):
                    if rows.any():
                        move(group, np.flatnonzero(rows).tolist())

    def _compute_one(self, row: int, turn: Turn, state: bytes | None) -> ComputationResult:
        try:
            component = self._component(row)
            if state is not None:
                self._transfer.put(state)
                self._sent[row] = state
            self._fired.clear()
            with in_turn(component, turn):
                value = self._transfer.value(component, component._compute())
            events = tuple((e.name, e.source, int(e.level), e.text, e.data) for e in self._fired)
            before, after = self._sent.get(row), self._transfer.component(component)
            self._sent[row] = after
            return ComputationResult(row, value, None if after == before else after, events)
        except BaseException as error:
            return ComputationResult.of_failure(row, error)

    def _component(self, row: int) -> Any:
        """The replica of a component, created and initialised on first use."""
        component = self._components.get(row)
        if component is None:
            made_of = self._description
            component = made_of.kind() if made_of.parameters[row] is None else made_of.kind(made_of.parameters[row])
            vars(component).update(made_of.attributes[row])
            if self._is_group:
                component.initialise_component(self._group)
            else:
                agent = self._group.agents[row]
                component.initialise_component(agent, agent.awareness_database, agent.knowledge_database)
            self._transfer.name({component.path: component})
            self._components[row] = component
        return component
