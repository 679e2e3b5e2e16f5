"""A worker process: computes for components that are to run in a process of their own.

It holds a replica of each such component and of the data of its group, and is told before each computation what has
changed. All that goes through its two pipes was pickled by the run that started it, or by itself.
"""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import signal
import struct
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.column import Column
from symaware_cli.awareness.signal import SignalColumn
from symaware_cli.awareness.table_column import TableColumn
from symaware_cli.core import (
    AgentGroup,
    Clock,
    Component,
    Event,
    EventBus,
    GroupComponent,
    Roster,
    Subscription,
    Surroundings,
)
from symaware_cli.core.event import RECURRING
from symaware_cli.runtime.failure import describe
from symaware_cli.runtime.turn import in_turn
from symaware_cli.world.chance import Turn

#: What tells the kernel to end a process with the one that started it (Linux).
_PR_SET_PDEATHSIG = 1

_LENGTH = struct.Struct("<Q")


@dataclass(frozen=True, slots=True)
class Part:
    """All that it takes to make the replicas of one slot.

    Attributes:
        kind: The class of the components.
        parameters: Those of each component.
        attributes: Name, path and entry-point name of each.
        group: The name of the group.
        groups: The arguments of all groups, as they are at the start.
        time_step: That of the world, in nanoseconds.
        world: What makes the world: its class, its parameters, its folder and its obstacles; None where the components
            do not look at it.
        seed: The seed of the run.
    """

    kind: type[Any]
    parameters: list[Any]
    attributes: list[dict[str, str]]
    group: str
    groups: list[tuple[Any, ...]]
    time_step: int
    world: tuple[Any, ...] | None
    seed: int

    def environment(self, groups: Sequence[AgentGroup]) -> Any:
        """Make a world that follows the one of the run, or what stands for it."""
        if self.world is None:
            models = {group.name: group.model for group in groups}
            roster = Roster({group.name: group.ids for group in groups}, models)
            return Elsewhere("world", roster=roster, time_step=self.time_step)
        kind, parameters, folder, obstacles = self.world
        environment = kind(parameters)
        environment.folder = folder
        environment.initialise(groups, obstacles, self.seed)
        return environment


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one computation.

    Attributes:
        row: Whose it was.
        value: What it returned, pickled; None where it failed.
        state: The attributes of the component, pickled; None where they are as they were.
        events: What was fired meanwhile: name, source, level, text and data of each.
        problem: What went wrong, in one line; empty where nothing did.
        trace: The traceback of that.
    """

    row: int
    value: bytes | None = None
    state: bytes | None = None
    events: tuple[tuple[Any, ...], ...] = ()
    problem: str = ""
    trace: str = ""


class Elsewhere:
    """Stands for the world, and for the exchange, where there is none."""

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


class Codec:
    """Pickles what refers to a group and its surroundings without taking these along.

    Both sides give the same names to what they share; an object that has a name is replaced by it.
    """

    def __init__(self, group: AgentGroup, surroundings: Any, groups: Sequence[AgentGroup]) -> None:
        self._named: dict[str, Any] = {
            "group": group,
            "model": group.model,
            "awareness": group.awareness,
            "surroundings": surroundings,
            "environment": surroundings.environment,
            "exchange": surroundings.exchange,
            "clock": surroundings.clock,
            "events": surroundings.events,
            "roster": group.awareness.roster,
        }
        for other in groups:
            self._named |= {f"group {other.name}": other, f"model {other.name}": other.model}
        self._group = group
        self._names = {id(value): name for name, value in self._named.items()}

    def name_agents(self) -> None:
        """Give names to the agents, too, which exist only for groups that have components of single agents."""
        for row, agent in enumerate(self._group.agents):
            shared = {
                f"agent {row}": agent,
                f"model {row}": agent.model,
                f"self {row}": agent.self_awareness,
                f"database {row}": agent.awareness_database,
                f"knowledge {row}": agent.self_knowledge,
                f"knowledges {row}": agent.knowledge_database,
            }
            self._named |= shared
            self._names |= {id(value): name for name, value in shared.items()}

    def name_component(self, row: int, component: Any) -> None:
        """Give a name to a component, which may refer to itself."""
        self._named[f"component {row}"] = component
        self._names[id(component)] = f"component {row}"

    def encode(self, value: Any) -> bytes:
        """Pickle a value."""
        buffer, names = io.BytesIO(), self._names

        class Pickler(pickle.Pickler):
            def persistent_id(self, obj: Any) -> str | None:
                return names.get(id(obj))

        Pickler(buffer, 5).dump(value)
        return buffer.getvalue()

    def decode(self, data: bytes) -> Any:
        """Read what the other side of a pipe has pickled."""
        named = self._named

        class Unpickler(pickle.Unpickler):
            def persistent_load(self, pid: Any) -> Any:
                return named[pid]

        return Unpickler(io.BytesIO(data)).load()


class State:
    """The attributes of a component as they go back and forth; those that cannot be pickled stay on each side."""

    def __init__(self, codec: Codec, component: Component | GroupComponent) -> None:
        self._codec = codec
        self._component = component
        self._local: set[str] = set()
        self._last = b""

    def changed(self) -> bytes | None:
        """The attributes, pickled; None where they are as the other side has them."""
        data = self._pickled()
        if data == self._last:
            return None
        self._last = data
        return data

    def forget(self) -> None:
        """The other side has nothing any more."""
        self._last = b""

    def take(self, data: bytes | None) -> None:
        """Take over the attributes of the other side."""
        if data is None:
            return
        attributes = self._codec.decode(data)
        if not self._last:
            self._pickled()  # finds out which cannot be, and so stay
        kept = {
            name: value
            for name, value in vars(self._component).items()
            if name in self._local or isinstance(value, Subscription)
        }
        vars(self._component).clear()
        vars(self._component).update({**kept, **attributes})
        # What comes back is compared with what these would be pickled as again.
        self._last = self._pickled()

    def _pickled(self) -> bytes:
        attributes = {
            name: value
            for name, value in sorted(vars(self._component).items())
            if name not in self._local and not isinstance(value, Subscription)
        }
        try:
            return self._codec.encode(attributes)
        except Exception:  # whatever a class raises that does not want to be pickled
            for name, value in attributes.items():
                try:
                    self._codec.encode(value)
                except Exception:
                    self._local.add(name)
            return self._codec.encode({name: each for name, each in attributes.items() if name not in self._local})


def group_data(group: AgentGroup, *, sees_world: bool = False) -> dict[str, Any]:
    """What a computation may look at of a group, and of the world if it does, and what changes in a run."""
    awareness = group.awareness
    data: dict[str, Any] = {
        "parts": {name: _column_data(column) for name, column in awareness.columns.items()},
        "control_input": (group.control_input, group.control_column.writes),
        "world": awareness.world,
        "observation": awareness.observation,
        "seen": awareness.seen,
        "told": awareness.told,
        "readings": dict(awareness.readings),
        "knowledge": [dict(each) for each in group.knowledge],
    }
    environment = group.surroundings.environment
    data["present"] = {each.name: each.present for each in environment.groups if each.present is not None}
    if sees_world:
        data["truth"] = environment.snapshot().time, dict(environment.capture()), tuple(environment.contacts())
    if "agents" in vars(group):
        databases = [each.awareness_database for each in group.agents]
        data["others"] = [each.held for each in databases]
    return data


def _column_data(column: SignalColumn) -> Any:
    if isinstance(column, Column):
        return column.values
    if isinstance(column, TableColumn):
        return column.tables
    column.settle()
    return column._times, column._values, column._width, column._rows


def _take_group_data(group: AgentGroup, data: Mapping[str, Any]) -> None:
    awareness = group.awareness
    for name, content in data["parts"].items():
        _take_column_data(awareness.columns[name], content)
    group.control_column.values, writes = data["control_input"]
    group.control_column.writes = writes
    awareness.world, awareness.observation = data["world"], data["observation"]
    awareness.seen, awareness.told, awareness.readings = data["seen"], data["told"], data["readings"]
    for own, known in zip(group.knowledge, data["knowledge"], strict=True):
        own.replace(known)
    for agent, held in zip(group.agents, data.get("others", ()), strict=False):
        agent.awareness_database.held = held


def _take_column_data(column: SignalColumn, content: Any) -> None:
    if isinstance(column, Column):
        column.values = content
    elif isinstance(column, TableColumn):
        column.exchange(content)
    else:
        column.settle()
        column._times, column._values, column._width, column._rows = content


class Replica:
    """The components of one slot, as they are in a worker."""

    def __init__(self, part: Part) -> None:
        self._groups = groups = {arguments[0]: AgentGroup(*arguments) for arguments in part.groups}
        self.group = groups[part.group]
        self._fired: list[Event] = []
        events = EventBus()
        for name in ("*", *sorted(RECURRING)):
            events.subscribe(name, self._fired.append)
        self._world = part.environment(list(groups.values()))
        self.surroundings = Surroundings(part.seed, self._world, Elsewhere("exchange"), Clock(), events)
        for group in groups.values():
            group.awareness.roster = self._world.roster
            group.surroundings = self.surroundings
            group.awareness.clock = self.surroundings.clock
        self.codec = Codec(self.group, self.surroundings, list(groups.values()))
        self._is_group = issubclass(part.kind, GroupComponent)
        if not self._is_group:
            self.codec.name_agents()
        self._components: dict[int, tuple[Any, State]] = {}
        self._part = part

    def compute(self, now: int, data: bytes | None, rows: list[tuple[int, Turn, bytes | None]]) -> list[Outcome]:
        """Compute for some rows, with the data of now."""
        if data is not None:
            content = self.codec.decode(data)
            self._take_presence(content["present"])
            if "truth" in content:
                self._world.adopt(*content["truth"])
            _take_group_data(self.group, content)
        self.surroundings.clock.now = now
        return [self._compute_one(*each) for each in rows]

    def _take_presence(self, present: Mapping[str, NDArray[np.bool_]]) -> None:
        """Let agents enter and leave the world here as they did there; all are in one that has just been made."""
        for name, flags in present.items():
            group = self._groups[name]
            before = np.ones(len(group), bool) if group.present is None else group.present
            flags.flags.writeable = False
            group.present = flags
            if self._part.world is not None:
                for move, rows in ((self._world.dismiss, before & ~flags), (self._world.admit, flags & ~before)):
                    if rows.any():
                        move(group, np.flatnonzero(rows).tolist())

    def _compute_one(self, row: int, turn: Turn, attributes: bytes | None) -> Outcome:
        try:
            component, state = self._component(row)
            state.take(attributes)
            self._fired.clear()
            with in_turn(component, turn):
                value = self.codec.encode(component._compute())
            events = tuple((e.name, e.source, int(e.level), e.text, e.data) for e in self._fired)
            return Outcome(row, value, state.changed(), events)
        except BaseException as error:
            return _failure(row, error)

    def _component(self, row: int) -> tuple[Any, State]:
        """The replica of a component, which takes up its work here as it did there: what cannot be sent is made."""
        known = self._components.get(row)
        if known is None:
            part = self._part
            component = part.kind() if part.parameters[row] is None else part.kind(part.parameters[row])
            vars(component).update(part.attributes[row])
            self.codec.name_component(row, component)
            if self._is_group:
                component.initialise_component(self.group)
            else:
                agent = self.group.agents[row]
                component.initialise_component(agent, agent.awareness_database, agent.knowledge_database)
            known = self._components[row] = (component, State(self.codec, component))
        return known


def write(pipe: BinaryIO, data: bytes) -> None:
    """Send a message."""
    pipe.write(_LENGTH.pack(len(data)))
    pipe.write(data)
    pipe.flush()


def read(pipe: BinaryIO) -> bytes:
    """Receive a message.

    Raises:
        EOFError: The other side is gone.
    """
    length = _LENGTH.unpack(_exactly(pipe, _LENGTH.size))[0]
    return _exactly(pipe, length)


def _exactly(pipe: BinaryIO, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = pipe.read(count - len(data))
        if not part:
            raise EOFError
        data += part
    return bytes(data)


@np.errstate(all="ignore")  # as in the process that it works for
def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until there are no more: pickled tuples of a slot's number and the arguments of `compute`.

    The first message is what `sys.path` shall be, the second for each slot its `Part`, pickled.
    """
    sys.path[:] = pickle.loads(read(requests))
    replicas = [_replica(part) for part in pickle.loads(read(requests))]
    write(answers, pickle.dumps(None))  # ready: what has to be imported does not count as a turn
    while True:
        try:
            number, now, data, rows = pickle.loads(read(requests))
        except EOFError:
            return
        replica = replicas[number]
        try:
            if isinstance(replica, BaseException):
                raise replica
            outcomes = replica.compute(now, data, rows)
        except BaseException as error:
            outcomes = [_failure(row, error) for row, *_ in rows]
        write(answers, pickle.dumps(outcomes))


def _replica(part: bytes) -> Replica | BaseException:
    """Make a replica; what is raised meanwhile is told to whoever asks for a computation."""
    try:
        return Replica(pickle.loads(part))
    except BaseException as error:
        return error


def _failure(row: int, error: BaseException) -> Outcome:
    return Outcome(row, problem=describe(error), trace="".join(traceback.format_exception(error)))


def main(incoming: int, outgoing: int, parent: int) -> None:
    """Be a worker of the process that started this one."""
    # Ctrl-C reaches all processes of a terminal; the run decides what becomes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        return  # it is gone already
    with (
        os.fdopen(incoming, "rb") as requests,
        os.fdopen(outgoing, "wb") as answers,
        suppress(BrokenPipeError),
    ):
        serve(requests, answers)
